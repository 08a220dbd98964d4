"""Where lines go: a stream of text or JSON, or a table of statistics."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

import msgspec

from m2c.json_lines import versioned_line
from m2c.terminal import has_colour, show_painted
from moon.tap.render import Renderer
from moon.tap.statistics import HEADER, Statistics, cells, table
from moon.tap.stream import Line
from moon.wording import Wording

if TYPE_CHECKING:
    from rich.table import Table


MAX_JSON_DEPTH = 100
"""Levels that are written of a message nested too deeply for JSON as a whole."""


class Output(Protocol):
    """Takes the lines that are shown."""

    def add(self, line: Line) -> None:
        """Take one line."""
        ...

    def refresh(self, now_ns: int) -> None:
        """Show what changes with time; ``now_ns`` is the tap's clock."""
        ...

    def finish(self, now_ns: int) -> None:
        """Write what is left."""
        ...

    def close(self) -> None:
        """Leave the terminal as it was; idempotent, and writes nothing else."""
        ...


class Lines:
    """One line for each event, written at once; what came together is written together."""

    def __init__(
        self, encode: Callable[[Line], bytes], post: Callable[[Callable[[], None]], None]
    ) -> None:
        """``encode`` gives a line without its end; ``post`` runs something after what is queued."""
        self._encode = encode
        self._post = post
        self._pending: list[bytes] = []

    def add(self, line: Line) -> None:
        """Take one line."""
        if not self._pending:
            self._post(self._flush)
        self._pending.append(self._encode(line))

    def refresh(self, now_ns: int) -> None:
        """Nothing here changes with time."""

    def finish(self, now_ns: int) -> None:
        """Write what is left."""
        self._flush()

    def close(self) -> None:
        """The terminal was not changed."""

    def _flush(self) -> None:
        if not self._pending:
            return
        pending, self._pending = self._pending, []
        sys.stdout.buffer.write(b"\n".join(pending) + b"\n")
        sys.stdout.buffer.flush()


class LiveTable:
    """Statistics that are refreshed in place, on a terminal."""

    def __init__(self) -> None:
        from rich.live import Live

        self._statistics = Statistics()
        # what is said on a terminal's standard error meanwhile appears above the table
        self._live = Live(auto_refresh=False, redirect_stderr=sys.stderr.isatty())
        self._live.start()

    def add(self, line: Line) -> None:
        """Count one line."""
        self._statistics.add(line)

    def refresh(self, now_ns: int) -> None:
        """Draw the table anew."""
        self._live.update(self._table(now_ns), refresh=True)

    def finish(self, now_ns: int) -> None:
        """Leave the last table standing."""
        self.refresh(now_ns)
        self.close()

    def close(self) -> None:
        """Show the cursor again."""
        self._live.stop()

    def _table(self, now_ns: int) -> Table:
        from rich.table import Table
        from rich.text import Text

        drawn = Table(box=None, pad_edge=False, header_style="bold")
        for column, heading in enumerate(HEADER):
            drawn.add_column(
                Text(heading),
                justify="left" if column == 0 else "right",
                no_wrap=True,
            )
        for row in self._statistics.rows(now_ns):
            drawn.add_row(*(Text(cell) for cell in cells(row)))
        return drawn


class LastTable:
    """Statistics at the end: a table, or a line of JSON for each channel."""

    def __init__(self, as_json: bool) -> None:
        self._as_json = as_json
        self._statistics = Statistics()

    def add(self, line: Line) -> None:
        """Count one line."""
        self._statistics.add(line)

    def refresh(self, now_ns: int) -> None:
        """Nothing is shown before the end."""

    def finish(self, now_ns: int) -> None:
        """Write the statistics."""
        rows = self._statistics.rows(now_ns)
        lines = [versioned_line(row).decode() for row in rows] if self._as_json else table(rows)
        show_painted(*lines)

    def close(self) -> None:
        """The terminal was not changed."""


def output_for(
    as_json: bool,
    statistics: bool,
    post: Callable[[Callable[[], None]], None],
    wording: Wording | None = None,
) -> Output:
    """The output that the options ask for, on standard output; ``post`` as for :class:`Lines`."""
    on_terminal = sys.stdout.isatty()
    if statistics:
        return LiveTable() if on_terminal and not as_json else LastTable(as_json)
    if as_json:
        return Lines(json_of, post)
    text = Renderer(has_colour(), wording).text
    encoding = sys.stdout.encoding or "utf-8"
    return Lines(lambda line: text(line).encode(encoding, "backslashreplace"), post)


def _hook(value: Any) -> Any:
    if isinstance(value, msgspec.msgpack.Ext):
        return {"ext": value.code, "data": value.data}
    raise TypeError(f"{type(value).__name__} has no form in JSON")


_encode = msgspec.json.Encoder(enc_hook=_hook).encode


def json_of(line: Line) -> bytes:
    """``line`` as a JSON object (its format: docs/commands/moon-tap.md)."""
    try:
        return versioned_line(line, _encode)
    except (TypeError, RecursionError):  # MessagePack carries what JSON cannot
        return versioned_line(msgspec.structs.replace(line, data=_for_json(line.data, 0)), _encode)


def _for_json(value: Any, depth: int) -> Any:
    """``value`` with text for keys, and no deeper than :data:`MAX_JSON_DEPTH`."""
    if depth > MAX_JSON_DEPTH:
        return "…"
    match value:
        case dict():
            return {str(key): _for_json(inner, depth + 1) for key, inner in value.items()}
        case list():
            return [_for_json(inner, depth + 1) for inner in value]
        case _:
            return value
