"""Which fields of messages a monitor reads: what its properties name, and all of what concerns models."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from moon.monitor.subject import Monitored, Subject, read_subject
from moon.oracle.bounds import Bounds

MODEL = """\
<ascxml version="1.0" name="Reader" initial="on">
  <datamodel><data id="wide" type="int32" expr="0"/></datamodel>
  <ros_topic_subscriber topic="/taken" type="my_pkg/Big"/>
  <ros_topic_publisher topic="/wide" type="std_msgs/Int32"/>
  <state id="on">
    <ros_topic_callback name="/taken" target="on" cond="_msg.width &gt; 3">
      <ros_topic_publish name="/wide"><field name="data" expr="wide"/></ros_topic_publish>
    </ros_topic_callback>
  </state>
</ascxml>
"""
BIG = "int32 width\nint32 height\nuint8[] data\nPart part\n"


def monitored(folder: Path, ports: str, formula: str) -> Monitored:
    messages = folder / "my_pkg" / "msg"
    messages.mkdir(parents=True)
    (messages / "Big.msg").write_text(BIG)
    (messages / "Part.msg").write_text("int32 n\nfloat64[] values\n")
    model = folder / "reader.ascxml"
    model.write_text(MODEL)
    file = folder / "p.yaml"
    file.write_text(
        f"ports: {{{ports}}}\nproperties:\n  - {{id: A, pattern: absence, of: {formula}}}\n"
    )
    return read_subject(Subject((model,), (file,), (folder,), (), (), Bounds()))


@pytest.mark.parametrize(
    ("ports", "formula", "read"),
    [
        ("h: {topic: /big, type: my_pkg/msg/Big, field: height}", "h > 3", {("height",)}),
        ("h: {topic: /big, type: my_pkg/msg/Big, field: height}, w: {topic: /big, type: my_pkg/msg/Big, field: width}", "h > w", {("height",), ("width",)}),
        ("n: {topic: /big, type: my_pkg/msg/Big, field: part.n}", "n == 1", {("part", "n")}),
        ("h: {topic: /big, type: my_pkg/msg/Big, field: height}, d: {topic: /wide, field: data}", "h > 3 && d > 1", {("height",)}),
        ("d: {topic: /wide, field: data}", "d > 1", set()),
    ],
)  # fmt: skip
def test_properties_read_what_they_name(
    tmp_path: Path, ports: str, formula: str, read: set[Any]
) -> None:
    fields = monitored(tmp_path, ports, formula).fields_read
    assert fields is not None
    assert fields("/big") == read
    assert fields("/of_nobody") == frozenset()


def test_of_what_concerns_models_all_is_read(tmp_path: Path) -> None:
    # the node takes nothing of which a part is of another type: who judges it has to know
    fields = monitored(tmp_path, "w: {topic: /taken, field: width}", "w > 3").fields_read
    assert fields is not None
    for channel in ("/taken", "/wide", "/policy/ticks"):
        assert fields(channel) is None
