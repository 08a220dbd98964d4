"""What a watch is given: where it listens, and who takes its verdicts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from moon.verdict import Verdict
from transports.interface import Observation, Tap, Timer


class Connection(Protocol):
    """What a watch needs of a transport."""

    @property
    def repair_s(self) -> float:
        """See ``Transport.repair_s``."""
        ...

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

    def after(self, delay_s: float, handler: Callable[[], None]) -> Timer:
        """See ``Transport.after``."""
        ...

    def post(self, handler: Callable[[], None]) -> None:
        """See ``Transport.post``."""
        ...


class Sink(Protocol):
    """Takes verdicts."""

    def take(self, verdict: Verdict) -> None:
        """Take one."""
        ...
