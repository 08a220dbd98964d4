"""Which fields of messages a monitor reads: what its models and its properties name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from m2c.diagnostics import DiagnosticLog
from m2c.model.interfaces import InterfaceLibrary
from moon.feed.counts import Counts
from moon.feed.reception import Reception
from moon.monitor.subject import Monitored, Subject, read_subject
from moon.oracle.bounds import Bounds
from transports.fields_read import UNREAD_KEPT
from transports.interface import Observation, ObservationKind

MODEL = """\
<ascxml version="1.0" name="Reader" initial="on">
  <datamodel>
    <data id="whole" type="my_pkg/Big"/><data id="part" type="my_pkg/Part"/>
    <data id="wide" type="int32" expr="0"/><data id="kept" type="uint8[]" expr="[]"/>
  </datamodel>
  <ros_topic_subscriber topic="/big" type="my_pkg/Big"/>
  <ros_topic_publisher topic="/wide" type="std_msgs/Int32"/>
  <state id="on">
    <ros_topic_callback name="/big" target="on" cond="{cond}">
      {body}
      <ros_topic_publish name="/wide"><field name="data" expr="wide"/></ros_topic_publish>
    </ros_topic_callback>
  </state>
</ascxml>
"""
BIG = "int32 width\nint32 height\nuint8[] data\nuint8[1000] fixed\nPart part\n"
NOTHING: Any = frozenset()


def monitored(folder: Path, cond: str = "true", body: str = "", properties: str = "") -> Monitored:
    messages = folder / "my_pkg" / "msg"
    messages.mkdir(parents=True)
    (messages / "Big.msg").write_text(BIG)
    (messages / "Part.msg").write_text("int32 n\nfloat64[] values\n")
    model = folder / "reader.ascxml"
    model.write_text(MODEL.format(cond=cond, body=body))
    file = folder / "p.yaml"
    file.write_text(properties or "properties: []\n")
    files = (file,) if properties else ()
    return read_subject(Subject((model,), files, (folder,), (), (), Bounds()))


@pytest.mark.parametrize(
    ("cond", "body", "read"),
    [
        ("true", "", set()),
        ("_msg.width &gt; 3", "", {("width",)}),
        ("_event.data.width &gt; 3", "", {("width",)}),
        ("_msg.part.n == 1", '<assign location="wide" expr="_msg.height"/>', {("part", "n"), ("height",)}),
        ("_msg.data.length == 1", "", {("data",)}),
        ("_msg.part.values[_msg.width] == 1", "", {("part", "values"), ("width",)}),
        ("true", '<assign location="kept" expr="_msg.data"/>', {("data",)}),
        ("true", '<foreach array="_msg.data" item="wide"></foreach>', {("data",)}),
        ("true", '<assign location="part" expr="_msg.part"/>', {("part",)}),
        ("true", '<assign location="whole" expr="_msg"/>', None),
        ("true", '<assign location="whole" expr="_event.data"/>', None),
        ("true", '<log expr="_msg"/>', None),
        ("true", '<if cond="_msg.width == 1"><log expr="_msg.part.n"/></if>', {("width",), ("part", "n")}),
    ],
)  # fmt: skip
def test_a_model_reads_what_it_names(tmp_path: Path, cond: str, body: str, read: set[Any] | None):
    fields = monitored(tmp_path, cond, body).fields_read
    assert fields is not None
    assert fields("/big") == read
    assert fields("/wide") is None  # what a machine sends is compared as a whole
    assert fields("/policy/ticks") is None


def test_properties_read_beside_models(tmp_path: Path):
    text = "ports: {h: {topic: /big, field: height}, d: {topic: /wide, field: data}}\n"
    text += "properties:\n  - {id: A, pattern: absence, of: h > 3 && d > 1}\n"
    fields = monitored(tmp_path, "_msg.width == 1", "", text).fields_read
    assert fields is not None
    assert fields("/big") == {("width",), ("height",)}
    assert fields("/wide") is None
    assert fields("/of_nobody") == NOTHING


@pytest.mark.parametrize(
    ("change", "is_taken"),
    [
        ({}, True),
        ({"fixed": [1] * UNREAD_KEPT, "data": [1] * UNREAD_KEPT}, True),
        ({"fixed": [1] * 999}, False),
        ({"fixed": [1] * (UNREAD_KEPT - 1)}, False),
        ({"fixed": [1] * (UNREAD_KEPT - 1) + [300]}, False),
        ({"data": ["x"]}, False),
        ({"width": "x"}, False),
        ({"other": 1}, False),
    ],
)
def test_what_is_there_is_of_the_type_and_as_long_as_it_may_be(
    tmp_path: Path, change: dict[str, Any], is_taken: bool
):
    subject = monitored(tmp_path, "_msg.width == 1")
    library = InterfaceLibrary.load([tmp_path], DiagnosticLog())
    part = {"n": 0, "values": []}
    data = {"width": 1, "height": 1, "data": [1] * 2000, "fixed": [1] * 1000, "part": part}
    counts = Counts()
    reception = Reception(subject.machines, library, 10**9, counts, subject.fields_read)
    seen = Observation(
        stamp_ns=1,
        received_ns=1,
        channel="/big",
        kind=ObservationKind.MESSAGE,
        type_name="my_pkg/msg/Big",
        data=data | change,
        source="n",
    )
    assert (reception.judge(seen, 1) != "") == is_taken
    assert counts.mistyped == (not is_taken)
