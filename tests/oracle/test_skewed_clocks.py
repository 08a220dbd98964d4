"""Who sends to a machine may stamp by another clock: what it sent may have been there before its stamp."""

from __future__ import annotations

from random import Random

import pytest

from moon.oracle.bounds import Bounds
from moon.oracle.oracle import Oracle
from moon.verdict import Outcome, Verdict
from tests.oracle.machines import library, read
from transports.interface import Observation, ObservationKind

BEGAN_NS, NS = 10**18, 10**9
SKEW_S, LATENCY_S = 0.06, 0.2
ECHO = """
<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Probe" initial="s">
  <ros_topic_subscriber name="in" topic="/in" type="std_msgs/Int32"/>
  <ros_topic_publisher name="out" topic="/out" type="std_msgs/Int32"/>
  <ros_time_rate name="beat" rate_hz="4"/>
  <state id="s">
    <ros_rate_callback name="beat">
      <ros_topic_publish name="out"><field name="data" expr="-1"/></ros_topic_publish>
    </ros_rate_callback>
    <ros_topic_callback name="in">
      <ros_topic_publish name="out"><field name="data" expr="{answer}"/></ros_topic_publish>
    </ros_topic_callback>
  </state>
</scxml>
"""


def observation(stamp_s: float, received_s: float, channel: str, data: int) -> Observation:
    return Observation(
        stamp_ns=BEGAN_NS + round(stamp_s * NS),
        received_ns=BEGAN_NS + round(received_s * NS),
        channel=channel,
        kind=ObservationKind.MESSAGE,
        type_name="std_msgs/msg/Int32",
        data={"data": data},
        source="somebody" if channel == "/in" else "Probe",
        sequence=-1,
    )


def run(draw: Random, ahead_s: float, busy: bool) -> list[Observation]:
    """Three seconds of the machine, to whose clock that of the others is ahead by ``ahead_s``.

    ``busy``: what it sends is out just within the latency bound.
    """
    after_s = (0.19, 0.199) if busy else (0.0, 0.01)
    sent = [(at_s, -1) for at_s in (n * 0.25 for n in range(1, 13))]
    seen = []
    at_s = 0.3
    for number in range(8):
        seen.append(observation(at_s + ahead_s, at_s + draw.uniform(0.0, 0.001), "/in", number))
        sent.append((at_s + draw.uniform(0.0005, 0.002), number))
        at_s += draw.uniform(0.26, 0.34)
    last_s = 0.0
    for taken_s, data in sorted(sent):
        last_s = max(last_s + 1e-6, taken_s + draw.uniform(*after_s) * (not last_s > taken_s))
        seen.append(observation(last_s, last_s + draw.uniform(0.0, 0.001), "/out", data))
    return sorted(seen, key=lambda one: one.received_ns)


def is_violated(seen: list[Observation], joins_s: float = 0.0, answer: str = "_msg.data") -> bool:
    """Whether who listens from ``joins_s`` on says so."""
    bounds = Bounds(skew=round(SKEW_S * NS), latency=round(LATENCY_S * NS))
    machine = read(ECHO.replace("{answer}", answer))
    oracle = Oracle(machine, library(), "Probe", bounds, synchronised=not joins_s)
    now_ns = BEGAN_NS + round(joins_s * NS)
    if joins_s:
        oracle.listen(now_ns)
    else:
        oracle.start(BEGAN_NS, whole=True)
    said: list[Verdict] = []
    for one in seen:
        if one.received_ns < now_ns:
            continue
        while now_ns + 10**7 < one.received_ns:  # as a monitor does that looks at its clock
            now_ns += 10**7
            said += oracle.advance(now_ns)
        said += oracle.feed(one)
    said += oracle.advance(BEGAN_NS + 3 * NS)
    return any(verdict.outcome is Outcome.VIOLATED for verdict in said)


@pytest.mark.parametrize("busy", [False, True], ids=["at once", "late"])
@pytest.mark.parametrize("ahead_s", [-0.05, -0.02, 0.0, 0.02, 0.05])
@pytest.mark.parametrize("joins_s", [0.0, 0.29, 0.5, 0.8, 1.01])
def test_nobody_is_accused_by_a_clock_within_the_skew(
    joins_s: float, ahead_s: float, busy: bool
) -> None:
    for seed in range(15):
        seen = run(Random(seed), ahead_s, busy)
        assert not is_violated(seen, joins_s), seed


@pytest.mark.parametrize("ahead_s", [-0.05, 0.05])
def test_a_wrong_answer_is_found(ahead_s: float) -> None:
    assert is_violated(run(Random(1), ahead_s, False), answer="_msg.data + 1")
