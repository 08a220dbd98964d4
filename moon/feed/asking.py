"""A node is asked how far it has reported: where something is due and has not come, whether it did more.

A node that numbers its reports answers up to which number it has reported everything, and until when
(``Tap.ask``). Once all of that was received its silence is known, and is not waited for any longer. A node
that does not answer is judged by the latency bound.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable

from moon.feed.clock import NS
from moon.oracle.bounds import FOREVER
from transports.interface import Answer, Tap


class Asking:
    """Asks nodes how far they have reported.

    Args:
        answered: gets the node, its answer, and when it was asked, or before (ns); 0: that is not known.
            A recording does not tell which question an answer is to.
        within_s: a node that does not answer by then does not.
        now_ns: the time of day.
    """

    def __init__(
        self,
        answered: Callable[[str, Answer, int], None],
        within_s: float,
        now_ns: Callable[[], int],
    ) -> None:
        self._answered = answered
        self._within_s = within_s
        self._now_ns = now_ns
        self._open: dict[str, list[int]] = {}
        """When each was asked what it may still answer (ns), oldest first."""
        self._unsure_until_ns = 0
        """An answer by then may be to a question that is not among those."""

    def ask(self, tap: Tap, node: str) -> None:
        """Ask ``node`` now; of one that has just come up, an answer tells that it reports what it takes."""
        now_ns = self._now_ns()
        self._open[node] = [*self._open_of(node, now_ns), now_ns]
        tap.ask(node, functools.partial(self._take, node), self._within_s)

    def clock_set(self) -> None:
        """The time of day was set: when something was asked is not compared with what is answered."""
        self._open.clear()
        self._unsure_until_ns = self._now_ns() + round(self._within_s * NS)

    def _open_of(self, node: str, now_ns: int) -> list[int]:
        least_ns = now_ns - self._within_s * NS
        return [asked_ns for asked_ns in self._open.get(node, ()) if asked_ns >= least_ns]

    def _take(self, node: str, answer: Answer | None) -> None:
        if answer is None:
            return
        now_ns = self._now_ns()
        if now_ns <= self._unsure_until_ns:
            self._answered(node, answer, 0)
            return
        asked = self._open_of(node, now_ns)
        if len(asked) > 1:
            self._open[node] = asked[1:]
        else:
            self._open.pop(node, None)
        self._answered(node, answer, asked[0] if asked else 0)


class Silences:
    """Where something is due and has not come, the node is asked whether it did anything more: once.

    Attributes:
        next_ns: when one is to be asked next (ns), if nothing is received meanwhile.
    """

    def __init__(self) -> None:
        self.next_ns = FOREVER
        self._asked: dict[str, int] = {}
        """Of each node, when what it was asked for last was due (ns)."""

    def look(self, due: Iterable[tuple[str, int]], now_ns: int) -> list[str]:
        """The nodes to be asked now.

        Args:
            due: nodes, and when what each owes was due (ns).
            now_ns: all that happened before was received.
        """
        self.next_ns = FOREVER
        found: list[str] = []
        for node, due_ns in due:
            if due_ns == FOREVER or self._asked.get(node) == due_ns:
                continue
            if due_ns >= now_ns:
                self.next_ns = min(self.next_ns, due_ns + 1)
                continue
            self._asked[node] = due_ns
            found.append(node)
        return found
