"""What a judge is, to the code that knows that observations arrive late, twice or not at all."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from moon.verdict import Verdict
from transports.interface import Observation, ObservationKind


class Gap:
    """Something was not received, or is not relied on.

    Attributes:
        channel: on which; empty: on any.
        source: from whom; empty: from anybody.
        from_ns, until_ns: what is missing has a stamp in ``[from_ns, until_ns)``, ns since the epoch.
        why: for people.
        kind: of what is missing; None: of any.
    """

    __slots__ = ("channel", "from_ns", "kind", "source", "until_ns", "why")

    def __init__(
        self,
        channel: str,
        source: str,
        from_ns: int,
        until_ns: int,
        why: str,
        kind: ObservationKind | None = None,
    ) -> None:
        self.channel = channel
        self.source = source
        self.from_ns = from_ns
        self.until_ns = until_ns
        self.why = why
        self.kind = kind


class Judge(Protocol):
    """Judges what happened, handed to it in order: never late, never twice.

    It keeps no window, counts no numbers and knows no latency bound.
    """

    def concerns(self, channel: str, source: str, kind: ObservationKind) -> bool:
        """Whether such an observation tells it something."""
        ...

    def observe(self, event: Observation) -> Sequence[Verdict]:
        """Take what happened next."""
        ...

    def gap(self, gap: Gap) -> Sequence[Verdict]:
        """Something is missing; reported before what came after it."""
        ...

    def advance(self, until_ns: int) -> Sequence[Verdict]:
        """All that happened until then (ns) was handed over."""
        ...

    @property
    def due_ns(self) -> int:
        """From then on (ns) it decides something if nothing more happens; FOREVER: it does not."""
        ...
