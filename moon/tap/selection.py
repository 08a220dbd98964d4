"""Which lines are shown: filters by channel, node and kind."""

from __future__ import annotations

import re
from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from transports.channel_filter import whole_of

if TYPE_CHECKING:
    from moon.tap.stream import Line

KINDS = ("message", "request", "response", "unanswered", "taken", "action")
"""Kinds of lines; ``action`` is every part of an action, whatever its kind. ``taken`` is shown if asked for:
each message is there once already."""

_WILDCARD = re.compile(r"(/\*\*$|\*\*|\*|\?)")
_PATTERNS = {"/**": "(?:/.*)?", "**": ".*", "*": "[^/]*", "?": "[^/]"}


class GlobError(ValueError):
    """A channel glob that can match nothing; the text says what would be right."""


class Selection:
    """Filters of a tap; each that is empty lets everything through."""

    def __init__(
        self, channels: Sequence[str] = (), nodes: Sequence[str] = (), kinds: Sequence[str] = ()
    ) -> None:
        """Channel globs (see :func:`matches`), node globs, and some of :data:`KINDS`.

        Raises:
            GlobError: no channel can match one of ``channels``.
        """
        for glob in channels:
            check(glob)
        self._channels = tuple(channels)
        self._nodes = tuple(nodes)
        self._kinds = frozenset(kinds)
        self._wanted: dict[str, bool] = {}

    def takes(self, line: Line) -> bool:
        """Whether ``line`` is to be shown."""
        kinds = self._kinds
        if line.kind == "taken" and "taken" not in kinds:
            return False
        if kinds and line.kind not in kinds and not (line.action and "action" in kinds):
            return False
        if self._channels and not self._takes_channel(line):
            return False
        return not self._nodes or any(
            fnmatchcase(name, glob)
            for name in (line.source, line.client)
            if name
            for glob in self._nodes
        )

    def _takes_channel(self, line: Line) -> bool:
        wanted = self._wanted.get(line.channel)
        if wanted is None:
            names = (line.channel, line.action) if line.action else (line.channel,)
            wanted = any(matches(name, glob) for name in names for glob in self._channels)
            self._wanted[line.channel] = wanted
        return wanted

    def tapped(self) -> list[str]:
        """Globs for ``Listener.tap``, whose ``*`` crosses parts: all that may match, and more."""
        globs = []
        for glob in self._channels:
            literal = glob.replace("[", "[[]")
            globs.append(literal)
            if literal.endswith("/**") and (above := literal.removesuffix("/**")):
                globs.append(above)
        return globs


def check(glob: str) -> None:
    """Raise GlobError if no channel can match ``glob``."""
    if not glob.startswith(("/", "*")):
        raise GlobError(f"{glob!r} matches no channel: a channel starts with '/'; write '/{glob}'")
    if "//" in glob or (glob != "/" and glob.endswith("/")):
        raise GlobError(f"{glob!r} matches no channel: it has an empty part")
    if bad := next((c for c in glob if c in "$#" or c.isspace()), None):
        raise GlobError(f"{glob!r} matches no channel: no channel has {bad!r} in its name")


def is_recorded(channel: str, globs: Sequence[str]) -> bool:
    """Whether a recorder of ``globs`` (empty: of all) records ``channel``; an action stands for its parts."""
    names = (channel, whole_of(channel))
    return not globs or any(matches(name, glob) for name in names for glob in globs)


def matches(channel: str, glob: str) -> bool:
    """Whether ``channel`` matches ``glob``.

    ``*`` stands for anything within one part of the name, ``?`` for one character of it, ``**`` for
    anything across parts; ``/a/**`` also matches ``/a``.
    """
    pattern = "".join(_PATTERNS.get(piece) or re.escape(piece) for piece in _WILDCARD.split(glob))
    return re.fullmatch(pattern, channel, re.DOTALL) is not None
