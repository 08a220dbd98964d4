"""Which channels a tap is to receive."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from fnmatch import fnmatchcase
from functools import lru_cache

_REMEMBERED = 65_536
"""Channels whose answer is remembered; a system with more costs time, not memory."""


def whole_of(channel: str) -> str:
    """The action that ``channel`` is a part of (``transports.actions.parts``); any other channel itself."""
    return channel.partition("/_action/")[0]


def channel_filter(globs: Iterable[str]) -> Callable[[str], bool]:
    """Whether a tap with ``globs`` is to receive a channel; without any, it receives all."""
    chosen = tuple(globs)

    @lru_cache(_REMEMBERED)
    def wants(channel: str) -> bool:
        return not chosen or matches(channel, chosen)

    return wants


def matches(channel: str, globs: Iterable[str]) -> bool:
    """Whether a glob names ``channel``, or the action that it is a part of.

    A glob's ``*`` crosses parts of a name.
    """
    names = (channel, whole_of(channel))
    return any(fnmatchcase(name, glob) for name in names for glob in globs)
