"""A policy of bound leaves or plugins only is judged by its ticks, with or without nodes of its system beside it."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from m2c.cli import main as m2c
from moon.cli import main as moon

pytestmark = pytest.mark.slow

SYSTEM = """<roaml>
  <behavior_tree>
    <input type="bt.cpp-xml" src="./{0}.xml"/>
    <leaf ID="IsDark" topic="/dark" type="std_msgs/msg/Bool" cond="_msg.data"/>
  </behavior_tree>
</roaml>"""


def written(folder: Path, name: str, root: str) -> str:
    (folder / f"{name}.xml").write_text(
        '<root BTCPP_format="4" main_tree_to_execute="Main">'
        f'<BehaviorTree ID="Main">{root}</BehaviorTree></root>'
    )
    system = folder / f"{name}_system.xml"
    system.write_text(SYSTEM.format(name))
    return str(system)


@pytest.mark.parametrize(
    ("root", "becomes"), [("Fallback", "Sequence"), ("ReactiveFallback", "ReactiveSequence")]
)
def test_another_tree_than_the_one_that_runs_is_found(
    tmp_path: Path, root: str, becomes: str
) -> None:
    leaves = "<IsDark/><AlwaysSuccess/>"
    runs = written(tmp_path, "runs", f"<{root}>{leaves}</{root}>")
    another = written(tmp_path, "another", f"<{becomes}>{leaves}</{becomes}>")
    recording = str(tmp_path / "run.mcap")
    command = ["run", runs, "--transport", "simulated", "--ticks", "8", "--record", recording]
    assert CliRunner().invoke(m2c, command).exit_code == 0
    right = CliRunner().invoke(moon, ["check", recording, runs])
    assert right.exit_code == 0, right.output
    (row,) = (line.split() for line in right.output.splitlines() if line.startswith("policy  "))
    assert row[1] == "conforming"
    assert row[-2] == "8"  # out: its ticks
    wrong = CliRunner().invoke(moon, ["check", recording, another])
    assert wrong.exit_code == 1, wrong.output
    assert "a tick that ends with FAILURE" in wrong.output


def test_without_its_policy_nothing_is_left_of_such_a_system(tmp_path: Path) -> None:
    system = written(tmp_path, "runs", "<IsDark/>")
    refused = CliRunner().invoke(moon, ["monitor", system, "--without", "policy"])
    assert refused.exit_code == 2
    assert "no node to monitor: all are left out" in refused.output
