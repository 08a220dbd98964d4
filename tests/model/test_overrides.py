"""``--param`` and ``--remap``: what a command line says of single nodes, in every command that reads models."""

from __future__ import annotations

from pathlib import Path

import click
import pytest
from click.testing import CliRunner

import m2c
from m2c.cli import main as m2c_command
from m2c.diagnostics import ModelError
from moon.cli import main as moon_command
from tests.model.test_instances import channels, system_file

GIVEN = ("--param", "GoToDockSkill.poi=9", "--remap", "GoToKitchenSkill:goal:=kitchen/goal")


def invoke(tool: click.Command, *words: object) -> tuple[int, str]:
    done = CliRunner().invoke(tool, [str(word) for word in words])
    return done.exit_code, done.output


def test_what_is_said_last_of_a_node_counts(tmp_path: Path):
    path = system_file(tmp_path)
    parameters = ["GoToDockSkill.poi=1", "GoToDockSkill.spare=poi + 1", "GoToDockSkill.poi=9"]
    remaps = ["GoToDockSkill:/dock/goal:=/x", "GoToKitchenSkill:goal:=y"]
    dock, kitchen = m2c.read_system(path, parameters=parameters, remaps=remaps).nodes
    initial = {data.name: data.initial for data in dock.data}
    assert getattr(initial["poi"], "value", None) == 9
    assert [dock.name, kitchen.name] == ["GoToDockSkill", "GoToKitchenSkill"]
    assert "/x" in channels(dock)
    assert "/y" in channels(kitchen)
    assert dock.named_at == m2c.read_system(path).nodes[0].named_at


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("--param", "GoTo.poi=3"), "--param GoTo.poi=3:1:1: error: there is no node `GoTo`"),
        (("--param", "poi=3"), "--param poi=3:1:1: error: expected NODE.NAME=EXPRESSION"),
        (("--param", "GoToDockSkill.=3"), "expected NODE.NAME=EXPRESSION"),
        (("--param", "GoToDockSkill.poi="), "expected NODE.NAME=EXPRESSION"),
        (
            ("--param", "GoToDockSkill.pio=3"),
            "=3:1:15: error: <param>: `GoToDockSkill` has no data",
        ),
        (("--param", "GoToDockSkill.poi=3 +"), "=3 +:1:22: error: `3 +`: not an expression"),
        (("--param", "GoToDockSkill.poi=true"), "a value of type bool where int16 is declared"),
        (("--remap", "GoToDockSkill:/goal"), "expected NODE:CHANNEL:=CHANNEL"),
        (("--remap", "GoToDockSkill:/gaol:=/x"), "has no channel `/gaol`"),
        (("--remap", "Nobody:/goal:=/x"), "there is no node `Nobody`"),
    ],
)
def test_what_is_wrong_with_it_is_told_at_its_character(
    given: tuple[str, str], said: str, tmp_path: Path
):
    code, output = invoke(m2c_command, "check", system_file(tmp_path), *given)
    assert (code, said in output) == (2, True), output


def test_who_calls_the_interface_is_told_too(tmp_path: Path):
    with pytest.raises(ModelError, match="there is no node `GoTo`"):
        m2c.read_system(system_file(tmp_path), parameters=["GoTo.poi=3"])


def test_a_run_and_its_monitor_know_it_and_a_check_without_it_does_not(tmp_path: Path):
    path, recording = system_file(tmp_path), tmp_path / "run.mcap"
    run = (
        "run",
        path,
        "--transport",
        "simulated",
        "--ticks",
        3,
        "--monitor",
        "--record",
        recording,
    )
    code, output = invoke(m2c_command, *run, *GIVEN)
    assert (code, "0 violations" in output) == (0, True), output
    assert invoke(moon_command, "check", recording, path, *GIVEN)[0] == 0
    assert invoke(moon_command, "check", recording, path)[0] == 1


@pytest.mark.parametrize(
    "words", [["check"], ["generate", "-o", "{}/g"], ["draw", "-o", "{}/d.svg"]]
)
def test_commands_of_m2c_take_it(words: list[str], tmp_path: Path):
    words = [word.format(tmp_path) for word in words]
    path = system_file(tmp_path)
    assert invoke(m2c_command, *words, path, *GIVEN)[0] == 0
    assert invoke(m2c_command, *words, path, "--param", "GoTo.poi=3")[0] == 2


@pytest.mark.parametrize("words", [["explain"], ["check-properties", "{}/p.yaml"]])
def test_commands_of_moon_take_it(words: list[str], tmp_path: Path):
    (tmp_path / "p.yaml").write_text(
        "ports:\n  g: {topic: /kitchen/goal, field: data}\n"
        'properties:\n  - {id: near, formula: "historically{g < 100}"}\n'
    )
    words = [word.format(tmp_path) for word in words]
    path = system_file(tmp_path)
    assert invoke(moon_command, *words, path, *GIVEN)[0] == 0
    assert invoke(moon_command, *words, path, "--param", "GoTo.poi=3")[0] == 2


def test_nodes_that_are_generated_already_have_their_values(tmp_path: Path):
    path, folder = system_file(tmp_path), tmp_path / "generated"
    assert invoke(m2c_command, "generate", path, "-o", folder, *GIVEN)[0] == 0
    machine = (folder / "go_to_dock_skill" / "go_to_dock_skill" / "machine.py").read_text()
    assert "poi: Final = 9" in machine
    code, output = invoke(m2c_command, "run", folder, *GIVEN)
    assert (code, "these nodes are generated already" in output) == (2, True)
