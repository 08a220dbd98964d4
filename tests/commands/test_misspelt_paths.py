"""A path that does not exist is refused with the one that was meant, by every command that takes one."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from m2c.cli import main as m2c
from m2c.model import DiagnosticLog, load
from m2c.model.paths import meant
from moon.cli import main as moon

MODEL = '<scxml xmlns="http://www.w3.org/2005/07/scxml" name="Tank"><state id="a"/></scxml>'
FILES = {
    "system.xml": '<roaml><node_models><input type="node-ascxml" src="models/tank.scxml"/></node_models></roaml>',
    "models/tank.scxml": MODEL,
    "run.mcap": "",
    "properties.xml": "<properties/>",
    "properties.yaml": "",
    "interfaces/t/msg/A.msg": "int32 a\n",
    "templates/header.j2": "",
    "zenoh.json5": "{}",
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name, text in FILES.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("written", "found"),
    [
        ("models/tnak.scxml", "models/tank.scxml"),
        ("model/tank.scxml", "models/tank.scxml"),
        ("models/tank", "models/tank.scxml"),
        ("Models/Tank.scxml", "models/tank.scxml"),
        ("Models/zzz.scxml", "models"),
        ("models\\tank.scxml", "models/tank.scxml"),
        ("modles", "models"),
        ("SYSTEM.XML", "system.xml"),
    ],
)
def test_what_was_meant_is_what_is_there_and_called_almost_so(
    folder: Path, written: str, found: str
) -> None:
    assert meant(Path(written)) == f"did you mean {found}?"
    assert meant(folder / written) == f"did you mean {folder / found}?"


@pytest.mark.parametrize("written", ["zzz", "models/zzz.scxml", "zzz/tank.scxml", "system.xml", ""])
def test_what_is_like_nothing_or_exists_has_no_suggestion(folder: Path, written: str) -> None:
    assert meant(Path(written)) == ""


def test_a_loop_of_links_is_not_suggested_in_its_own_place(folder: Path) -> None:
    (folder / "loop").symlink_to("loop")
    assert meant(folder / "loop" / "inside") == ""


@pytest.mark.parametrize(
    ("command", "arguments", "found"),
    [
        (m2c, "check sytem.xml", "system.xml"),
        (m2c, "check modles", "models"),
        (m2c, "check models/tnak.scxml", "models/tank.scxml"),
        (m2c, "check --model sytem.xml", "system.xml"),
        (m2c, "check system.xml --interfaces interface", "interfaces"),
        (m2c, "generate sytem.xml -o out", "system.xml"),
        (m2c, "generate system.xml -o out --templates template", "templates"),
        (m2c, "run sytem.xml", "system.xml"),
        (m2c, "run system.xml --zenoh-config zenho.json5", "zenoh.json5"),
        (m2c, "draw sytem.xml -o out.svg", "system.xml"),
        (m2c, "interfaces build interface", "interfaces"),
        (moon, "check rnu.mcap system.xml", "run.mcap"),
        (moon, "check run.mcap sytem.xml", "system.xml"),
        (moon, "replay rnu.mcap", "run.mcap"),
        (moon, "replay run.mcap --interfaces interface", "interfaces"),
        (moon, "explain sytem.xml", "system.xml"),
        (moon, "check-properties propertis.xml", "properties.xml"),
        (moon, "check-properties propertis.yaml", "properties.yaml"),
        (moon, "monitor sytem.xml", "system.xml"),
    ],
)
def test_every_command_says_which_path_was_meant(
    folder: Path, command: object, arguments: str, found: str
) -> None:
    ended = CliRunner().invoke(command, arguments.split())  # type: ignore[arg-type]
    assert ended.exit_code == 2
    said = ended.output.replace(f"{folder}/", "")
    assert f"did you mean {found}?" in said


@pytest.mark.parametrize(
    ("old", "new", "found"),
    [
        ("models/tank.scxml", "models/tnak.scxml", "models/tank.scxml"),
        ("models/tank.scxml", "models\\tank.scxml", "models/tank.scxml"),
        ("models/tank.scxml", "models/tank", "models/tank.scxml"),
        ("models/tank.scxml", "model/tank.scxml", "models/tank.scxml"),
    ],
)
def test_a_path_in_a_system_file_is_suggested_as_it_is_written_there(
    folder: Path, old: str, new: str, found: str
) -> None:
    path = folder / "system.xml"
    path.write_text(path.read_text().replace(old, new))
    log = DiagnosticLog()
    load([path], log)
    (said,) = [item for item in log.diagnostics if item.severity == "error"]
    assert (said.rule, said.hint) == ("missing-file", f"did you mean {found}?")
    assert said.position.line == 1
