"""Paths made to break who opens them: each is one error, at the place where it is written."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from click.testing import CliRunner

from m2c.cli import main
from m2c.draw.reading import read
from m2c.model import DiagnosticLog, load, paths
from m2c.policy.reader import read_policy_file
from moon.cli import main as moon

MODEL = (
    '<scxml xmlns="http://www.w3.org/2005/07/scxml" name="A" initial="a"><state id="a"/></scxml>'
)

LOOP = "Too many levels of symbolic links"
DEVICE = "a pipe or a device, which may never end; save it as a file"

NO_FILES = {
    "loop": LOOP,
    "loop/inside": LOOP,
    "a" * 5_000: "File name too long",
    "x/../" * 1_000 + "y": "File name too long",
    "/": "Is a directory",
    ".": "Is a directory",
    "/dev/zero": DEVICE,
    "fifo": DEVICE,
    "to_zero": DEVICE,
}
"""Paths of no file that can be read, and why."""
FOLDERLESS = [path for path in NO_FILES if path not in ("/", ".")]


def label(value: str) -> str:
    return value[:20]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "to_zero").symlink_to("/dev/zero")
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "a.scxml").write_text(MODEL)
    return tmp_path


def system_with(folder: Path, inside: str) -> list[str]:
    """What is said of a system file with ``inside``; its own path is left out."""
    path = folder / "system.xml"
    path.write_text(inside)
    log = DiagnosticLog()
    load([path], log)
    return [str(found).replace(f"{folder}/", "") for found in log.diagnostics]


@pytest.mark.parametrize("src", NO_FILES, ids=label)
@pytest.mark.parametrize(
    ("before", "after"),
    [
        ('<roaml><node_models><input type="node-ascxml" src="', '"/></node_models></roaml>'),
        ('<roaml><behavior_tree><input type="bt.cpp-xml" src="', '"/></behavior_tree></roaml>'),
        (
            '<roaml><behavior_tree><input type="bt-plugin-ascxml" src="',
            '"/></behavior_tree></roaml>',
        ),
        (
            '<specification><model><skills><skill moc="fsm" path="',
            '"/></skills></model></specification>',
        ),
    ],
    ids=["model", "tree", "plugin", "full model"],
)
def test_what_is_no_file_is_one_error_where_it_is_named(
    folder: Path, before: str, after: str, src: str
) -> None:
    tag = before.rpartition("<")[2].split()[0]
    assert system_with(folder, before + src + after) == [
        f"system.xml:1:{len(before) + 1}: error: <{tag}>: cannot read the file: {NO_FILES[src]} "
        "[unreadable-file]"
    ]


@pytest.mark.parametrize("src", FOLDERLESS, ids=label)
def test_what_is_no_folder_of_interfaces_is_one_error_where_it_is_named(
    folder: Path, src: str
) -> None:
    before = '<roaml><interfaces><input type="ros-interfaces" src="'
    (said,) = system_with(folder, f'{before}{src}"/></interfaces></roaml>')
    assert said.startswith(
        f"system.xml:1:{len(before) + 1}: error: <input>: this interface folder "
    )
    assert said.endswith("[missing-file]")


def test_a_folder_with_files_without_end_is_searched_for_nothing(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(paths, "MAX_ENTRIES", 1)
    before = '<roaml><interfaces><input type="ros-interfaces" src="'
    (said,) = system_with(folder, f'{before}."/></interfaces></roaml>')
    assert said.startswith(
        f"system.xml:1:{len(before) + 1}: error: <input>: this interface folder "
    )
    assert "files below it; name a folder in it" in said
    log = DiagnosticLog()
    assert load([folder], log) is None
    (found,) = log.diagnostics
    assert (found.rule, found.position.file) == ("unreadable-file", str(folder))
    assert "files below it; name a folder in it" in found.message


@pytest.mark.parametrize("src", NO_FILES, ids=label)
def test_what_is_no_file_cannot_be_included(folder: Path, src: str) -> None:
    before = '<root><include path="'
    tree = '<BehaviorTree ID="M"><AlwaysSuccess/></BehaviorTree>'
    path = folder / "policy.xml"
    path.write_text(f'{before}{src}"/>{tree}</root>')
    log = DiagnosticLog()
    assert read_policy_file(path, log) is None
    (said,) = log.diagnostics
    assert (said.position.line, said.position.column) == (1, len(before) + 1)
    assert NO_FILES[src] in said.message or "does not exist" in said.message
    assert len(said.message) < 300


@pytest.mark.parametrize("name", [*FOLDERLESS, "a\0b", "none"], ids=label)
def test_a_path_that_cannot_be_read_is_one_error(folder: Path, name: str) -> None:
    path = folder / name
    for reader in (lambda log: load([path], log), lambda log: read(path, (), log)):
        log = DiagnosticLog()
        assert reader(log) is None
        (said,) = log.diagnostics
        assert (said.rule, said.position.file) == ("unreadable-file", str(path))


def test_one_model_of_a_folder_that_cannot_be_read_is_one_error(folder: Path) -> None:
    (folder / "loop.scxml").symlink_to("loop.scxml")
    (folder / "zero.scxml").symlink_to("/dev/zero")
    log = DiagnosticLog()
    system = load([folder], log)
    assert system is not None
    assert [node.name for node in system.nodes] == ["A"]
    assert [Path(said.position.file).name for said in log.diagnostics] == [
        "loop.scxml",
        "zero.scxml",
    ]


COMMANDS = [
    (main, ["check"]),
    (main, ["draw", "-o", "out.svg"]),
    (main, ["generate", "-o", "out"]),
    (main, ["run"]),
    (main, ["interfaces", "build"]),
    (moon, ["explain"]),
    (moon, ["check-properties"]),
    (moon, ["check"]),
]


@pytest.mark.parametrize("name", ["loop", "a" * 5_000, "/dev/zero", "fifo", "to_zero"], ids=label)
@pytest.mark.parametrize(("group", "words"), COMMANDS, ids=lambda value: str(value)[-20:])
def test_no_command_trips_over_a_path(
    folder: Path, group: object, words: list[str], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    result = CliRunner().invoke(group, [*words, name])
    assert result.exit_code == 2, result.output
    assert isinstance(result.exception, SystemExit)
    assert len([line for line in result.output.splitlines() if "rror: " in line]) == 1
    assert not (folder / "out").exists()
    assert not (folder / "out.svg").exists()
