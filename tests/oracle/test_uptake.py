"""Requests that others send to a machine: whether its node took them up, by what both ends tell."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from moon.feed.nodes import Nodes
from moon.oracle.bounds import LINKED_NS, Bounds
from moon.oracle.confirmation import Losses, Unconfirmed, Waiting
from moon.oracle.oracle import Oracle
from moon.oracle.shared import Shared
from moon.verdict import Outcome, Verdict
from tests.feed.test_progress import ASKS, MS, START
from tests.oracle.machines import library, read
from transports.interface import NAMELESS, Observation, ObservationKind

SENT, RECEIVED = ObservationKind.REQUEST_SENT, ObservationKind.REQUEST_RECEIVED
ANSWERED, GOT = ObservationKind.RESPONSE_SENT, ObservationKind.RESPONSE_RECEIVED


class Called:
    """The oracle of a machine that is asked by somebody, each thing told when it happens."""

    def __init__(self, *, is_numbered: bool = False, sources: Nodes | None = None) -> None:
        self.is_numbered = is_numbered
        self.sources = sources
        machine = read(ASKS.format(more=""))
        shared = Shared(losses=Losses(possible=sources is None), sources=sources)
        self.oracle = Oracle(machine, library(), bounds=Bounds(), shared=shared)
        self.oracle.start(START, whole=True)
        self.now = START
        self.said: list[Outcome] = []
        self.numbers: dict[str, int] = {}

    def hear(
        self,
        kind: ObservationKind,
        call: int,
        error: str = "",
        server_knows: str = "somebody",
        value: int = 2,
    ) -> None:
        self.now += MS
        is_own = kind in (RECEIVED, ANSWERED)
        data: Any = {"value": 1} if kind in (SENT, RECEIVED) else {"value": value, "ok": False}
        end = "Probe" if is_own else "somebody"
        self.numbers[end] = number = self.numbers.get(end, -1) + 1
        seen = Observation(
            stamp_ns=self.now, received_ns=self.now, channel="/Probe/ask", kind=kind, type_name="",
            data=None if error else data, source=end, client=server_knows if is_own else "somebody",
            call=call, error=error, sequence=number if self.is_numbered else -1,
        )  # fmt: skip
        self.said += [verdict.outcome for verdict in self.oracle.feed(seen)]

    def call(self, number: int) -> None:
        for kind in (SENT, RECEIVED, ANSWERED, GOT):
            self.hear(kind, number)

    def passed(self, ns: int) -> list[Outcome]:
        """So long (ns) both ends are heard, where that matters."""
        if self.sources is not None:
            for at_ns in range(self.now, self.now + ns, Bounds().latency // 2):
                for node in ("Probe", "somebody"):
                    self.sources.reachability.heard(node, at_ns, MS)
                self.said += [verdict.outcome for verdict in self.oracle.advance(at_ns)]
        self.now += ns
        self.said += [verdict.outcome for verdict in self.oracle.advance(self.now)]
        return self.said


LONG = 3 * Bounds().deadline


def test_a_request_that_is_not_received_is_a_violation() -> None:
    called = Called()
    called.call(1)
    called.hear(SENT, 2)
    assert called.passed(LONG) == [Outcome.VIOLATED]


def test_a_request_whose_client_sent_another_one_that_was_received_is_no_violation() -> None:
    """Who calls one after the other has had its answer: both ends of that call were not heard."""
    called = Called()
    called.call(1)
    called.hear(SENT, 2)
    called.call(3)
    assert called.passed(LONG) == []


def test_a_request_that_was_answered_was_received_though_its_server_was_not_heard() -> None:
    """Its node did not know of the tap yet: who asked told, and who answered did not."""
    called = Called()
    called.hear(SENT, 1)
    called.hear(GOT, 1)
    called.call(2)
    assert called.passed(LONG) == []


@pytest.mark.parametrize("error", ["timeout: no answer", "unavailable: nobody answers"])
def test_a_call_that_failed_does_not_show_that_it_was_received(error: str) -> None:
    called = Called()
    called.call(1)
    called.hear(SENT, 2)
    called.hear(GOT, 2, error)
    assert called.passed(LONG) == [Outcome.VIOLATED]


@pytest.mark.parametrize("came_ns", [0, 2 * LINKED_NS])
def test_a_request_of_a_client_that_may_not_have_found_the_server_is_expected_once_it_has(
    came_ns: int,
) -> None:
    """``came_ns``: when the client came up; it waits with the request until it has found the server."""
    called = Called(sources=Nodes(Bounds().latency))
    called.now += came_ns
    called.oracle.sender_changed("somebody", called.now)
    called.hear(SENT, 1)
    called.passed(LINKED_NS)
    assert called.said == []
    assert Outcome.VIOLATED in called.passed(LONG)


def test_a_request_of_a_client_that_has_found_the_server_is_expected_at_once() -> None:
    called = Called(sources=Nodes(Bounds().latency))
    called.oracle.sender_changed("somebody", START)
    called.call(1)
    called.hear(SENT, 2)
    assert Outcome.VIOLATED in called.passed(LONG)


@pytest.mark.parametrize("error", ["timeout: no answer", "unavailable: nobody answers"])
def test_a_request_whose_client_gave_up_before_it_found_the_server_never_left(error: str) -> None:
    called = Called(sources=Nodes(Bounds().latency))
    called.oracle.sender_changed("somebody", START)
    called.hear(SENT, 1)
    called.passed(LINKED_NS // 2)
    called.hear(GOT, 1, error)
    assert called.passed(LINKED_NS + LONG) == []


NAMELESS_CALLER = f"{NAMELESS}01"


def test_a_request_was_received_though_its_server_does_not_know_the_name_of_who_asked() -> None:
    """On ROS 2 the graph tells a new client's name later than its first request comes."""
    for ends in ((SENT, RECEIVED), (RECEIVED, SENT)):
        called = Called()
        for kind in (*ends, ANSWERED):
            called.hear(kind, 1, server_knows=NAMELESS_CALLER)
        assert called.passed(LONG) == []


def test_a_violation_is_certain_though_a_server_did_not_know_the_name_of_who_asked() -> None:
    called = Called(is_numbered=True)
    for kind in (SENT, RECEIVED, ANSWERED, GOT):
        called.hear(kind, 1, server_knows=NAMELESS_CALLER)
    called.hear(SENT, 2)
    called.hear(RECEIVED, 2)
    called.hear(ANSWERED, 2, value=3)
    called.hear(GOT, 2, value=3)
    called.call(3)
    assert called.passed(LONG) == [Outcome.VIOLATED]


def test_a_violation_is_certain_though_a_later_call_was_heard_at_its_other_end_only_so_far() -> (
    None
):
    """What the node did just now may be heard after what its client got: it is not missing."""
    called = Called(is_numbered=True)
    called.call(1)
    for kind in (SENT, RECEIVED, ANSWERED):
        called.hear(kind, 2, value=3)
    called.passed(Bounds().latency - 3 * MS)
    called.hear(SENT, 3)
    called.hear(GOT, 3)
    called.passed(MS)
    called.hear(RECEIVED, 3)
    called.hear(ANSWERED, 3)
    # until its own report came, it may have answered before
    assert called.passed(Bounds().latency) == [Outcome.INCONCLUSIVE, Outcome.VIOLATED]


TWO_SERVICES = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" datamodel="ecmascript" name="Probe"
    initial="idle">
  <datamodel><data id="waits" type="int32" expr="0"/></datamodel>
  <ros_service_server service_name="/Probe/ask" type="probe_interfaces/Ask"/>
  <ros_service_server service_name="/Probe/tell" type="probe_interfaces/Ask"/>
  <ros_time_rate name="beat" rate_hz="2"/>
  <state id="idle">
    <ros_service_handle_request name="/Probe/ask"><assign location="waits" expr="1"/></ros_service_handle_request>
    <ros_service_handle_request name="/Probe/tell" cond="waits &gt; 9"/>
    <ros_rate_callback name="beat" cond="waits &gt; 0">
      <assign location="waits" expr="0"/>
      <ros_service_send_response name="/Probe/ask"><field name="value" expr="1"/></ros_service_send_response>
    </ros_rate_callback>
  </state>
</scxml>
"""
"""It answers later, and discards what is asked elsewhere."""


def _two_services() -> Callable[[int, str, ObservationKind, str], list[Outcome]]:
    """An oracle, told of call 1 of one client: when (ms), of which service, what happened, and an error."""
    oracle = Oracle(
        read(TWO_SERVICES), library(), bounds=Bounds(), shared=Shared(losses=Losses(possible=False))
    )
    oracle.start(START, whole=True)

    def hear(at_ms: int, channel: str, kind: ObservationKind, error: str = "") -> list[Outcome]:
        now = START + at_ms * MS
        data: Any = {"value": 1, "ok": False} if kind in (ANSWERED, GOT) else {"value": 1}
        source = "somebody" if kind in (SENT, GOT) else "Probe"
        seen = Observation(
            stamp_ns=now, received_ns=now, channel=channel, kind=kind, type_name="", source=source,
            data=None if error else data, client="somebody", call=1, error=error,
        )  # fmt: skip
        said = [*oracle.feed(seen), *oracle.advance(now)]
        return [verdict.outcome for verdict in said]

    return hear


def test_a_request_that_is_discarded_is_not_the_one_of_another_service_with_its_number() -> None:
    """On ROS 2 a client counts its calls to each service by itself."""
    hear = _two_services()
    assert hear(480, "/Probe/ask", RECEIVED) == []
    assert hear(499, "/Probe/tell", RECEIVED) == []  # perhaps it has answered already
    assert hear(505, "/Probe/ask", ANSWERED) == []
    assert hear(4000, "/Probe/tell", RECEIVED) == []


@pytest.mark.parametrize(("channel", "is_shown"), [("/Probe/ask", True), ("/Probe/tell", False)])
def test_a_client_that_gives_up_shows_nothing_of_its_call_to_another_service(
    channel: str, is_shown: bool
) -> None:
    call, answer = ("somebody", 1, 0), ("Probe", "/Probe/ask", False)
    violation = Verdict("Probe", "Probe", Outcome.VIOLATED, START, "it owes an answer")
    unconfirmed = Unconfirmed()
    unconfirmed.add(Waiting(violation, {answer: 3}, call=call, answer=answer))
    unconfirmed.gave_up(channel, call, START + MS)
    found = unconfirmed.silent(lambda since_ns: True, START + 2 * MS, False)
    assert found == ([violation] if is_shown else [])
