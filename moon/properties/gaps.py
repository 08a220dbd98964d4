"""Which ports may have had any value, and until when, because messages of their channels were lost."""

from __future__ import annotations

from bisect import insort
from collections.abc import Iterable

from moon.properties.network import NEVER

Gap = tuple[int, int, str, str]
"""(start, end, port, reason): messages stamped in ``[start, end)`` that would have set ``port``."""


class Gaps:
    """The losses that were reported and have not wholly passed, by port.

    They may be reported in any order and may overlap; a port is open until the last of those that have
    begun has ended.
    """

    def __init__(self) -> None:
        self.coming: list[Gap] = []
        """Those that have not begun, in order."""
        self.open: dict[str, tuple[int, str]] = {}
        """Per port that a lost message may set now: the instant from which on none does, and why."""

    def add(self, ports: Iterable[str], start: int, end: int, reason: str) -> None:
        """Messages stamped in ``[start, end)`` that would have set one of ``ports`` were lost."""
        for port in ports:
            insort(self.coming, (start, end, port, reason))

    @property
    def next_ns(self) -> int:
        """The earliest instant at which one begins or ends, or ``NEVER``."""
        begins = self.coming[0][0] if self.coming else NEVER
        return min(begins, *(end for end, _ in self.open.values())) if self.open else begins

    @property
    def is_empty(self) -> bool:
        """Whether none is left."""
        return not (self.coming or self.open)

    def pass_to(self, now: int) -> tuple[dict[str, str], list[str]]:
        """The time is ``now``: the ports of the gaps that began (with the reason), and those closed."""
        begun: dict[str, str] = {}
        count = 0
        for start, end, port, reason in self.coming:
            if start > now:
                break
            count += 1
            begun[port] = reason
            if port not in self.open or self.open[port][0] < end:
                self.open[port] = (end, reason)
        del self.coming[:count]
        closed = [port for port, (end, _) in self.open.items() if end <= now]
        for port in closed:
            del self.open[port]
        return begun, closed
