"""What a recording holds, in the order in which it happened to who recorded it.

A monitor's verdicts depend on more than what it received: on when it began, which nodes came up and went
away, and on its own turns, at which time passes for its oracles. A recording keeps all of it, so that
who reads it later is handed the same, in the same order, at the same instants. Most entries are
observations, and stand for themselves; all have ``received_ns``: when they reached the recorder, ns
since the epoch on its clock. That is what ``log_time`` is in the file (``docs/recording-format.md``).

Bags that others made have nothing but observations.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import msgspec

from moon.verdict import Verdict
from transports.interface import BlindSpot, BlindSpotKind, Observation

Instant = Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1)]
"""ns since the epoch; what is read of a file is one that arithmetic and calendars can bear."""

END_OF_TIME_NS = 9_214_646_400_000_000_000
"""The year 2262, in which 64 bits of ns end: what is stamped so late has a broken stamp."""

UNUSUAL_NS = 100_000_000
"""After this long without a turn or an observation, both clocks are looked at: the reader has to know whether
nothing happened or the clock was set."""


def makes_sense(stamp_ns: int) -> bool:
    """Whether something can have happened then."""
    return 0 <= stamp_ns < END_OF_TIME_NS


class Began(msgspec.Struct, frozen=True, tag="began", tag_field="entry"):
    """The recorder listens from now on. The first entry; once more where it went on after a gap.

    Attributes:
        received_ns: now.
        node: the recorder's node.
        transport: the middleware: ``zenoh``, ``ros2``, ``simulated``.
        paced: whether a monitor was recorded, with its turns (:class:`Pulse`). If not, who checks the
            recording takes its own turns.
        repair_s: the middleware's (``Listener.repair_s``).
        whole: whether all is received from here on, not only from where it says so (:class:`Whole`).
        globs: the channels that are recorded (``moon.tap.selection.matches``); empty: all.
        clock: the recorder's own (``TellsClocks.clock_of``); "": nodes did not say by which clock they stamp.
    """

    received_ns: Instant
    node: str = ""
    transport: str = ""
    paced: bool = False
    repair_s: float = 0.0
    whole: bool = True
    globs: tuple[str, ...] = ()
    clock: str = ""


class Whole(msgspec.Struct, frozen=True, tag="whole", tag_field="entry"):
    """From now on the recorder receives all that there is (``Tap.is_complete``).

    What was received before is true, but an answer may be without its question: nothing can be concluded
    from what is not there.

    Attributes:
        received_ns: now.
    """

    received_ns: Instant


class NodeChange(msgspec.Struct, frozen=True, tag="node", tag_field="entry"):
    """A node came up or went away (``Listener.watch_nodes``).

    Attributes:
        received_ns: when this was reported to the recorder.
        node: its name.
        up: whether it is up now.
        since_ns: when it began to connect, on its clock (``Listener.up_since``); 0: not known.
        reported: whether it was reported to the recorder (``told`` in JSON). If not, the node was up before,
            and all that changed is ``since_ns``, or ``contested``.
        contested: whether several claim to be it (``Tap.is_contested``): nothing that comes of it is judged.
        clock: by which host's clock it stamps (``TellsClocks.clock_of``, of the recorder); "": not known.
    """

    received_ns: Instant
    node: str
    up: bool
    since_ns: Instant = 0
    reported: bool = msgspec.field(default=True, name="told")
    contested: bool = False
    clock: str = ""


class Turn(StrEnum):
    """What makes a monitor act when nothing is received."""

    TIMER = "timer"
    """Its timer ran out (``Transport.after``)."""
    POSTED = "posted"
    """What it left for later is done now (``Transport.post``)."""
    CLOCK = "clock"
    """It looks at both clocks, because much time has passed since it last did."""


class Pulse(msgspec.Struct, frozen=True, gc=False):
    """A turn of the monitor that was recorded: nothing that is received later was known to it.

    A recorder that is no monitor takes none; it looks at both clocks now and then (:attr:`Turn.CLOCK`).

    Attributes:
        received_ns: the time of day of the turn, as the monitor saw it.
        turn: what it was.
        monotonic_ns: the same instant on a clock that nobody sets.
    """

    received_ns: int
    turn: Turn
    monotonic_ns: int


def set_by_ns(before: Pulse | None, pulse: Pulse) -> int:
    """By how much the clock was set forward between two looks at both (None: nothing is known)."""
    if before is None:
        return 0
    return pulse.received_ns - before.received_ns - (pulse.monotonic_ns - before.monotonic_ns)


class Missed(msgspec.Struct, frozen=True, tag="missed", tag_field="entry"):
    """The recorder's tap could not receive or decode something (``Tap.problems``).

    Attributes:
        received_ns: when it was reported.
        text: one sentence; the latest that begins the same way counts.
        channel, node, kind: what the tap did not know from then on (``transports.interface.BlindSpot``);
            without text, it did.
    """

    received_ns: Instant
    text: str
    channel: str = ""
    node: str = ""
    kind: BlindSpotKind | None = None

    @property
    def blind_spot(self) -> BlindSpot | None:
        """What was not known; None: it was nothing of that sort."""
        if self.kind is not None:
            return BlindSpot(self.kind, self.channel, self.node)
        if self.channel and self.node:  # files of before have no kinds
            return BlindSpot(BlindSpotKind.MAY_NOT_BE_TAKEN, self.channel, self.node)
        if self.channel:
            return BlindSpot(BlindSpotKind.NOT_RECEIVED, self.channel)
        return BlindSpot(BlindSpotKind.OTHER_TIME, "", self.node) if self.node else None


class ReportedVerdict(msgspec.Struct, frozen=True):
    """A verdict that the monitor that was recorded reported then.

    Attributes:
        received_ns: when.
        verdict: what.
    """

    received_ns: int
    verdict: Verdict


class Ended(msgspec.Struct, frozen=True, tag="ended", tag_field="entry"):
    """The recorder stopped in good order. A recording without it was cut off.

    Attributes:
        received_ns: when.
    """

    received_ns: Instant


class Ending(msgspec.Struct, frozen=True, tag="ending", tag_field="entry"):
    """Who runs the system begins to end its nodes: from now on none of them owes anything.

    Attributes:
        received_ns: when the recorder was told.
    """

    received_ns: Instant


class Answered(msgspec.Struct, frozen=True, tag="answered", tag_field="entry"):
    """A node answered the monitor that was recorded how far it had reported (``Tap.ask``).

    Attributes:
        received_ns: when.
        node: which.
        stamp_ns, next_order, clock_ns, asked_ns, life: its answer (``transports.interface.Answer``);
            recordings of before do not say the last three.
    """

    received_ns: Instant
    node: str
    stamp_ns: Instant
    next_order: Instant
    clock_ns: Instant = 0
    asked_ns: Instant = 0
    life: Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)] = 0


Event = Began | Whole | NodeChange | Missed | Answered | Ending | Ended
"""What is rare, and kept as JSON; ``entry`` tells which it is."""

Entry = Observation | Event | Pulse | ReportedVerdict
