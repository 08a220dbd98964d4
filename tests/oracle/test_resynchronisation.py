"""A machine that is found in the middle of what it does, at every moment at which that could go wrong."""

from __future__ import annotations

from random import Random

import msgspec
import pytest

from moon.oracle.bounds import Bounds
from moon.oracle.oracle import Oracle
from moon.oracle.resynchronisation import Resynchronisation
from moon.oracle.trace_events import Role, TraceEvent
from moon.verdict import Outcome
from tests.oracle.machines import library, read
from tests.oracle.tour import lab_tour, tour
from transports.interface import Observation, ObservationKind
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld

SECONDS = 5.0
ENOUGH_S = 1.0
"""For most machines to be found: the tree is ticked five times a second."""


REACTION_NS = 90_000
"""What a machine takes to do something about what it took; less than what anything is under way for."""
_TAKEN = (ObservationKind.REQUEST_RECEIVED, ObservationKind.RESPONSE_RECEIVED)


@pytest.fixture(scope="module")
def trace() -> list[Observation]:
    """All that happens in a tour, in the order in which it is heard. The simulated nodes react at once; these
    do not.
    """
    heard: list[Observation] = []

    def hear(seen: Observation) -> None:
        if seen.kind in _TAKEN:
            seen = msgspec.structs.replace(seen, stamp_ns=seen.stamp_ns - REACTION_NS)
        heard.append(seen)

    def listen(world: SimulatedWorld) -> None:
        SimulatedTransport(world, "recorder").tap([], hear)

    tour(4, SECONDS, Conditions(delay_s=(0.0001, 0.002), tap_delay_s=(0.0, 0.01)), prepare=listen)
    return heard


@pytest.mark.parametrize("before_ns", [0, 1, REACTION_NS // 2])
def test_who_joins_just_before_a_machine_sends_something_raises_no_alarm(
    before_ns: int, trace: list[Observation]
) -> None:
    """What it sends then may be the answer to what it took a moment before."""
    system, _ = lab_tour()
    bounds = Bounds()
    joined = found = 0
    for machine in system.nodes:
        for stamp_ns in [seen.stamp_ns for seen in trace if seen.source == machine.name]:
            since_ns = stamp_ns - bounds.latency - before_ns
            if since_ns < trace[0].stamp_ns:
                continue
            oracle = Oracle(machine, system.library, machine.name, bounds, synchronised=False)
            oracle.listen(since_ns)
            for seen in trace:
                if not since_ns <= seen.stamp_ns < stamp_ns + ENOUGH_S * 1e9:
                    continue
                if oracle.concerns(seen.channel, seen.source, seen.kind):
                    said = oracle.feed(seen) + oracle.advance(seen.received_ns)
                    wrong = [v.reason for v in said if v.outcome is Outcome.VIOLATED]
                    assert not wrong, f"{machine.name}, from {since_ns}: {wrong}"
            joined += 1
            found += oracle.outcome is Outcome.CONFORMING
    assert found > joined // 2, "who is not found is never blamed"


def event(at_ms: int, role: Role) -> TraceEvent:
    """Something that happened at ``at_ms`` (ms)."""
    stamp_ns = at_ms * 1_000_000
    seen = Observation(
        stamp_ns=stamp_ns,
        received_ns=stamp_ns,
        channel="/a",
        kind=ObservationKind.MESSAGE,
        type_name="",
        data=None,
        source="a",
    )
    return TraceEvent(seen, role)


def test_of_two_gaps_the_second_does_not_make_the_first_forgotten() -> None:
    """An older one may be noticed later."""
    found = Resynchronisation(Bounds(latency=100_000_000))
    found.begin(0, 0)
    found.remember(event(500, Role.OUTPUT))
    found.begin(400_000_000, 0)  # the output is not known any more
    found.begin(300_000_000, 0)
    found.remember(event(501, Role.INPUT))
    assert found.find(550_000_000) is None


def test_nothing_is_concluded_from_before_what_is_too_old_to_be_kept() -> None:
    found = Resynchronisation(Bounds(latency=100_000_000))
    found.begin(0, 0)
    found.remember(event(1000, Role.INPUT))
    found.remember(event(1060, Role.INPUT))
    found.remember(event(1555, Role.OUTPUT))  # the first is not kept any more
    assert found.find(1_560_000_000) == 1_160_000_000 + 1  # what it took at 1060 ms is over by then


KEEPS = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" name="Probe" initial="idle">
  <datamodel><data id="numbers" type="int32[]" expr="[1, 2]"/></datamodel>
  <ros_service_server service_name="/Probe/ask" type="probe_interfaces/Ask"/>
  <ros_topic_publisher topic="/out" type="std_msgs/Int32MultiArray"/>
  <state id="idle">
    <ros_service_handle_request name="/Probe/ask">
      <ros_topic_publish name="/out"><field name="data" expr="numbers"/></ros_topic_publish>
      <assign location="numbers[0]" expr="_req.value"/>
      <ros_service_send_response name="/Probe/ask"><field name="value" expr="1"/></ros_service_send_response>
    </ros_service_handle_request>
  </state>
</scxml>
"""


def test_what_was_sent_tells_nothing_of_what_was_changed_since() -> None:
    """The array is unknown as it is published; what is seen of it is not what it is once a part is assigned."""
    oracle = Oracle(read(KEEPS), library(), "Probe", synchronised=False)
    now_ns, order = 10**18, 0
    oracle.listen(now_ns)
    ask, out = ("/Probe/ask", "probe_interfaces/srv/Ask_"), ("/out", "std_msgs/msg/Int32MultiArray")
    empty = {"dim": [], "data_offset": 0}
    for call, (asked, numbers) in enumerate([(5, [1, 2]), (7, [5, 2])]):
        now_ns += 10**9
        oracle.advance(now_ns)
        for kind, (channel, type_name), data in (
            (ObservationKind.REQUEST_RECEIVED, ask, {"value": asked}),
            (ObservationKind.MESSAGE, out, {"layout": empty, "data": numbers}),
            (ObservationKind.RESPONSE_SENT, ask, {"value": 1, "ok": False}),
        ):
            now_ns, order = now_ns + 1000, order + 1
            seen = Observation(
                stamp_ns=now_ns, received_ns=now_ns, channel=channel, kind=kind, source="Probe",
                type_name=type_name, data=data, order=order, client="somebody", call=call + 1,
            )  # fmt: skip
            oracle.feed(seen)
    now_ns += 10**9
    oracle.reported(order + 1, now_ns, now_ns)
    oracle.advance(now_ns)
    assert oracle.outcome is Outcome.CONFORMING


ASKED = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Probe" initial="idle">
  <ros_service_server service_name="/Probe/ask" type="probe_interfaces/Ask"/>
  <state id="idle">
    <ros_service_handle_request name="/Probe/ask">
      <ros_service_send_response name="/Probe/ask"><field name="value" expr="1"/></ros_service_send_response>
    </ros_service_handle_request>
  </state>
</scxml>
"""
MS = 1_000_000


def test_what_was_dropped_happened_at_its_stamp_where_the_clock_of_judges_is_behind() -> None:
    """The request is dropped; its answer, received later, is not the first thing that is known of the run."""
    oracle = Oracle(read(ASKED), library(), "Probe", synchronised=False)
    began_ns = 10**18
    oracle.listen(began_ns)

    def seen(at_ms: int, behind_ms: int, kind: ObservationKind) -> Observation:
        stamp_ns = began_ns + at_ms * MS
        return Observation(
            stamp_ns=stamp_ns,
            received_ns=stamp_ns - behind_ms * MS,
            channel="/Probe/ask",
            kind=kind,
            type_name="probe_interfaces/srv/Ask_",
            data={"value": 1, "ok": False},
            source="Probe",
            sequence=-1,
            client="somebody",
            call=1,
        )

    oracle.advance(began_ns + 500 * MS)
    oracle.feed(seen(1000, 300, ObservationKind.REQUEST_RECEIVED))
    oracle.lose(began_ns + 600 * MS, "something else was lost")
    oracle.feed(seen(1001, 300, ObservationKind.RESPONSE_SENT))
    oracle.advance(began_ns + 3000 * MS)
    assert oracle.outcome is not Outcome.VIOLATED


ANSWERS_LATER = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Probe" initial="idle">
  <ros_service_server service_name="/Probe/ask" type="probe_interfaces/Ask"/>
  <ros_service_client service_name="/Other/ask" type="probe_interfaces/Ask"/>
  <state id="idle">
    <ros_service_handle_request name="/Probe/ask">
      <ros_service_send_request name="/Other/ask"><field name="value" expr="1"/></ros_service_send_request>
    </ros_service_handle_request>
    <ros_service_handle_response name="/Other/ask">
      <ros_service_send_response name="/Probe/ask"><field name="value" expr="1"/></ros_service_send_response>
    </ros_service_handle_response>
  </state>
</scxml>
"""


def answered_later(draw: Random, answers: int) -> list[Observation]:
    """A run of the machine, which answers the oldest request of each response that it gets, so many of them."""
    heard: list[Observation] = []
    stamp_ns, asked, told = 10**18, 0, 0

    def add(kind: ObservationKind, channel: str, client: str, call: int) -> None:
        heard.append(
            Observation(
                stamp_ns=stamp_ns + len(heard),
                received_ns=stamp_ns + len(heard),
                channel=channel,
                kind=kind,
                type_name="probe_interfaces/srv/Ask_",
                data={"value": 1} if "REQUEST" in kind.name else {"value": 1, "ok": False},
                source="Probe",
                order=len(heard),
                client=client,
                call=call,
            )
        )

    while told < REQUESTS:
        stamp_ns += draw.randrange(300, 900) * MS
        if asked < REQUESTS and (asked == told or draw.random() < 0.5):
            asked += 1
            add(ObservationKind.REQUEST_RECEIVED, "/Probe/ask", "somebody", asked)
            add(ObservationKind.REQUEST_SENT, "/Other/ask", "Probe", asked)
        else:
            told += 1
            add(ObservationKind.RESPONSE_RECEIVED, "/Other/ask", "Probe", told)
            if told <= answers:
                add(ObservationKind.RESPONSE_SENT, "/Probe/ask", "somebody", told)
    return heard


REQUESTS = 12


def is_accused(heard: list[Observation], before_ns: int = 1) -> bool:
    """Whether one who joins so long before the first of ``heard``, and hears them, accuses the machine."""
    oracle = Oracle(read(ANSWERS_LATER), library(), "Probe", synchronised=False)
    since_ns = heard[0].stamp_ns - before_ns
    oracle.listen(since_ns)
    said = oracle.reported(heard[0].order, since_ns, since_ns)
    for seen in heard:
        said += oracle.advance(seen.stamp_ns - 1)
        said += oracle.feed(seen)
    end_ns = heard[-1].stamp_ns + 2000 * MS
    said += oracle.reported(heard[-1].order + 1, end_ns, end_ns)
    said += oracle.advance(end_ns)
    return any(verdict.outcome is Outcome.VIOLATED for verdict in said)


KNOWN_NS = 5_300 * MS
"""A node that is found must have been known so long, for what it never sent to count, and it be found."""


@pytest.mark.parametrize("seed", range(5))
def test_a_request_taken_since_is_answered_though_older_ones_may_wait(seed: int) -> None:
    """Where a machine answers as something else happens: an older request than all that are known comes first."""
    heard = answered_later(Random(seed), REQUESTS)
    for cut in range(len(heard)):
        assert not is_accused(heard[cut:]), cut
    for answers in range(0, REQUESTS, 4):
        broken = answered_later(Random(seed), answers)
        asked = [s.stamp_ns for s in broken if s.kind is ObservationKind.REQUEST_RECEIVED]
        for cut, seen in enumerate(broken):
            if seen.stamp_ns in asked and seen.stamp_ns + KNOWN_NS < asked[-1]:
                assert is_accused(broken[cut:], 250 * MS), (answers, cut)


TICKING = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Probe" initial="idle">
  <ros_topic_publisher topic="/out" type="std_msgs/Int32"/>
  <ros_time_rate name="often" rate_hz="2"/>
  <state id="idle">
    <ros_rate_callback name="often">
      <ros_topic_publish name="/out"><field name="data" expr="1"/></ros_topic_publish>
    </ros_rate_callback>
  </state>
</scxml>
"""


@pytest.mark.parametrize("answers", [True, False])
def test_a_node_that_hung_before_is_found_once_it_says_that_it_did_nothing(answers: bool) -> None:
    """Of one that cannot be asked, silence tells nothing: perhaps nothing that it does is reported."""
    oracle = Oracle(read(TICKING), library(), "Probe", synchronised=False)
    now_ns = 10**18
    oracle.listen(now_ns)
    said = []
    for turn in range(400):
        if answers and turn % 25 == 0:
            said += oracle.reported(17, now_ns, now_ns)
        now_ns += 20 * MS
        said += oracle.advance(now_ns)
    accused = [verdict for verdict in said if verdict.outcome is Outcome.VIOLATED]
    assert bool(accused) is answers
    assert all("message on /out" in verdict.reason for verdict in accused)


@pytest.mark.parametrize("answers", [True, False])
def test_a_node_that_takes_no_request_is_found_once_it_says_that_it_did_nothing(
    answers: bool,
) -> None:
    oracle = Oracle(read(ASKED), library(), "Probe", synchronised=False)
    now_ns = 10**18
    oracle.listen(now_ns)
    said = []
    for turn in range(600):
        if answers and turn % 25 == 0:
            said += oracle.reported(17, now_ns, now_ns)
        now_ns += 20 * MS
        if turn % 50 == 49:
            said += oracle.feed(
                Observation(
                    stamp_ns=now_ns,
                    received_ns=now_ns,
                    channel="/Probe/ask",
                    kind=ObservationKind.REQUEST_SENT,
                    type_name="probe_interfaces/srv/Ask_",
                    data={"value": 1},
                    source="somebody",
                    client="somebody",
                    call=turn // 50 + 1,
                )
            )
        said += oracle.advance(now_ns)
    assert any(verdict.outcome is Outcome.VIOLATED for verdict in said) is answers
