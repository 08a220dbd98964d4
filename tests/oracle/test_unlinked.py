"""What is published before its subscriber is linked may reach it or not: a machine is accused of neither."""

from __future__ import annotations

from random import Random

import pytest
from msgspec.structs import replace

from moon.feed.nodes import Nodes
from moon.oracle.bounds import Bounds
from moon.oracle.confirmation import Losses
from moon.oracle.oracle import Oracle
from moon.oracle.shared import Shared
from moon.verdict import Outcome
from tests.oracle.agreement import accusations, bounds_of
from tests.oracle.machines import NAME, library, read
from tests.oracle.strategies import Case, case
from transports.interface import Observation, ObservationKind

pytestmark = pytest.mark.slow

MS = 1_000_000
CASES = 400
BLOCKS = 4
LINKED_NS = 5_000 * MS


def _missed(found: Case, draw: Random) -> list[Observation]:
    """Messages that the machine did not get, before the first that it got of the same source and channel."""
    firsts: dict[tuple[str, str], Observation] = {}
    for seen in found.trace.observations:
        if seen.kind is ObservationKind.MESSAGE and seen.source != NAME:
            firsts.setdefault((seen.source, seen.channel), seen)
    return [
        replace(first, stamp_ns=draw.randint(0, first.stamp_ns - 1), data={"data": draw.randint(0, 3)})
        for first in firsts.values()
        for _ in range(draw.choice((0, 1, 1, 2)))
    ]  # fmt: skip


def _accused(seed: int) -> str:
    draw = Random(seed)
    found = case(draw, perturb=False)
    shared = Shared(losses=Losses(possible=False))
    oracle = Oracle(found.machine, library(), bounds=bounds_of(found), shared=shared)
    oracle.start(0, whole=True)
    oracle.listen(LINKED_NS)
    seen = [*found.trace.observations, *_missed(found, draw)]
    step_ns = draw.choice((3, 20, 90)) * MS
    received = [
        replace(item, sequence=-1, received_ns=item.stamp_ns)
        for item in sorted(seen, key=lambda item: item.stamp_ns)
    ]
    wrong = accusations(oracle, received, step_ns, found.trace.end_ns + found.latency_ns)
    return f"seed {seed}: {wrong[0]}\n{found}" if wrong else ""


@pytest.mark.parametrize("block", range(BLOCKS))
def test_messages_of_before_the_subscriber_is_linked_never_accuse_it(block: int) -> None:
    size = CASES // BLOCKS
    wrong = [text for seed in range(block * size, (block + 1) * size) if (text := _accused(seed))]
    assert not wrong, f"{len(wrong)} of {size}\n{wrong[0]}"


DOOR = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Probe" initial="waiting">
  <ros_topic_subscriber topic="/open" type="std_msgs/Bool"/>
  <ros_service_server service_name="/Probe/ask" type="probe_interfaces/Ask"/>
  <datamodel><data id="is_open" type="bool" expr="false"/></datamodel>
  <state id="waiting">
    <ros_topic_callback name="/open"><assign location="is_open" expr="_msg.data"/></ros_topic_callback>
    <ros_service_handle_request name="/Probe/ask">
      <ros_service_send_response name="/Probe/ask"><field name="ok" expr="is_open"/></ros_service_send_response>
    </ros_service_handle_request>
  </state>
</scxml>
"""


@pytest.mark.parametrize("linked_ns", [0, LINKED_NS])
@pytest.mark.parametrize("answers", [[True], [False], [False, True], [True, False]])
def test_a_machine_that_may_not_be_linked_yet_has_its_messages_or_has_none(
    answers: list[bool], linked_ns: int
) -> None:
    """Messages twice a second that all say the same, each settled long before the next: until the subscriber
    is linked for sure, any may be the first that it gets.
    """
    oracle = Oracle(
        read(DOOR), library(), bounds=Bounds(), shared=Shared(losses=Losses(possible=False))
    )
    oracle.start(0)
    oracle.listen(linked_ns)
    seen = []
    for number, answer in enumerate(answers):
        at_ms, call = 1_000 * (number + 1), number + 1
        seen += [_seen(at_ms + later, MESSAGE, "/open", {"data": True}) for later in (0, 500)]
        seen.append(_seen(at_ms + 960, ASKED, "/Probe/ask", {"value": 0}, call))
        response = {"value": 0, "ok": answer}
        seen.append(_seen(at_ms + 961, ANSWERED, "/Probe/ask", response, call))
    verdicts = []
    for item in seen:
        verdicts += oracle.advance(item.stamp_ns)
        verdicts += oracle.feed(item)
    verdicts += oracle.advance(seen[-1].stamp_ns + 450 * MS)
    is_wrong = any(verdict.outcome is Outcome.VIOLATED for verdict in verdicts)
    # who has it once keeps it; who is linked has all
    assert is_wrong == (answers == [True, False] or (not linked_ns and False in answers))


@pytest.mark.parametrize(
    ("came_ms", "said_ms", "is_wrong"),
    [(0, 1_000, False), (0, 6_000, True), (3_000, 6_000, False), (3_000, 9_000, True)],
)
def test_a_publisher_that_came_of_late_may_not_be_linked_yet(
    came_ms: int, said_ms: int, is_wrong: bool
) -> None:
    """``came_ms``: when it came last, of which the monitor hears; the machine has none of its messages."""
    oracle = Oracle(
        read(DOOR),
        library(),
        bounds=Bounds(),
        shared=Shared(losses=Losses(possible=False), sources=Nodes(Bounds().latency)),
    )
    oracle.start(0, whole=True)
    oracle.sender_changed("Door", came_ms * MS)
    seen = [
        _seen(said_ms, MESSAGE, "/open", {"data": True}),
        _seen(said_ms + 960, ASKED, "/Probe/ask", {"value": 0}, 1),
        _seen(said_ms + 961, ANSWERED, "/Probe/ask", {"value": 0, "ok": False}, 1),
    ]
    verdicts = [verdict for item in seen for verdict in oracle.feed(item)]
    verdicts += oracle.advance(seen[-1].stamp_ns + 450 * MS)
    assert any(verdict.outcome is Outcome.VIOLATED for verdict in verdicts) == is_wrong


MESSAGE, ASKED, ANSWERED = (
    ObservationKind.MESSAGE,
    ObservationKind.REQUEST_RECEIVED,
    ObservationKind.RESPONSE_SENT,
)


def _seen(
    at_ms: int, kind: ObservationKind, channel: str, data: object, call: int = 0
) -> Observation:
    return Observation(
        stamp_ns=at_ms * MS,
        received_ns=(at_ms + 1) * MS,
        channel=channel,
        kind=kind,
        type_name="",
        data=data,
        source="Probe" if call else "Door",
        client="policy" if call else "",
        call=call,
        sequence=-1,
    )
