"""What a watch is given: where it listens, and who takes its verdicts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from moon.verdict import Verdict
from transports.interface import Observation, Tap, Timer


class Connection(Protocol):
    """What a watch needs of a transport."""

    def now_ns(self) -> int:
        """See ``Transport.now_ns``."""
        ...

    def tap(self, channels: Sequence[str], handler: Callable[[Observation], None]) -> Tap:
        """See ``Transport.tap``."""
        ...

    def watch_nodes(self, handler: Callable[[str, bool], None]) -> None:
        """See ``Transport.watch_nodes``."""
        ...

    def up_since(self, name: str) -> int:
        """See ``Transport.up_since``."""
        ...

    def every(self, period_s: float, handler: Callable[[], None]) -> Timer:
        """See ``Transport.every``."""
        ...

    def post(self, handler: Callable[[], None]) -> None:
        """See ``Transport.post``."""
        ...


def repair_ns(connection: Connection) -> int:
    """How long after it was held up a monitor cannot tell yet what is missing from what is on its way.

    A transport whose middleware drops what a process that stands still does not take, and sends it again
    later, says so by a constant ``REPAIR_S``; others deliver late, and in order.
    """
    return round(float(getattr(connection, "REPAIR_S", 0.0)) * 1e9)


class Sink(Protocol):
    """Takes verdicts."""

    def take(self, verdict: Verdict) -> None:
        """Take one."""
        ...
