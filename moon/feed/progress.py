"""Up to when all that a machine's own node did has been received (decision 13)."""

from __future__ import annotations

from collections import deque

KEPT_AHEAD = 1024
"""Observations ahead of a gap that are remembered."""
KEPT_HOLES = 16
"""Gaps of which it is remembered when they began."""


class Progress:
    """Follows the order numbers of one node.

    Attributes:
        reported_ns: all that the node did until this stamp (ns) was reported, and its reports were received.
        next: the number that follows.
        ahead: number and stamp of what came after a gap.
        gap: what is missing and not waited for any more happened before this stamp (ns).
        holes: the newest gaps: after when, and before when (ns), what is missing happened.
        answer: the number that followed when the node was asked how far it is, and when that was (ns);
            None where all until then has been received, or it was not asked.
        is_whole: nothing that the node did is missing: all was received from number 0 on, without a gap.
    """

    __slots__ = ("ahead", "answer", "gap", "holes", "is_whole", "next", "reported_ns")

    def __init__(self) -> None:
        self.ahead: dict[int, int] = {}
        self.next = 0
        self.reported_ns = 0
        self.gap = 0
        self.holes: deque[tuple[int, int]] = deque(maxlen=KEPT_HOLES)
        self.answer: tuple[int, int] | None = None
        self.is_whole = True

    def restart(self) -> None:
        """The node counts anew, or nothing is known any more."""
        self.ahead.clear()
        self.holes.clear()
        self.next = 0
        self.reported_ns = 0
        self.answer = None
        self.is_whole = True

    def answered(self, number: int, stamp: int) -> None:
        """The node says that all that it did until ``stamp`` (ns) has a number below ``number``."""
        self.answer = (number, stamp)
        self._look_at_answer()

    def _look_at_answer(self) -> None:
        if self.answer is not None and self.next >= self.answer[0]:
            if self.next == self.answer[0]:
                self.reported_ns = max(self.reported_ns, self.answer[1])
            self.answer = None

    def take(self, order: int, stamp: int, watermark: int) -> None:
        """The node did something.

        Args:
            order: its number.
            stamp: when (ns).
            watermark: all that happened until then has been received or is lost (ns).
        """
        if order == self.next:
            self._go_on(stamp)
        elif order > self.next:
            ahead = self.ahead
            ahead[order] = stamp
            if len(ahead) > KEPT_AHEAD:
                del ahead[next(iter(ahead))]
            self.advance(watermark)

    def advance(self, watermark: int) -> None:
        """What is missing before something that happened until ``watermark`` (ns), or that the node has said
        to have reported until then, does not come any more.
        """
        ahead = self.ahead
        passed = [number for number, when in ahead.items() if when <= watermark]
        if passed:
            number = max(passed)
            stamp = ahead.pop(number)
            self._skip_to(number, stamp)
            self._go_on(stamp)
        if self.answer is not None and self.answer[1] <= watermark:
            number, stamp = self.answer
            self._skip_to(number, stamp + 1)
            self.reported_ns = stamp
            self._take_ahead()

    def _skip_to(self, number: int, gap_ns: int) -> None:
        """What is missing before ``number`` happened before ``gap_ns``, and does not come any more."""
        for passed in [before for before in self.ahead if before < number]:
            del self.ahead[passed]
        self.gap = gap_ns
        self.holes.append((self.reported_ns, gap_ns))
        self.is_whole = False
        self.next = number

    def missing(self, since_ns: int, until_ns: int) -> list[tuple[int, int]]:
        """Something that happened after ``since_ns`` and before ``until_ns`` is missing.

        Returns:
            After when and before when it happened (ns), for each stretch in which it may have.
        """
        holes = list(self.holes)
        if len(holes) == KEPT_HOLES and holes[0][0] > since_ns:
            holes.insert(0, (since_ns, holes[0][0]))  # there may have been others before
        if self.ahead and self.reported_ns < until_ns:
            holes.append((self.reported_ns, until_ns))
        return [
            (max(after_ns, since_ns), min(before_ns, until_ns))
            for after_ns, before_ns in holes
            if before_ns > since_ns and after_ns < until_ns
        ] or [(since_ns, until_ns)]

    def _go_on(self, stamp: int) -> None:
        self.next += 1
        self.reported_ns = stamp
        self._take_ahead()

    def _take_ahead(self) -> None:
        ahead = self.ahead
        while ahead and self.next in ahead:
            self.reported_ns = ahead.pop(self.next)
            self.next += 1
        if self.answer is not None:
            self._look_at_answer()
