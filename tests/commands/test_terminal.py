"""What is shown of the texts of others: nothing that a terminal obeys, and never more than a line."""

from __future__ import annotations

import io
import json
import logging
import sys
import unicodedata
from pathlib import Path

import msgspec
import pytest
from click.testing import CliRunner
from hypothesis import example, given
from hypothesis import strategies as st

import m2c.cli
import moon.cli
from m2c.json_lines import as_line
from m2c.logs import LineFormatter, log_as_lines
from m2c.printable import printable
from m2c.runtime.main import log_on
from m2c.terminal import fail, say, show
from moon.monitor.report import cells, table
from moon.monitor.status import MachineStatus

PROPERTIES = Path(__file__).parents[2] / "examples" / "lab_tour" / "properties.yaml"
BIDI = "\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069\u200e\u200f\u061c"
UNSEEN = "\u200b\u200c\u200d\u2060\ufeff\u00ad\U000e0041"
HOSTILE = "\x1b]0;owned\x07\x1b[2J\x9b31m\r\n\u2028\x7f\x00\udcff" + BIDI + UNSEEN

anything = st.text(st.characters(), max_size=30)  # lone surrogates too


@given(anything)
@example(HOSTILE)
def test_printable_text_has_no_control_format_or_end_of_line(text: str) -> None:
    shown = printable(text)
    assert {unicodedata.category(c) for c in shown} & {"Cc", "Cf", "Cs", "Zl", "Zp"} == set()
    assert shown.encode().decode() == shown


def test_what_cannot_be_seen_is_shown_as_its_escape() -> None:
    assert printable("a\x1b[2J\u202eb\n\udcff") == "a\\x1b[2J\\u202eb\\n\\udcff"
    assert printable("Größe 東京 «x»") == "Größe 東京 «x»"


def test_a_line_that_is_shown_stays_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    show("name\nerror: forged", "second")
    say("to\rstandard error")
    with pytest.raises(SystemExit) as ended:
        fail("bad\x1b[2Jname", "second")
    assert ended.value.code == 2
    out, err = capsys.readouterr()
    assert out == "name\\nerror: forged\nsecond\n"
    assert err == "to\\rstandard error\nerror: bad\\x1b[2Jname\nsecond\n"


def test_what_a_terminal_cannot_encode_is_escaped(monkeypatch: pytest.MonkeyPatch) -> None:
    buffer = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(buffer, encoding="ascii"))
    show("Größe")
    assert buffer.getvalue() == b"Gr\\xf6\\xdfe\n"


@given(anything)
@example(HOSTILE)
def test_json_for_pipes_is_the_same_text_and_harmless_to_a_terminal(text: str) -> None:
    line = as_line({"name": text})
    assert json.loads(line) == {"name": text}
    assert line.decode().isprintable()


def test_json_of_what_is_printable_is_left_as_it_is() -> None:
    assert as_line({"name": "Größe 東京"}) == msgspec.json.encode({"name": "Größe 東京"})


def record_of(message: str, *arguments: object) -> logging.LogRecord:
    return logging.LogRecord("node", logging.INFO, "x.py", 1, message, arguments, None)


def test_a_record_of_a_log_is_one_line() -> None:
    formatter = LineFormatter("%(levelname)s %(name)s: %(message)s")
    text = formatter.format(record_of("%s", HOSTILE + "\nERROR node: forged"))
    assert text.startswith("INFO node: \\x1b]0;owned\\x07")
    assert text.isprintable()


def test_a_logged_traceback_has_lines_of_its_own_and_forges_none() -> None:
    record = record_of("failed")
    try:
        raise ValueError("\x1b[2J\nERROR node: forged")
    except ValueError:
        record.exc_info = sys.exc_info()
    first, *others = LineFormatter().format(record).split("\n")
    assert first == "failed"
    assert any("ValueError: \\x1b[2J" in line for line in others)
    assert all(line.isprintable() and line.startswith("  ") for line in others)


def test_what_nobody_set_a_log_up_for_is_printable_too() -> None:
    log_as_lines()
    assert logging.lastResort is not None
    assert logging.lastResort.format(record_of("a\x1b[2J\nb")) == "a\\x1b[2J\\nb"


@pytest.mark.parametrize(
    ("main", "arguments"),
    [
        (m2c.cli.main, ["check\x1b[2J"]),
        (m2c.cli.main, ["run", "\x1b[2J\nforged"]),
        (m2c.cli.main, ["draw", "x.scxml", "-o", "\x1b[2J\nforged"]),
        (m2c.cli.main, ["interfaces", "build", "\x1b[2J\nforged"]),
        (m2c.cli.main, ["check", "--\x1b[2J", "x"]),
        (moon.cli.main, ["tap", "\x1b[2J\nforged"]),
        (moon.cli.main, ["check", "\x1b[2J\nforged", "--properties", str(PROPERTIES)]),
        (moon.cli.main, ["check-properties", "\x1b[2J\nforged"]),
        (moon.cli.main, ["explain", "\x1b[2J\nforged"]),
        (moon.cli.main, ["record", "-o", "x", "--interfaces", "\x1b[2J\nforged"]),
        (moon.cli.main, ["replay", "\x1b[2J\nforged"]),
        (moon.cli.main, ["monitor", "\x1b[2J\nforged"]),
    ],
)
def test_what_was_typed_is_named_printably(main: m2c.cli.LazyGroup, arguments: list[str]) -> None:
    done = CliRunner().invoke(main, arguments)
    assert done.exit_code == 2
    assert "\\x1b[2J" in done.output
    assert all(line.isprintable() for line in done.output.split("\n")), done.output
    assert not any(line.startswith("forged") for line in done.output.split("\n"))


def test_a_row_of_the_monitors_table_is_one_line() -> None:
    status = MachineStatus(HOSTILE, "violated", (HOSTILE,), 1, 2, 1, 0, None, HOSTILE)
    assert all(cell.isprintable() for cell in cells(status))
    assert all(line.isprintable() for line in table([status]))


class WithLog:
    """A connection to a middleware that has a log of its own, as ROS 2 has."""

    def __init__(self) -> None:
        self.handler = logging.StreamHandler(io.StringIO())

    def log_handler(self, level: int) -> logging.Handler:
        return self.handler


def test_what_goes_to_the_log_of_a_middleware_is_printable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(logging.getLogger(), "handlers", [])
    connection = WithLog()
    log_on(connection)  # type: ignore[arg-type]  # nothing else of it is used
    logging.getLogger("node").error("%s", HOSTILE)
    assert connection.handler.stream.getvalue().rstrip("\n") == printable(HOSTILE)
