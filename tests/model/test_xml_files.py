"""A model may be in an ``.xml`` file: its root says what it is."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

import m2c
from m2c.cli import main

SCXML = "http://www.w3.org/2005/07/scxml"
ROOTS = (
    f'<scxml xmlns="{SCXML}" name="Lamp"><state id="a"/></scxml>',
    f'<s:scxml xmlns:s="{SCXML}" name="Lamp"><s:state id="a"/></s:scxml>',
    '<ascxml name="Lamp"><state id="a"/></ascxml>',
)
OTHERS = {
    "policy.xml": '<root BTCPP_format="4"><BehaviorTree ID="t"><AlwaysSuccess/></BehaviorTree></root>',
    "broken.xml": "<scxml><state",
    "types.xml": "<types/>",
    "note.xml": "<note/>",
}


@pytest.mark.parametrize("text", ROOTS)
def test_it_is_read_alone_in_a_folder_and_by_a_system(text: str, tmp_path: Path) -> None:
    path = tmp_path / "machine.xml"
    path.write_text(text)
    system = tmp_path / "elsewhere" / "system.xml"
    system.parent.mkdir()
    system.write_text(
        '<roaml><node_models><input type="node-ascxml" src="../machine.xml"/></node_models></roaml>'
    )
    for given in (path, tmp_path, system):
        assert [node.name for node in m2c.read_system(given).nodes] == ["Lamp"]


def test_other_files_of_its_folder_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "machine.xml").write_text(ROOTS[0])
    for name, text in OTHERS.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "folder.xml").mkdir()
    assert [node.name for node in m2c.read_system(tmp_path).nodes] == ["Lamp"]


@pytest.mark.parametrize(
    "command",
    [["draw", "-o", "out.svg"], ["check"], ["convert", "-o", "out"], ["generate", "-o", "out"]],
)
def test_commands_take_it(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("machine.xml").write_text(ROOTS[0])
    result = CliRunner().invoke(main, [command[0], "machine.xml", *command[1:]])
    assert result.exit_code == 0, result.output
