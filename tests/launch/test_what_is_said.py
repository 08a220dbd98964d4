"""What a monitor says of a violation: the field that differs comes first, and repetitions are counted."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.launch.system import HEAD
from tests.launch.test_simulated import code, run

pytestmark = pytest.mark.slow

COUNTER = (
    HEAD.format("Counter", "s")
    + """<ros_topic_publisher topic="/count" type="std_msgs/Int32" name="count"/>
<ros_topic_publisher topic="/more" type="std_msgs/Int32" name="more"/>
<ros_time_rate name="beat" rate_hz="2"/>
<datamodel><data id="n" type="int32" expr="0"/></datamodel>
<state id="s"><ros_rate_callback name="beat"><assign location="n" expr="n + 1"/>
  <ros_topic_publish name="count"><field name="data" expr="n"/></ros_topic_publish>
  <ros_topic_publish name="more"><field name="data" expr="n"/></ros_topic_publish>
</ros_rate_callback></state></scxml>"""
)
COUNT = '<ros_topic_publish name="count"><field name="data" expr="n"/>'
MORE = '<ros_topic_publish name="more"><field name="data" expr="n"/>'
SCAN = (
    HEAD.format("Lidar", "on")
    + """<ros_topic_publisher name="scan" topic="/scan" type="sensor_msgs/LaserScan"/>
<ros_time_rate name="spin" rate_hz="5"/>
<state id="on"><ros_rate_callback name="spin"><ros_topic_publish name="scan">
  <field name="header.frame_id" expr="'laser'"/>
  <field name="range_max" expr="10"/>
  <field name="ranges" expr="[Math.random() * 10, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15]"/>
  <field name="intensities" expr="[1, 2, 3]"/>
</ros_topic_publish></ros_rate_callback></state></scxml>"""
)


def monitored(folder: Path, name: str, model: str, code: str, *options: str) -> Any:
    """A run of ``code`` in the place of ``model``."""
    (folder / f"{name}.scxml").write_text(model)
    (folder / "code.scxml").write_text(code)
    path = folder / "system.xml"
    path.write_text(
        f'<roaml><node_models><input type="ros-scxml" src="./{name}.scxml"/></node_models></roaml>'
    )
    replaced = ("--replace", f"{name}={folder / 'code.scxml'}")
    return run(path, "--for", 8, *replaced, *(options or ("--monitor",)))


def violated(made: Any) -> list[str]:
    """The lines that say that a machine is violated, without those of the table."""
    return [line for line in made.lines if "VIOLATED" in line]


def verdicts(made: Any) -> list[dict[str, Any]]:
    """The violations, as JSON."""
    found = [json.loads(line) for line in made.lines if line.startswith("{")]
    return [item for item in found if item.get("outcome") == "violated"]


def test_a_violation_that_differs_from_its_last_in_a_counter_is_said_once_and_counted(
    tmp_path: Path,
) -> None:
    model = COUNTER.replace(f"{MORE}</ros_topic_publish>", "")
    wrong = model.replace(COUNT, COUNT.replace('expr="n"', 'expr="2 * n"'))
    made = monitored(tmp_path, "Counter", model, wrong)
    assert code(made) == 1, made.output
    assert len(violated(made)) == 1, made.output
    assert "violated ×" in made.output
    assert "{data: 1}" in made.output
    last = next(line for line in made.lines if line.startswith("Counter: expected"))
    assert "{data: 1}" not in last, "the last violation is the newest"


def test_mistakes_that_take_turns_are_said_once_each(tmp_path: Path) -> None:
    wrong = COUNTER.replace(COUNT, COUNT.replace('expr="n"', 'expr="n + 1"'))
    wrong = wrong.replace(MORE, MORE.replace('expr="n"', 'expr="n + 2"'))
    made = monitored(tmp_path, "Counter", COUNTER, wrong)
    assert code(made) == 1, made.output
    assert 1 <= len(violated(made)) <= 4, made.output


@pytest.mark.parametrize(
    ("right", "wrong", "path", "expected", "observed"),
    [
        ("[Math.random() * 10, 2", "[45, 2", "ranges[0]", "0…10", "45"),
        ("14, 15]", "14, 16]", "ranges[14]", "15", "16"),
        ("14, 15]", "14]", "ranges.length", "15", "14"),
        ("'laser'", "'lasers'", "header.frame_id", "'laser'", "'lasers'"),
        ("[1, 2, 3]", "[1, 2, 3.5]", "intensities[2]", "3", "3.5"),
    ],
)
def test_of_a_long_message_the_field_that_differs_comes_first(
    tmp_path: Path, right: str, wrong: str, path: str, expected: str, observed: str
) -> None:
    made = monitored(tmp_path, "Lidar", SCAN, SCAN.replace(right, wrong))
    assert len(violated(made)) == 1, made.output
    assert f"expected  message on /scan {path}: {expected} in {{" in made.output
    assert f"observed  message on /scan {path}: {observed} in {{" in made.output


def test_json_has_the_cause_and_the_field_that_differs(tmp_path: Path) -> None:
    made = monitored(tmp_path, "Lidar", SCAN, SCAN.replace("14, 15]", "14, 16]"), "--monitor=--json")  # fmt: skip
    (verdict,) = verdicts(made)
    assert verdict["cause"] == "unexpected"
    why = verdict["explanation"]
    assert why["channel"] == "/scan"
    assert why["differences"] == [{"path": "ranges[14]", "expected": "15", "observed": "16"}]


def test_json_tells_silence_and_undeclared_channels_apart(tmp_path: Path) -> None:
    silent = monitored(tmp_path, "Counter", COUNTER, COUNTER.replace(f"{MORE}</ros_topic_publish>", ""), "--monitor=--json")  # fmt: skip
    causes = {item["cause"] for item in verdicts(silent)}
    assert causes <= {"unresponsive", "unexpected"}
    assert causes
    other = COUNTER.replace('topic="/more"', 'topic="/elsewhere"')
    undeclared = monitored(tmp_path, "Counter", COUNTER, other, "--monitor=--json")
    assert "undeclared" in {item["cause"] for item in verdicts(undeclared)}


def test_whole_numbers_are_shown_with_all_their_digits(tmp_path: Path) -> None:
    drawn = "Math.floor(Math.random() * 4294967296) - 2147483648"
    model = COUNTER.replace(COUNT, COUNT.replace('expr="n"', f'expr="{drawn}"'))
    model = model.replace("int32", "float64").replace("std_msgs/Int32", "std_msgs/Float64")
    wrong = model.replace(drawn, "4e9")
    made = monitored(tmp_path, "Counter", model, wrong)
    assert "{data: -2147483648…2147483647}" in made.output, made.output
    assert "{data: 4000000000}" in made.output
