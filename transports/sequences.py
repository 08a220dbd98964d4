"""Sequence numbers: they show what was received twice, and what was not received.

Whoever publishes or calls numbers what it sends on each channel, from 0. This is the one rule by which all
read such numbers; what follows from it is each reader's own.
"""

from __future__ import annotations

from enum import Enum


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


KEPT_LIVES = 2
"""So many earlier lives of a source are remembered: what they sent last may come late."""


NONE = -2
"""No number, and not one that is missing either (-1)."""


class Sequence:
    """The numbers of what is numbered together, such as a source's messages on a channel.

    Attributes:
        life: of its source; 0 where that is not known.
        next: the number that should follow; negative while none has come.
        stamp: of the newest, ns.
        skipped: what was passed over of this life.
        unknown_until: what came before this was not received (ns), where the first number was not 0.
        left_at: the number that should have followed when nothing more was known of any; or ``NONE``.
    """

    __slots__ = ("_earlier", "left_at", "life", "next", "skipped", "stamp", "unknown_until")

    def __init__(self) -> None:
        self.life = 0
        self.next = -1
        self.stamp = 0
        self.skipped = Skipped()
        self.unknown_until = 0
        self.left_at = NONE
        self._earlier: dict[int, tuple[int, int, Skipped]] = {}

    def follow(self, number: int, stamp_ns: int, life: int = 0) -> Sequel:
        """How ``number`` follows; it is the newest from now on, unless it comes AGAIN or LATE.

        A number that does not go up was received before, or was passed over, if its stamp is not newer; else
        it is a restarted node's. Where lives are known, one that was passed over is of this one, whatever its
        stamp.

        Args:
            number: from 0.
            stamp_ns: when it was sent, ns since the epoch.
            life: of its source (``Observation.life``); 0 where that is not known.
        """
        if life != self.life and life and self.life:
            if life in self._earlier:
                return self._straggle(number, stamp_ns, life)
            self.end_life()
            return self._begin(Sequel.ANEW, number, stamp_ns, life)
        following = self.next
        if following < 0:
            return self._begin(Sequel.FIRST, number, stamp_ns, life)
        if number < following:
            is_newer = stamp_ns > self.stamp
            if (life or not is_newer) and self.skipped.fill(number):
                return Sequel.LATE
            return self._begin(Sequel.ANEW, number, stamp_ns, life) if is_newer else Sequel.AGAIN
        if number > following:
            self.skipped.skip(following, number - 1, self.stamp, stamp_ns)
        self.next, self.stamp, self.life = number + 1, stamp_ns, life
        return Sequel.AFTER_A_GAP if number > following else Sequel.NEXT

    def end_life(self) -> None:
        """Its source numbers anew; what comes of before is told from that where lives are known."""
        if self.life and self.next >= 0:
            self._earlier[self.life] = self.next, self.stamp, self.skipped
            if len(self._earlier) > KEPT_LIVES:
                del self._earlier[next(iter(self._earlier))]
        self.life, self.left_at = 0, NONE
        self._forget()

    def forget(self) -> None:
        """Something is not known to be received: the next number is a first one."""
        self.left_at = self.next
        self._forget()

    def _forget(self) -> None:
        self.next, self.skipped, self.unknown_until = -1, Skipped(), 0

    def _begin(self, sequel: Sequel, number: int, stamp_ns: int, life: int) -> Sequel:
        self.next, self.stamp, self.life, self.skipped = number + 1, stamp_ns, life, Skipped()
        # of a source that has started again, the last ones before that may be missing
        is_whole = sequel is Sequel.FIRST and number <= 0
        self.unknown_until = 0 if is_whole else stamp_ns
        return sequel

    def _straggle(self, number: int, stamp_ns: int, life: int) -> Sequel:
        following, before_ns, skipped = self._earlier[life]
        if number < following:
            return Sequel.LATE if skipped.fill(number) else Sequel.AGAIN
        if number > following:
            skipped.skip(following, number - 1, before_ns, stamp_ns)
        self._earlier[life] = number + 1, stamp_ns, skipped
        return Sequel.LATE
