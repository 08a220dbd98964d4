"""Sequence numbers: they show what was received twice, and what was not received.

Whoever publishes or calls numbers what it sends on each channel, from 0. This is the one rule by which all
read such numbers; what follows from it is each reader's own.
"""

from __future__ import annotations

from collections.abc import Hashable
from enum import Enum

from transports.bounded import BoundedDict


class Sequel(Enum):
    """How a number follows the one before it, of the same source on the same channel."""

    FIRST = 0
    """Nothing was received before; whether that is a loss, if it is not 0, the number does not tell."""
    NEXT = 1
    AGAIN = 2
    """It was received before, or it is from before what was received first: it is nothing new."""
    AFTER_A_GAP = 3
    """The numbers in between were not received yet."""
    ANEW = 4
    """Its source has started again, and numbers anew: what it sent last, before that, may be missing."""
    LATE = 5
    """It was passed over, and comes now: it is new, and less is missing."""


_NEXT = Sequel.NEXT
"""Looking up a member of an Enum takes as long as all else that is done for the next number."""

Last = tuple[int, int]
"""The newest number of a place, and its stamp in ns."""


KEPT_GAPS = 64
"""So many gaps of one place are remembered; of more, the oldest is not filled any more."""
_NEVER_NS = 2**63 - 1


class Skipped:
    """The numbers of one place that were passed over: each may still come, late.

    Attributes:
        due_ns: the first gap that is not reported yet ends before this stamp (ns).
    """

    __slots__ = ("_gaps", "due_ns")

    def __init__(self) -> None:
        self._gaps: list[tuple[int, int, int, int]] = []
        """The first and last number of each, the stamp before it and that after it (ns)."""
        self.due_ns = _NEVER_NS

    def skip(self, first: int, last: int, from_ns: int, until_ns: int) -> None:
        """``first`` to ``last`` were passed over, between two stamps."""
        self._gaps.append((first, last, from_ns, until_ns))
        del self._gaps[:-KEPT_GAPS]
        self._note_due()

    def fill(self, number: int) -> bool:
        """``number`` comes; whether it was passed over, and is not any more."""
        for place, (first, last, from_ns, until_ns) in enumerate(self._gaps):
            if first <= number <= last:
                halves = ((first, number - 1), (number + 1, last))
                left = [(a, b, from_ns, until_ns) for a, b in halves if a <= b]
                self._gaps[place : place + 1] = left
                self._note_due()
                return True
        return False

    def overdue(self, watermark_ns: int) -> list[tuple[int, int, int]]:
        """The gaps up to a stamp, which are lost: the last number of each, and the stamps around it (ns)."""
        lost = [gap for gap in self._gaps if gap[3] <= watermark_ns]
        if lost:
            self._gaps = [gap for gap in self._gaps if gap[3] > watermark_ns]
            self._note_due()
        return [(last, from_ns, until_ns) for _, last, from_ns, until_ns in lost]

    def _note_due(self) -> None:
        self.due_ns = min((gap[3] for gap in self._gaps), default=_NEVER_NS)


def sequel_of(
    last: Last | None, number: int, stamp_ns: int, skipped: Skipped | None = None, life: int = 0
) -> Sequel:
    """How ``number`` follows, of the same life of its source as far as that is known.

    A number that does not go up was received before, or was passed over, if its stamp is not newer; else it
    is a restarted node's. Where lives are known, one that was passed over is of this one, whatever its stamp.

    Args:
        last: what it follows; None: it is the first.
        number: the sequence number, from 0.
        stamp_ns: when it was sent, ns since the epoch.
        skipped: what was passed over; what comes late is taken out of it.
        life: of which both are (``Observation.life``); 0: that is not known.
    """
    if last is None:
        return Sequel.FIRST
    before, before_ns = last
    if number == before + 1:
        return Sequel.NEXT
    if number > before:
        return Sequel.AFTER_A_GAP
    is_newer = stamp_ns > before_ns
    if skipped is not None and (life or not is_newer) and skipped.fill(number):
        return Sequel.LATE
    return Sequel.ANEW if is_newer else Sequel.AGAIN


KEPT_LIVES = 2
"""So many earlier lives of a source are remembered: what they sent last may come late."""


class Sequence:
    """The numbers of one place.

    Attributes:
        life: of its source; 0 where that is not known.
        next: the number that should follow; negative while none has come.
        stamp: of the newest, ns.
        skipped: what was passed over of this life.
    """

    __slots__ = ("_earlier", "life", "next", "skipped", "stamp")

    def __init__(self) -> None:
        self.life = 0
        self.next = -1
        self.stamp = 0
        self.skipped = Skipped()
        self._earlier: BoundedDict[int, tuple[int, int, Skipped]] = BoundedDict(KEPT_LIVES)

    def follow(self, number: int, stamp_ns: int, life: int = 0) -> Sequel:
        """How ``number`` follows; it is the newest from now on, unless it comes AGAIN or LATE."""
        if life != self.life and life and self.life:
            if life in self._earlier:
                return self._straggle(number, stamp_ns, life)
            self.end_life()
            self._begin(number, stamp_ns, life)
            return Sequel.ANEW
        last = (self.next - 1, self.stamp) if self.next >= 0 else None
        sequel = sequel_of(last, number, stamp_ns, self.skipped, life)
        if sequel is Sequel.FIRST or sequel is Sequel.ANEW:
            self._begin(number, stamp_ns, life)
        elif sequel is Sequel.NEXT or sequel is Sequel.AFTER_A_GAP:
            if sequel is Sequel.AFTER_A_GAP:
                self.skipped.skip(self.next, number - 1, self.stamp, stamp_ns)
            self.next, self.stamp, self.life = number + 1, stamp_ns, life
        return sequel

    def end_life(self) -> None:
        """Its source numbers anew; what comes of before is told from that where lives are known."""
        if self.life and self.next >= 0:
            self._earlier[self.life] = self.next, self.stamp, self.skipped
        self.life, self.next, self.skipped = 0, -1, Skipped()

    def forget(self) -> None:
        """Something is not known to be received: the next number is a first one."""
        self.next, self.skipped = -1, Skipped()

    def _begin(self, number: int, stamp_ns: int, life: int) -> None:
        self.next, self.stamp, self.life, self.skipped = number + 1, stamp_ns, life, Skipped()

    def _straggle(self, number: int, stamp_ns: int, life: int) -> Sequel:
        following, before_ns, skipped = self._earlier[life]
        if number < following:
            return Sequel.LATE if skipped.fill(number) else Sequel.AGAIN
        if number > following:
            skipped.skip(following, number - 1, before_ns, stamp_ns)
        self._earlier[life] = number + 1, stamp_ns, skipped
        return Sequel.LATE


class Sequences:
    """The newest number of each place: of whatever is numbered together, as a source's messages on a channel.

    Args:
        most: places that are remembered; their names come from the wire, and never end. The one that was
            received first is forgotten first.

    Attributes:
        last: by place; those of forgotten ones are not there.
        complete: whether none was forgotten; if one was, it is FIRST once more.
    """

    __slots__ = ("complete", "last", "most")

    def __init__(self, most: int) -> None:
        self.most = most
        self.last: dict[Hashable, Sequence] = {}
        self.complete = True

    def follow(
        self, place: Hashable, number: int, stamp_ns: int, life: int = 0
    ) -> tuple[Sequel, Last | None]:
        """How ``number`` follows, and what; see :meth:`Sequence.follow`.

        Args:
            place: what it counts.
            number: from 0.
            stamp_ns: when it was sent, ns since the epoch.
            life: of its source; 0 where that is not known.
        """
        kept = self.last
        sequence = kept.get(place)
        if sequence is None:
            if len(kept) >= self.most:
                del kept[next(iter(kept))]
                self.complete = False
            sequence = kept[place] = Sequence()
            return sequence.follow(number, stamp_ns, life), None
        last = (sequence.next - 1, sequence.stamp)
        if number == sequence.next and life == sequence.life:  # nearly always; the rest is rare
            sequence.next, sequence.stamp = number + 1, stamp_ns
            return _NEXT, last
        return sequence.follow(number, stamp_ns, life), last
