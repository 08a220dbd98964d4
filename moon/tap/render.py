"""Lines for people: aligned, one event a line, coloured on a terminal."""

from __future__ import annotations

import time

from m2c.printable import printable
from moon.tap.action_parts import essence
from moon.tap.stream import Line, nobody_answered
from moon.wording import Wording

_ARROWS = {"message": "•", "request": "→", "response": "←", "unanswered": "✗", "taken": "▸"}
_COLOURS = {"message": "36", "request": "34", "response": "32", "unanswered": "31", "taken": "35"}
MAX_CHANNEL, MAX_NODE = 48, 28
"""Columns grow up to this many characters; longer names push the rest of their line aside."""
UNKNOWN, NOBODY = "?", "-"
"""Who answered: not known, nobody."""


class Renderer:
    """Formats lines; columns grow to fit what was seen and never shrink.

    Args:
        colour: for a terminal.
        wording: the definitions by which numbers have names.
    """

    def __init__(self, colour: bool, wording: Wording | None = None) -> None:
        self._colour = colour
        self._wording = wording or Wording()
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
            f"{node:<{self._node_width}}  {self._contents(line)}{ending}"
        ).rstrip()

    def _contents(self, line: Line) -> str:
        if line.kind == "taken":
            return f"{printable(line.client)} {line.call}"
        if not line.part:
            return "" if line.data is None else self._wording.message(line.data, line.type_name)
        if line.data is None:
            return line.part
        goal, data = essence(line.part, line.data)
        name = f"{line.part} {goal}".rstrip()
        return f"{name}  {self._wording.message(data, line.type_name)}" if data != {} else name
