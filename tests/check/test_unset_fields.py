"""What is said of fields that nothing sets: what is sent as zero, and nothing else."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from m2c.cli import main

DEFINITIONS = {
    "msg/Mixed.msg": 'int32 a 5\nint32 zero\nint32[] c [1, 2]\nstring s "x"\n',
    "msg/Full.msg": "int32 a 5\nbool b true\nfloat64[2] f [1.0, 2.0]\n",
    "msg/Plain.msg": "int32 x\nint32 y\n",
    "msg/Holds.msg": "Mixed m\nFull f\nPlain p\nint32 z\n",
    "msg/Arrays.msg": "Full[2] full\nMixed[2] mixed\nPlain[2] plain\nFull[] any\nFull[<=3] some\n",
    "msg/Deep.msg": "Holds h\n",
    "srv/Ask.srv": "Mixed m\nint32 q 3\nint32 r\n---\nint32 res 4\nbool good\n",
    "action/Go.action": "int32 g 3\nint32 h\n---\nint32 r\n---\nint32 f\n",
}
MODEL = """\
<ascxml version="1.0" name="M" initial="a">
  <ros_topic_publisher name="t" topic="/t" type="my_pkg/{type}"/>
  <ros_service_client service_name="/s" type="my_pkg/Ask"/>
  <ros_action_client name="g" action_name="/g" type="my_pkg/Go"/>
  <state id="a"><onentry>{sends}</onentry></state>
</ascxml>
"""


def _publish(*fields: str) -> str:
    inner = "".join(f'<field name="{name}" expr="1"/>' for name in fields)
    return f'<ros_topic_publish name="t">{inner}</ros_topic_publish>'


def _unset(folder: Path, kind: str, sends: str) -> list[list[str]]:
    """For each warning the fields that it names."""
    for name, text in DEFINITIONS.items():
        path = folder / "my_pkg" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    model = folder / "m.ascxml"
    model.write_text(MODEL.format(type=kind, sends=sends))
    said = CliRunner().invoke(main, ["check", str(model), "--interfaces", str(folder)]).output
    assert ": error: " not in said, said
    lines = [line for line in said.splitlines() if "[unset-output-field]" in line]
    return [re.findall("`([^`]*)`", line.partition(" of my_pkg/")[0]) for line in lines]


@pytest.mark.parametrize(
    ("kind", "sends", "named"),
    [
        ("Mixed", _publish(), [["zero"]]),
        ("Mixed", _publish("zero"), []),
        ("Full", _publish(), []),
        ("Holds", _publish(), [["m.zero", "p", "z"]]),
        ("Holds", _publish("z", "m.a"), [["p"]]),
        ("Arrays", _publish(), [["mixed[].zero", "plain", "any", "some"]]),
        ("Deep", _publish(), [["h.m.zero", "h.p", "h.z"]]),
        ("Mixed", '<ros_service_send_request name="/s"/>', [["m.zero", "r"]]),
        ("Mixed", '<ros_action_send_goal name="g"/>', [["h"]]),
        (
            "Mixed",
            f'<if cond="1 == 1">{_publish("zero")}<else/>{_publish("a")}</if>',
            [["zero"]],
        ),
    ],
)
def test_what_is_sent_as_zero_is_named_and_nothing_that_has_a_default(
    tmp_path: Path, kind: str, sends: str, named: list[list[str]]
):
    assert _unset(tmp_path, kind, sends) == named
