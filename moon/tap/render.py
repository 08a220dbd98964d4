"""Lines for people: aligned, one event a line, coloured on a terminal."""

from __future__ import annotations

import time
from typing import Any

from moon.tap.stream import Line

_ARROWS = {"message": "•", "request": "→", "response": "←", "unanswered": "✗"}
_COLOURS = {"message": "36", "request": "34", "response": "32", "unanswered": "31"}
MAX_DATA = 160
"""Characters of a message that a line shows."""


class Renderer:
    """Formats lines; columns grow to fit what was seen and never shrink."""

    def __init__(self, colour: bool) -> None:
        self._colour = colour
        self._channel_width = 24
        self._node_width = 12

    def text(self, line: Line) -> str:
        """One line of text without its end."""
        self._channel_width = min(max(self._channel_width, len(line.channel)), 48)
        node = line.source or line.client
        self._node_width = min(max(self._node_width, len(node)), 28)
        clock = time.strftime("%H:%M:%S", time.localtime(line.stamp_ns // 10**9))
        micros = line.stamp_ns % 10**9 // 1000
        arrow = _ARROWS[line.kind]
        ending = ""
        if line.round_trip_us is not None:
            ending = f"  ({line.round_trip_us:,.0f} µs)"
        if line.error:
            ending += f"  {line.error}"
        data = "" if line.data is None else compact(line.data)
        if self._colour:
            shade = "31" if line.error else _COLOURS[line.kind]
            arrow = f"\x1b[{shade}m{arrow}\x1b[0m"
        return (
            f"{clock}.{micros:06d}  {line.channel:<{self._channel_width}}  {arrow} "
            f"{node:<{self._node_width}}  {data}{ending}"
        ).rstrip()


def compact(data: Any) -> str:
    """A message in one short piece of text: ``status: 0, is_ok: true``."""
    text = (
        ", ".join(f"{key}: {_value(value)}" for key, value in data.items())
        if isinstance(data, dict)
        else _value(data)
    )
    return text if len(text) <= MAX_DATA else text[: MAX_DATA - 1] + "…"


def _value(value: Any) -> str:
    match value:
        case bool():
            return "true" if value else "false"
        case dict():
            if set(value) == {"uuid"}:
                return bytes(octet & 0xFF for octet in value["uuid"]).hex()[:8]
            return "{" + ", ".join(f"{key}: {_value(inner)}" for key, inner in value.items()) + "}"
        case list():
            return "[" + ", ".join(_value(inner) for inner in value) + "]"
        case float():
            return f"{value:g}"
        case str():
            return value if value.isidentifier() else repr(value)
        case _:
            return str(value)
