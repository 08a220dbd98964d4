"""A machine whose node was never heard: it may start at any time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from moon.oracle.bounds import Bounds
from moon.oracle.oracle import Oracle
from moon.verdict import Outcome
from tests.monitor import hand_driven
from tests.monitor.hand_driven import HandDriven
from tests.oracle.machines import library, read
from transports.interface import Observation, ObservationKind

MS = 1_000_000
T0 = 10**18
ONCE = """\
<scxml xmlns="http://www.w3.org/2005/07/scxml" name="Once" initial="on">
  <ros_topic_subscriber topic="/beat" type="std_msgs/Int32"/>
  <ros_topic_subscriber topic="/again" type="std_msgs/Int32"/>
  <ros_topic_publisher topic="/told" type="std_msgs/Int32"/>
  <datamodel><data id="heard" type="int32" expr="0"/></datamodel>
  <state id="on">
    <ros_topic_callback name="/beat" target="told">
      <assign location="heard" expr="_msg.data"/>
      <ros_topic_publish name="/told"><field name="data" expr="heard"/></ros_topic_publish>
    </ros_topic_callback>
  </state>
  <state id="told"><ros_topic_callback name="/again" target="on"/></state>
</scxml>
"""


def message(channel: str, source: str, value: int, at_ms: int, number: int) -> Observation:
    stamp_ns = T0 + at_ms * MS
    data: Any = {"data": value}
    return Observation(
        stamp_ns=stamp_ns,
        received_ns=stamp_ns + MS,
        channel=channel,
        kind=ObservationKind.MESSAGE,
        type_name="std_msgs/msg/Int32",
        data=data,
        source=source,
        sequence=number,
    )


@pytest.mark.parametrize("starts_ms", [0, 50, 1000, 3000, 9000])
def test_what_was_sent_before_a_node_did_something_tells_nothing(starts_ms: int) -> None:
    oracle = Oracle(read(ONCE), library(), "Once", Bounds(), synchronised=False)
    heard = [message("/beat", "Beat", n, 100 * n, n) for n in range(140)]
    first = 1 + starts_ms // 100
    heard.append(message("/told", "Once", first, 100 * first + 2, 0))
    later = first + 20
    heard.append(message("/again", "Beat", 0, 100 * later - 50, 0))
    heard.append(message("/told", "Once", later, 100 * later + 2, 1))
    said = []
    for seen in sorted(heard, key=lambda it: it.stamp_ns):
        said += oracle.feed(seen) + oracle.advance(seen.received_ns)
    assert Outcome.VIOLATED not in {verdict.outcome for verdict in said}


@pytest.mark.parametrize("is_announced", [False, True])
@pytest.mark.parametrize("starts_ms", [500, 3000, 9000])
def test_neither_does_it_to_a_monitor_that_learns_who_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, starts_ms: int, is_announced: bool
) -> None:
    text = ONCE.replace("Once", "Level").replace("/beat", "/battery").replace("std_msgs/", "t/")
    monkeypatch.setattr(hand_driven, "LEVEL", text.replace("t/Int32", "t/Level"))
    hand = HandDriven(tmp_path)
    told = again = 0

    def say(topic: str, value: int, source: str) -> None:
        hand.hear(topic, ObservationKind.MESSAGE, "t/msg/Level", {"data": value}, source)

    for number in range(140):
        now_ms = 100 * number
        if is_announced and now_ms == starts_ms - 100:
            hand.node("Level", True)
        if now_ms > starts_ms and told and number % 20 == 0:
            say("/again", again, "Battery")
            again += 1
        hand.pass_time(50)
        hand.message(number)
        if now_ms >= starts_ms and told <= again:
            say("/told", number, "Level")
            told += 1
        hand.pass_time(50)
    assert told > 2
    assert hand.watch.violations == 0
