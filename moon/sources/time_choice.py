"""Which time of its entries a recording may be judged by, and what an entry itself tells of it."""

from __future__ import annotations

from typing import Any

import msgspec

from moon.recording.contents import is_clock
from transports.channel_filter import whole_of
from transports.interface import Observation

LOG, PUBLISH, HEADER, CLOCK = "log", "publish", "header", "clock"


class TimeError(ValueError):
    """A recording has no such time, or none that makes sense; the text says which it has."""


class TimeChoice(msgspec.Struct, frozen=True):
    """Which time of its entries a recording is judged by.

    Attributes:
        kind: :data:`LOG`, :data:`PUBLISH`, :data:`HEADER`, :data:`CLOCK`; empty: by evidence.
        field: of :data:`HEADER`: the path of the field with the stamp, or with a header that has one.
    """

    kind: str = ""
    field: str = ""


def time_choice(text: str) -> TimeChoice:
    """The choice that is written as ``text``: ``log``, ``publish``, ``header:FIELD`` or ``clock``.

    Raises:
        TimeError: it is none of them.
    """
    kind, colon, field = text.partition(":")
    if kind == HEADER and all(field.split(".")):
        return TimeChoice(HEADER, field)
    if kind in (LOG, PUBLISH, CLOCK) and not colon:
        return TimeChoice(kind)
    raise TimeError(f"`{text}` is no time; expected log, publish, header:FIELD or clock")


def concerns(needed: frozenset[str] | None, channel: str) -> bool:
    """Whether ``channel`` is one of ``needed``, or a part of an action that is; None: all are."""
    return needed is None or channel in needed or whole_of(channel) in needed


def read_time(seen: Observation, choice: TimeChoice) -> int | None:
    """The time that the contents of ``seen`` tell (ns); None if they tell none, or none was chosen.

    A zero in a header is none: its publisher has not set it.
    """
    if choice.kind == HEADER:
        return _stamp_in(seen.data, choice.field) or None
    if choice.kind == CLOCK and is_clock(seen.channel, seen.type_name):
        return _stamp_in(seen.data, "clock")
    return None


def _stamp_in(data: Any, path: str) -> int | None:
    """The stamp at ``path``: a time, a header with one, or seconds."""
    for name in path.split("."):
        data = data.get(name) if isinstance(data, dict) else None
    if isinstance(data, dict) and "stamp" in data:
        data = data["stamp"]
    if isinstance(data, dict):
        sec, nanosec = data.get("sec"), data.get("nanosec", 0)
        if isinstance(sec, int) and isinstance(nanosec, int):
            return sec * 10**9 + nanosec
        return None
    if isinstance(data, int | float) and not isinstance(data, bool) and abs(data) < 1e10:
        return round(data * 1e9)
    return None
