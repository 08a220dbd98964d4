"""What a judge is, and what it is told."""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum
from typing import Protocol, TypeVar

import msgspec

from moon.oracle.bounds import FOREVER
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
    OWN_CLOCK_SET = 4
    """The same, and stamps begin elsewhere: the clock of the monitor was set."""
    NOT_RECEIVED = 5
    """Of its channel, or of its source's calls there, not all can be received; this is said at every turn."""
    MAY_NOT_BE_TAKEN = 6
    """Its source need not take what is published on its channel; this is said at every turn."""
    OTHER_TIME = 7
    """Its source's timers follow another clock than stamps do; this is said at every turn."""
    CONTESTED = 8
    """Several nodes have its source's name."""


class Gap(msgspec.Struct, frozen=True):
    """Something was not received, or is not relied on.

    Attributes:
        channel: on which; empty: on any.
        source: from whom; empty: from anybody.
        from_ns, until_ns: what is missing has a stamp in ``[from_ns, until_ns)``, ns since the epoch.
        why: for people.
        kind: of what is missing; None: of any.
        cause: why it is missing.
    """

    channel: str
    source: str
    from_ns: int
    until_ns: int
    why: str
    kind: ObservationKind | None = None
    cause: Missing = Missing.NOT_JUDGED

    @property
    def stamp_ns(self) -> int:
        """Since when it matters."""
        return self.from_ns


class NodeChange(msgspec.Struct, frozen=True):
    """A node came up, or went away.

    Attributes:
        node: its name.
        is_up: whether it is there now.
        since_ns: when it began to connect; 0: that is not known, or it went away.
        now_ns: when that was known, ns since the epoch.
        clock: by which host's clock it stamps (``TellsClocks.clock_of``); "": that is not known.
    """

    node: str
    is_up: bool
    since_ns: int
    now_ns: int
    clock: str = ""

    @property
    def stamp_ns(self) -> int:
        """When it happened, as far as is known."""
        return self.now_ns


class Intake(msgspec.Struct):
    """What was found of an observation that was received.

    Attributes:
        seen: the observation.
        now_ns: when it was taken, ns since the epoch.
        judged: as a machine's judge takes it: with all fields of its type, and stamped as early as it may
            have been sent; None: it is not to be judged.
        sequel: how its number follows the one before.
        gaps: what is missing before it.
    """

    seen: Observation
    now_ns: int
    judged: Observation | None = None
    sequel: Sequel = Sequel.NEXT
    gaps: tuple[Gap, ...] = ()

    def miss(self, gap: Gap | None) -> None:
        """``gap`` was found; None: none was."""
        if gap is not None:
            self.gaps = (*self.gaps, gap)


Seen_contra = TypeVar("Seen_contra", contravariant=True)


class Judge(Protocol[Seen_contra]):
    """Judges what happened, and says what it finds as verdicts.

    It is told of observations in the order in which they happened, never late and never twice, and of what is
    missing before what came after that. It keeps no window, counts no numbers and knows no latency bound.
    What it finds violated is reported when nothing can be missing that it was not told of. A class that
    inherits from this one needs no more than ``name`` and :meth:`observe`.

    Attributes:
        name: of what it judges.
    """

    name: str

    def concerns(self, channel: str, source: str, kind: ObservationKind) -> bool:
        """Whether such an observation, or that it is missing, tells it something."""
        return True

    def observe(self, seen: Seen_contra) -> Iterable[Verdict]:
        """Take what happened next."""
        ...

    def gap(self, gap: Gap) -> Iterable[Verdict]:
        """Something is missing; once more before each thing that may have come after some of it."""
        return ()

    def node_changed(self, change: NodeChange) -> Iterable[Verdict]:
        """A node came up, or went away."""
        return ()

    def advance(self, until_ns: int) -> Iterable[Verdict]:
        """All that happened until then (ns since the epoch) was handed over."""
        return ()

    @property
    def due_ns(self) -> int:
        """From then on (ns) it decides something if nothing more happens; by default it does not."""
        return FOREVER
