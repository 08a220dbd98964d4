"""What a judge is, and what it is handed by the code that knows how observations arrive (``moon.feed``)."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import Protocol

from moon.verdict import Verdict
from transports.interface import Observation, ObservationKind
from transports.sequences import Sequel


class Missing(Enum):
    """Why something is missing."""

    NOT_JUDGED = 0
    """It was not received, or cannot be judged, and no number shows that."""
    NUMBERED = 1
    """The numbers of its source show that it was not received."""
    CLOCK_SET = 2
    """The clock of its source's host was set: stamps of before and of after are not compared."""
    ANEW = 3
    """Nothing is known of what anybody did: all begin in the middle of the run."""
    SET_BACK = 4
    """The same, and stamps begin elsewhere: the clock of the monitor was set back."""


class Gap:
    """Something was not received, or is not relied on.

    Attributes:
        channel: on which; empty: on any.
        source: from whom; empty: from anybody.
        from_ns, until_ns: what is missing has a stamp in ``[from_ns, until_ns)``, ns since the epoch.
        why: for people.
        kind: of what is missing; None: of any.
        cause: why it is missing.
    """

    __slots__ = ("cause", "channel", "from_ns", "kind", "source", "until_ns", "why")

    def __init__(
        self,
        channel: str,
        source: str,
        from_ns: int,
        until_ns: int,
        why: str,
        kind: ObservationKind | None = None,
        cause: Missing = Missing.NOT_JUDGED,
    ) -> None:
        self.channel = channel
        self.source = source
        self.from_ns = from_ns
        self.until_ns = until_ns
        self.why = why
        self.kind = kind
        self.cause = cause


class Intake:
    """What was found of an observation that was received.

    Attributes:
        seen: the observation.
        judged: as a machine's judge takes it: with all fields of its type, and stamped as early as it may
            have been sent; None: it is not to be judged.
        sequel: how its number follows the one before.
        gaps: what is missing before it.
    """

    __slots__ = ("gaps", "judged", "seen", "sequel")

    def __init__(self, seen: Observation) -> None:
        self.seen = seen
        self.judged: Observation | None = None
        self.sequel = Sequel.NEXT
        self.gaps: tuple[Gap, ...] = ()

    def miss(self, gap: Gap | None) -> None:
        """``gap`` was found; None: none was."""
        if gap is not None:
            self.gaps = (*self.gaps, gap)


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
