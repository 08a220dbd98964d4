"""Lines for people: aligned, one event a line, coloured on a terminal."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

from m2c.printable import printable
from moon.tap.action_parts import essence, goal_id
from moon.tap.stream import Line, nobody_answered

_ARROWS = {"message": "•", "request": "→", "response": "←", "unanswered": "✗"}
_COLOURS = {"message": "36", "request": "34", "response": "32", "unanswered": "31"}
MAX_DATA = 160
"""Characters of a message that a line shows."""
MAX_DEPTH = 12
"""Levels of a message that a line shows: nobody reads more, and somebody may send thousands."""
MAX_CHANNEL, MAX_NODE = 48, 28
"""Columns grow up to this many characters; longer names push the rest of their line aside."""
UNKNOWN, NOBODY = "?", "-"
"""Who answered: not known, nobody."""


class Renderer:
    """Formats lines; columns grow to fit what was seen and never shrink."""

    def __init__(self, colour: bool) -> None:
        self._colour = colour
        self._channel_width = 24
        self._node_width = 12

    def text(self, line: Line) -> str:
        """One line of text without its end."""
        channel = printable(line.action or line.channel)
        node = printable(line.source) or (NOBODY if nobody_answered(line.error) else UNKNOWN)
        self._channel_width = min(max(self._channel_width, len(channel)), MAX_CHANNEL)
        self._node_width = min(max(self._node_width, len(node)), MAX_NODE)
        clock = time.strftime("%H:%M:%S", time.localtime(line.stamp_ns // 10**9))
        micros = line.stamp_ns % 10**9 // 1000
        arrow = _ARROWS[line.kind]
        ending = ""
        if line.round_trip_us is not None:
            ending = f"  ({line.round_trip_us:,.0f} µs)"
        if line.error:
            ending += f"  {printable(line.error)}"
        if self._colour:
            shade = "31" if line.error else _COLOURS[line.kind]
            arrow = f"\x1b[{shade}m{arrow}\x1b[0m"
        return (
            f"{clock}.{micros:06d}  {channel:<{self._channel_width}}  {arrow} "
            f"{node:<{self._node_width}}  {_contents(line)}{ending}"
        ).rstrip()


def _contents(line: Line) -> str:
    if not line.part:
        return "" if line.data is None else compact(line.data)
    if line.data is None:
        return line.part
    goal, data = essence(line.part, line.data)
    name = f"{line.part} {goal}".rstrip()
    return f"{name}  {compact(data)}" if data != {} else name


def compact(data: Any) -> str:
    """A message in one short piece of text: ``status: 0, is_ok: true``."""
    pieces = _fields(data, 0) if isinstance(data, dict) else _value(data, 0)
    text = ""
    for piece in pieces:  # a long message (an image) is not written out to be cut off
        text += piece
        if len(text) > MAX_DATA:
            return text[: MAX_DATA - 1] + "…"
    return text


def _fields(fields: dict[Any, Any], depth: int) -> Iterator[str]:
    for place, (key, value) in enumerate(fields.items()):
        yield f"{', ' if place else ''}{printable(str(key))}: "
        yield from _value(value, depth)


def _value(value: Any, depth: int) -> Iterator[str]:
    if depth > MAX_DEPTH:
        yield "…"
        return
    match value:
        case bool():
            yield "true" if value else "false"
        case {"uuid": [*_]} if len(value) == 1:
            yield _short_id(value)
        case dict():
            yield "{"
            yield from _fields(value, depth + 1)
            yield "}"
        case list():
            for place, inner in enumerate(value):
                yield ", " if place else "["
                yield from _value(inner, depth + 1)
            yield "]" if value else "[]"
        case float():
            yield f"{value:g}"
        case str():
            shown = value[: MAX_DATA + 1]
            yield shown if shown.isidentifier() else repr(shown)
        case bytes():
            yield f"{len(value)} bytes"
        case _:
            yield printable(str(value))


def _short_id(value: dict[str, Any]) -> str:
    try:
        return goal_id(value)
    except TypeError:  # something else that is called uuid
        return printable(str(value["uuid"]))
