"""When a machine started is known from its node, and the news may come late."""

from __future__ import annotations

import pytest

from moon.oracle.bounds import FOREVER, Bounds
from moon.oracle.confirmation import Losses
from moon.oracle.oracle import Oracle
from moon.oracle.shared import Shared
from moon.verdict import Outcome
from tests.oracle.machines import library, read
from transports.interface import NAMELESS, Observation, ObservationKind

MS = 1_000_000
BEGAN = 10**18
FOUND = BEGAN + 2_000 * MS
DELAY_MS = 6_000

LATER = f"""
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" datamodel="ecmascript" name="Probe"
    initial="waiting">
  <ros_topic_publisher topic="/out" type="std_msgs/Int32"/>
  <state id="waiting"><transition after="{DELAY_MS}ms" target="done"/></state>
  <state id="done">
    <onentry><ros_topic_publish name="/out"><field name="data" expr="1"/></ros_topic_publish></onentry>
  </state>
</scxml>
"""


@pytest.mark.parametrize(
    ("at_ms", "earliest_ns", "expected"),
    [
        (DELAY_MS, BEGAN, Outcome.CONFORMING),
        (DELAY_MS + 1_900, BEGAN, Outcome.CONFORMING),
        (DELAY_MS, FOREVER, Outcome.VIOLATED),
        (DELAY_MS - 1_000, BEGAN, Outcome.VIOLATED),
    ],
)
def test_a_delay_runs_since_the_node_began_or_since_it_was_found(
    at_ms: int, earliest_ns: int, expected: Outcome
) -> None:
    assert _outcome(LATER, earliest_ns, at_ms) is expected


def _outcome(model: str, earliest_ns: int, at_ms: int) -> Outcome:
    """Of a machine that is found 2 s after it began, and sends its first message after ``at_ms``."""
    losses = Losses(possible=False)
    oracle = Oracle(
        read(model), library(), bounds=Bounds(), synchronised=False, shared=Shared(losses=losses)
    )
    oracle.start(FOUND, earliest_ns=earliest_ns)
    stamp_ns = BEGAN + at_ms * MS
    sent = Observation(
        stamp_ns=stamp_ns, received_ns=stamp_ns + MS, channel="/out", kind=ObservationKind.MESSAGE,
        type_name="std_msgs/msg/Int32", data={"data": 1}, source="Probe", sequence=0, order=0,
    )  # fmt: skip
    oracle.feed(sent)
    oracle.advance(stamp_ns + 300 * MS)
    return oracle.outcome


RINGS = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" datamodel="ecmascript" name="Probe"
    initial="waiting">
  <ros_topic_publisher topic="/out" type="std_msgs/Int32"/>
  <ros_time_rate name="beat" rate_hz="0.625"/>
  <state id="waiting"><ros_rate_callback name="beat" target="ready"/></state>
  <state id="ready">
    <ros_rate_callback name="beat">
      <ros_topic_publish name="/out"><field name="data" expr="1"/></ros_topic_publish>
    </ros_rate_callback>
  </state>
</scxml>
"""
"""Its timer rings every 1.6 s: it does something the second time."""


@pytest.mark.parametrize(
    ("earliest_ns", "expected"), [(BEGAN, Outcome.CONFORMING), (FOREVER, Outcome.VIOLATED)]
)
def test_a_timer_may_have_rung_before_its_node_was_found(
    earliest_ns: int, expected: Outcome
) -> None:
    assert _outcome(RINGS, earliest_ns, 3_200) is expected


CALLS_FIRST = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Probe" initial="idle">
  <ros_service_server service_name="/Probe/ask" type="probe_interfaces/Ask"/>
  <ros_service_client service_name="/Other/ask" type="probe_interfaces/Ask"/>
  <state id="idle">
    <ros_service_handle_request name="/Probe/ask" target="asking">
      <ros_service_send_request name="/Other/ask"/>
      <ros_service_send_response name="/Probe/ask"/>
    </ros_service_handle_request>
  </state>
  <state id="asking">
    <ros_service_handle_request name="/Probe/ask">
      <ros_service_send_response name="/Probe/ask"/>
    </ros_service_handle_request>
    <ros_service_handle_response name="/Other/ask" target="idle"/>
  </state>
</scxml>
"""


@pytest.mark.parametrize("is_linked", [False, True])
def test_what_is_expected_where_nothing_was_received_yet_may_have_been_missed(
    is_linked: bool,
) -> None:
    """The node's first call and what it did then were before the tap was linked to what reports it."""
    oracle = Oracle(read(CALLS_FIRST), library(), bounds=Bounds(), synchronised=False)
    oracle.start(BEGAN)
    oracle.listen(BEGAN if is_linked else BEGAN + 5_000 * MS)
    first_ns = BEGAN + 3_000 * MS
    said = []
    for place, kind in enumerate((ObservationKind.REQUEST_RECEIVED, ObservationKind.RESPONSE_SENT)):
        seen = Observation(
            stamp_ns=first_ns + place * MS, received_ns=first_ns + place * MS, channel="/Probe/ask",
            kind=kind, type_name="", data={"value": 0}, source="Probe", client="policy", call=2,
            sequence=place,
        )  # fmt: skip
        said += oracle.feed(seen)
    said += oracle.advance(first_ns + 300 * MS)
    assert (Outcome.VIOLATED in [verdict.outcome for verdict in said]) == is_linked


@pytest.mark.parametrize("after_ms", [-1, 2])
def test_what_is_received_of_a_channel_says_nothing_of_what_was_there_before(after_ms: int) -> None:
    """The tap is linked to the channel of the node's call after that call, and before what is said of it."""
    oracle = Oracle(read(CALLS_FIRST), library(), bounds=Bounds(), synchronised=False)
    oracle.start(BEGAN)
    oracle.listen(BEGAN + 5_000 * MS)
    first_ns = BEGAN + 3_000 * MS
    said = []
    for at_ms, channel, kind, number in sorted(
        [
            (0, "/Probe/ask", ObservationKind.REQUEST_RECEIVED, 0),
            (1, "/Probe/ask", ObservationKind.RESPONSE_SENT, 1),
            (after_ms, "/Other/ask", ObservationKind.RESPONSE_RECEIVED, 0),
        ]
    ):
        stamp_ns = first_ns + at_ms * MS
        seen = Observation(
            stamp_ns=stamp_ns, received_ns=stamp_ns, channel=channel, kind=kind, type_name="",
            data={"value": 0}, source="Probe", client="Probe" if channel == "/Other/ask" else "policy",
            call=1, sequence=number,
        )  # fmt: skip
        said += oracle.feed(seen)
    said += oracle.advance(first_ns + 300 * MS)
    assert (Outcome.VIOLATED in [verdict.outcome for verdict in said]) == (after_ms < 0)


ANSWERS_LATER = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Probe" initial="idle">
  <ros_service_server service_name="/Probe/ask" type="probe_interfaces/Ask"/>
  <ros_service_client service_name="/Other/ask" type="probe_interfaces/Ask"/>
  <state id="idle">
    <ros_service_handle_request name="/Probe/ask"><ros_service_send_request name="/Other/ask"/></ros_service_handle_request>
    <ros_service_handle_response name="/Other/ask"><ros_service_send_response name="/Probe/ask"/></ros_service_handle_response>
  </state>
</scxml>
"""


@pytest.mark.parametrize(
    ("client", "is_linked", "is_violated"),
    [
        ("Probe", True, False),
        (f"{NAMELESS}00ff", True, False),
        ("", False, False),
        ("", True, True),
    ],
)
def test_an_answer_rests_on_another_that_its_node_got_under_whatever_name(
    client: str, is_linked: bool, is_violated: bool
) -> None:
    """Without ``client`` nothing is received of the node's own call: the tap may not be linked to it yet."""
    oracle = Oracle(read(ANSWERS_LATER), library(), bounds=Bounds(), synchronised=False)
    oracle.start(BEGAN)
    oracle.listen(BEGAN if is_linked else BEGAN + 5_000 * MS)
    at_ns = BEGAN + 3_000 * MS
    said = []
    asked, answered = ObservationKind.REQUEST_RECEIVED, ObservationKind.RESPONSE_SENT
    sent, got = ObservationKind.REQUEST_SENT, ObservationKind.RESPONSE_RECEIVED
    for place, (channel, kind, who) in enumerate(
        [
            ("/Probe/ask", asked, "policy"),
            *([("/Other/ask", kind, client) for kind in (sent, got)] if client else ()),
            ("/Probe/ask", answered, "policy"),
        ]
    ):
        at_ns += MS
        seen = Observation(
            stamp_ns=at_ns, received_ns=at_ns, channel=channel, kind=kind, type_name="",
            data={"value": 0}, source="Probe", client=who, call=2,
            sequence=place % 2 if channel == "/Other/ask" else bool(place),
        )  # fmt: skip
        said += oracle.feed(seen)
    said += oracle.advance(at_ns + 300 * MS)
    assert (Outcome.VIOLATED in [verdict.outcome for verdict in said]) == is_violated
