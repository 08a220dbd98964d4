"""What does not fit a terminal is folded between words and indented; in a pipe a line stays a line."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from m2c import terminal
from tests.commands.on_terminal import OnTerminal

COLOUR = re.compile(r"\x1b\[[0-9;]*m")
MODEL = """<scxml version="1.0" name="M" initial="s">
<datamodel><data id="a_rather_long_name" type="int32" expr="0"/></datamodel>
<state id="s"><onentry><assign location="a_rather_lon_name" expr="another_rather_long_name + 1"/></onentry></state>
</scxml>"""


class Terminal:
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("columns", [20, 40, 80, 200])
@pytest.mark.parametrize(
    ("line", "indent"),
    [
        ("file.scxml:3:4: error: " + "word " * 30, 4),
        ("    expected  " + "word " * 30, 14),
        ("              " + "word " * 30, 14),
        ("    in state  " + "word " * 30, 14),
        ("12:00:00.000000  Name  \x1b[31mVIOLATED\x1b[0m " + "word " * 30, 17),
    ],
)
def test_lines_fit_and_the_others_stand_below_the_text(
    monkeypatch: pytest.MonkeyPatch, line: str, indent: int, columns: int
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    first, *others = terminal.folded(line, stream=Terminal())  # type: ignore[arg-type]
    assert bool(others) == (len(COLOUR.sub("", line).rstrip()) > columns)
    for other in others:
        bare = COLOUR.sub("", other)
        assert len(bare) - len(bare.lstrip(" ")) == min(indent, columns // 2)
    if columns >= 40:
        assert all(len(COLOUR.sub("", part)) <= columns for part in (first, *others))
    assert " ".join([first, *others]).split() == line.split()


@pytest.mark.parametrize("line", ["", " ", "x" * 500, "\t" * 100, "ä" * 90 + " b"])
def test_any_line_can_be_folded(monkeypatch: pytest.MonkeyPatch, line: str) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert "".join(terminal.folded(line, stream=Terminal())).replace(" ", "") == line.replace(
        " ", ""
    )  # type: ignore[arg-type]


def test_in_a_pipe_a_line_stays_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    line = "word " * 100
    assert terminal.folded(line) == [line]


@pytest.mark.slow
def test_findings_are_folded_on_a_narrow_terminal(tmp_path: Path) -> None:
    model = tmp_path / "model.scxml"
    model.write_text(MODEL)
    run = OnTerminal("m2c", "check", model.name, cwd=tmp_path, columns=60)
    run.end()
    lines = COLOUR.sub("", run.text).splitlines()
    assert all(len(line) <= 60 for line in lines), lines
    assert [line for line in lines if line.startswith("    ")]
