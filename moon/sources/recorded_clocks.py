"""What the clocks of a recording were: how late entries were recorded after they were stamped tells it.

Late are the stamps of a clock that is behind, and what a link or the recorder kept.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Iterator

import msgspec

from moon.sources.on_time import USUAL_NS

MAX_PLACES = 10_000
MANY_KEPT = 100
"""So many links are looked at that may have kept an entry."""
_SECOND_NS = 1_000_000_000
_SHOWN = 2
"""So many calls or messages show how a clock is set (decision 54)."""


class Kept(msgspec.Struct, frozen=True):
    """What a link or the recorder kept for a while (ns): it is late, and its stamps are right.

    Attributes:
        first_ns: the first stamp.
        since_ns, until_ns: when it was recorded.
    """

    first_ns: int
    since_ns: int
    until_ns: int


class Lags:
    """By how much some entries were recorded after they were stamped (ns).

    Attributes:
        count: of the entries.
        least_ns, most_ns: the least, and the most.
        for_a_while_ns: by how much at least for a while, if that was their clock; 0: never.
        late_since: the stamp of the first since which all were late, and when that was recorded; None: it
            was not.
        received_ns: when the last one was recorded.
        is_fresh: whether something was stamped while it was recorded.
        is_unset: whether stamps that nobody set are among others: from before the recording, where no
            publisher has kept them, or none, so that they are those of reception.
    """

    def __init__(self) -> None:
        self.count = 0
        self.least_ns = self.most_ns = self.for_a_while_ns = 0
        self.is_fresh = self.is_unset = False
        self._stamp_ns = -1
        self.late_since: tuple[int, int] | None = None
        self.received_ns = 0
        self._went_back = False

    def note(self, stamp_ns: int, received_ns: int, bound_ns: int, timely_ns: int) -> Kept | None:
        """Take note of the next one.

        Late are the stamps of a clock that is behind, and what a link or the recorder kept. The latter comes
        all at once. So it was the clock where entries that are late come as they were stamped, one after the
        other, while others came in time, or after stamps that were higher.

        Args:
            stamp_ns: its stamp.
            received_ns: when it was recorded.
            bound_ns: what comes within this time is not late.
            timely_ns: when something was recorded last that was in time.

        Returns:
            What a link or the recorder kept, up to this one; None: that does not show.
        """
        lag_ns = received_ns - stamp_ns
        kept = self._kept(stamp_ns, received_ns, bound_ns)
        self.least_ns = lag_ns if not self.count else min(self.least_ns, lag_ns)
        self.most_ns = lag_ns if not self.count else max(self.most_ns, lag_ns)
        self.count += 1
        self.received_ns = received_ns
        if lag_ns <= bound_ns:
            self.late_since = None
        elif self.late_since is None:
            self.late_since = (stamp_ns, received_ns)
            self._went_back = stamp_ns < self._stamp_ns - bound_ns
        else:
            first_ns, since_ns = self.late_since
            stamped_ns, recorded_ns = stamp_ns - first_ns, received_ns - since_ns
            is_steady = stamped_ns > bound_ns and recorded_ns > stamped_ns // 2
            if is_steady and (self._went_back or timely_ns > since_ns) and not self.for_a_while_ns:
                self.for_a_while_ns = min(lag_ns, since_ns - first_ns)
        self._stamp_ns = stamp_ns
        return kept

    def _kept(self, stamp_ns: int, received_ns: int, bound_ns: int) -> Kept | None:
        """What was kept comes faster than it was stamped; a clock that is set right again does not."""
        if self.late_since is None:
            return None
        first_ns, since_ns = self.late_since
        stamped_ns, recorded_ns = stamp_ns - first_ns, received_ns - since_ns
        is_late = received_ns - stamp_ns > bound_ns
        most_ns = (stamped_ns - bound_ns) // 2 if is_late else USUAL_NS
        if stamped_ns <= bound_ns or recorded_ns > most_ns:
            return None
        return Kept(first_ns, since_ns, received_ns)

    def begin_again(self) -> None:
        """The recorder's clock was set back: what comes is not compared with what was."""
        self._stamp_ns, self.late_since = -1, None


class SetBack(msgspec.Struct, frozen=True):
    """A clock was set back: what is stamped from the first until the second time (ns) is in no order.

    Attributes:
        node: whose it is; empty: of who publishes on ``channel``.
        received_ns: when the first entry that is stamped anew was recorded.
    """

    node: str
    channel: str
    from_ns: int
    until_ns: int
    by_ns: int
    received_ns: int


class _Back(msgspec.Struct):
    """A clock's stamps went back, at an entry recorded at ``received_ns``, from ``until_ns`` to ``from_ns``.

    Attributes:
        before_ns: how late what came fastest in the second before was recorded.
        after_ns: the same of the second after it, as far as it is known.
        count: of the entries since.
    """

    received_ns: int
    from_ns: int
    until_ns: int
    before_ns: int
    after_ns: int
    count: int = 1


class Fastest:
    """By how much one clock may be behind: what came fastest from it in a second was recorded so late (ns).

    A clock that is set stays so for a second, and for two calls or messages, or is so when recording begins
    or ends (decision 54). So a second is longer where fewer than two of them came in it.
    """

    def __init__(self) -> None:
        self._most_ns = self._last_ns = 0
        self._newest_ns = 0
        """The highest stamp."""
        self._back: deque[_Back] = deque()
        """Where stamps went back, and the second after that has not ended."""
        self._set_back: deque[_Back] = deque(maxlen=MAX_PLACES)
        self._received: deque[int] = deque(maxlen=MAX_PLACES)
        """Of each call and each message of the last second, when it was recorded."""
        self._least: deque[tuple[int, int]] = deque(maxlen=MAX_PLACES)
        """When those were that came faster than all after them in that second, and how fast."""
        self._seconds: deque[int] = deque(maxlen=3)
        """How fast what came fastest was in each of the last seconds that have ended."""
        self._ends_ns = 0
        """The next of them ends then."""

    def note(self, received_ns: int, lag_ns: int, is_answer: bool) -> None:
        """Take note of the next one; an answer is of a call of which note was taken."""
        received, least = self._received, self._least
        if least:  # entries may be out of order by a little
            received_ns = max(received_ns, least[-1][0])
            self._note_second(received_ns)
        else:
            self._most_ns = max(self._most_ns, lag_ns)
        self._note_order(received_ns, lag_ns)
        if not is_answer or not received:
            received.append(received_ns)
        while least and least[-1][1] >= lag_ns:
            least.pop()
        least.append((received_ns, lag_ns))
        self._last_ns = lag_ns

    def _note_second(self, until_ns: int) -> None:
        """Take note of the second before that in which the next one came.

        A clock that runs slow is behind, at the end of a second, by as much more as in each of two before.
        """
        received, least = self._received, self._least
        while len(received) > _SHOWN and received[0] < until_ns - _SECOND_NS:
            received.popleft()
        while least[0][0] < received[0]:
            least.popleft()
        if least[-1][0] >= self._ends_ns:
            self._seconds.append(least[0][1])
            self._ends_ns = least[-1][0] + _SECOND_NS
        rises_ns = [after - before for before, after in itertools.pairwise(self._seconds)]
        behind_ns = least[0][1] + max(min(rises_ns, default=0), 0)
        self._most_ns = max(self._most_ns, behind_ns)

    def _note_order(self, received_ns: int, lag_ns: int) -> None:
        """Take note of a stamp that is before another of what was recorded before it."""
        stamp_ns = received_ns - lag_ns
        while self._back and self._is_over(self._back[0], received_ns):
            self._set_back.append(self._back.popleft())
        for back in self._back:
            back.after_ns = min(back.after_ns, lag_ns)
            back.count += 1
        if stamp_ns >= self._newest_ns:
            self._newest_ns = stamp_ns
        elif len(self._back) < MANY_KEPT:
            before_ns = self._least[0][1]
            self._back.append(_Back(received_ns, stamp_ns, self._newest_ns, before_ns, lag_ns))
            self._newest_ns = stamp_ns  # what comes now is compared with that

    @staticmethod
    def _is_over(back: _Back, received_ns: int) -> bool:
        return back.count >= _SHOWN and received_ns > back.received_ns + _SECOND_NS

    def set_back(self, least_ns: int) -> Iterator[tuple[_Back, int]]:
        """Where it was by ``least_ns`` or more, and by how much.

        What the network delayed comes after what was stamped later, too; but not all of a second does.
        """
        for back in (*self._set_back, *self._back):
            by_ns = back.after_ns - back.before_ns
            if by_ns >= max(least_ns, back.until_ns - back.from_ns - least_ns):
                yield back, by_ns

    @property
    def most_ns(self) -> int:
        """In the second in which that was most, and at either end."""
        return max(self._most_ns, self._last_ns)

    def begin_again(self) -> None:
        """The recorder's clock was set back: what comes is not compared with what was."""
        self._most_ns = self.most_ns
        self._received.clear()
        self._least.clear()
        self._seconds.clear()
        self._ends_ns = self._newest_ns = 0
        self._set_back += self._back
        self._back.clear()
