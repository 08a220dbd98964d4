"""A system that is run and watched with ``--lenient``: one meaning in all commands, and none without it."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from m2c.cli import main as m2c
from moon.cli import main as moon
from tests.launch.system import HEAD, Run

TALKER = (
    HEAD.format("Talker", "a")
    + """<datamodel><data id="n" type="string" expr="0"/></datamodel>
<ros_topic_publisher topic="/t" type="std_msgs/Int16"/>
<ros_time_rate rate_hz="10" name="clock"/>
<state id="a"><ros_rate_callback name="clock" target="a">
  <assign location="n" expr="n * 3 + 1.75"/>
  <ros_topic_publish name="/t"><field name="data" expr="n"/></ros_topic_publish>
</ros_rate_callback></state></scxml>"""
)


@pytest.fixture
def system(tmp_path: Path) -> Path:
    """A node that counts in a string, and sends that as an integer."""
    (tmp_path / "Talker.scxml").write_text(TALKER)
    path = tmp_path / "system.xml"
    path.write_text(
        '<roaml><node_models><input type="ros-scxml" src="Talker.scxml"/></node_models></roaml>'
    )
    return path


def test_a_run_its_monitor_and_the_check_of_its_recording_agree(
    system: Path, tmp_path: Path
) -> None:
    recording = tmp_path / "run.mcap"
    run = Run(
        *(system, "--transport", "simulated", "--lenient", "--monitor"),
        *("--record", recording, "--for", 3),
        endpoint=None,
    )
    run.end()
    assert run.process.returncode == 0, run.lines
    assert any(line.split()[:2] == ["Talker", "conforming"] for line in run.lines), run.lines
    assert any("[lenient-conversion]" in line for line in run.lines), run.lines
    checked = CliRunner().invoke(moon, ["check", "--lenient", str(recording), str(system)])
    assert checked.exit_code == 0, checked.output
    assert "Talker" in checked.output


@pytest.mark.parametrize(
    ("tool", "words"),
    [
        (m2c, ["check"]),
        (m2c, ["draw", "-o", "{folder}/drawn.svg"]),
        (m2c, ["generate", "-o", "{folder}/generated"]),
        (moon, ["explain"]),
        (moon, ["check-properties", "{folder}/properties.yaml"]),
    ],
)
def test_every_command_that_checks_models_takes_the_option(
    system: Path, tmp_path: Path, tool: object, words: list[str]
) -> None:
    (tmp_path / "properties.yaml").write_text(
        "ports:\n  t: {topic: /t, field: data}\n"
        'properties:\n  - {id: high, formula: "historically{t > -1}"}\n'
    )
    command = [word.format(folder=tmp_path) for word in words]
    strict = CliRunner().invoke(tool, [*command, str(system)])
    assert strict.exit_code == 2
    assert "[type-mismatch]" in strict.output
    lenient = CliRunner().invoke(tool, [*command, "--lenient", str(system)])
    assert lenient.exit_code == 0, lenient.output


@pytest.mark.parametrize("words", [["run"], ["run", "--transport", "simulated"]])
def test_a_run_without_the_option_is_refused(system: Path, words: list[str]) -> None:
    refused = CliRunner().invoke(m2c, [*words, str(system)])
    assert refused.exit_code == 2
    assert "[type-mismatch]" in refused.output


def test_a_monitor_without_the_option_refuses_the_same_models(system: Path) -> None:
    refused = CliRunner().invoke(moon, ["monitor", str(system)])
    assert refused.exit_code == 2
    assert "[type-mismatch]" in refused.output


def test_generated_nodes_convert_as_they_were_told_to(system: Path, tmp_path: Path) -> None:
    folder = tmp_path / "generated"
    made = CliRunner().invoke(m2c, ["generate", "--lenient", str(system), "-o", str(folder)])
    assert made.exit_code == 0
    assert "[lenient-conversion]" in made.output
    machine = (folder / "talker" / "talker" / "machine.py").read_text()
    assert "ecmascript.to_int16(ecmascript.as_whole(self.n))" in machine
    refused = CliRunner().invoke(m2c, ["run", "--lenient", str(folder)])
    assert refused.exit_code == 2
    assert "these nodes are generated already; give it to `m2c generate`" in refused.output
