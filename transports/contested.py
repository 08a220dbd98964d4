"""Names that several nodes have at once: from which of them something comes is not known."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

LASTS_NS = 5 * 10**9
"""What a node has sent has come, or comes too late to be judged, so long after it went away."""
_AT_PRESENT = 1 << 63


class Contested:
    """Names that several nodes have, or had of late. One thread changes it; others may read.

    Args:
        now_ns: a clock that nobody sets (ns).
    """

    def __init__(self, now_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._now_ns = now_ns
        self._until_ns: dict[str, int] = {}
        """By name; replaced whole."""

    def note(self, names: Iterable[str]) -> None:
        """At present several nodes have each of ``names``, and no others."""
        present = dict.fromkeys(names, _AT_PRESENT)
        if present or self._until_ns:
            over_ns = self._now_ns() + LASTS_NS
            past = {name: min(until, over_ns) for name, until in self._of_late()}
            self._until_ns = past | present

    def begin(self, name: str) -> None:
        """Several nodes have ``name`` now."""
        self._until_ns = dict(self._of_late()) | {name: _AT_PRESENT}

    def end(self, name: str) -> None:
        """Several nodes had ``name`` until now."""
        self._until_ns = dict(self._of_late()) | {name: self._now_ns() + LASTS_NS}

    def _of_late(self) -> Iterable[tuple[str, int]]:
        now_ns = self._now_ns()
        return ((name, until) for name, until in self._until_ns.items() if until >= now_ns)

    def names(self) -> set[str]:
        """Those that several nodes have at present."""
        return {name for name, until in self._until_ns.items() if until == _AT_PRESENT}

    def is_contested(self, name: str) -> bool:
        """Whether several nodes have it, or had of late."""
        until_ns = self._until_ns.get(name)
        return until_ns is not None and until_ns >= self._now_ns()
