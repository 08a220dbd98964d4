"""A machine whose node was never heard: it may start at any time."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.monitor import hand_driven
from tests.monitor.hand_driven import HandDriven
from transports.interface import ObservationKind

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


class Finding(HandDriven):
    """Of a middleware that says which nodes are there."""

    finds_nodes = True


@pytest.mark.parametrize("is_announced", [False, True])
@pytest.mark.parametrize("starts_ms", [500, 3000, 9000])
def test_what_was_sent_before_a_node_was_there_tells_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, starts_ms: int, is_announced: bool
) -> None:
    text = ONCE.replace("Once", "Level").replace("/beat", "/battery").replace("std_msgs/", "t/")
    monkeypatch.setattr(hand_driven, "LEVEL", text.replace("t/Int32", "t/Level"))
    hand = Finding(tmp_path)
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
