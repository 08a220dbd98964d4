"""A node is asked how far it has reported: where something is due and has not come, whether it did more.

A node that numbers its reports answers up to which number it has reported everything, and until when
(``Tap.ask``). Once all of that was received its silence is known, and is not waited for any longer. A node
that does not answer is judged by the latency bound.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable

from moon.oracle.bounds import FOREVER
from transports.interface import Answer, Tap


class Asking:
    """Asks nodes how far they have reported.

    Args:
        answered: gets the node, its answer, and when it was asked (ns); 0: that is not known.
        now_ns: the time of day.
    """

    def __init__(
        self,
        answered: Callable[[str, Answer, int], None],
        now_ns: Callable[[], int],
    ) -> None:
        self._answered = answered
        self._now_ns = now_ns
        self._since_ns = 0
        """What was asked before is not compared with what is answered: the time of day was set."""

    def ask(self, tap: Tap, node: str) -> None:
        """Ask ``node`` now; of one that has just come up, an answer tells that it reports what it takes."""
        tap.ask(node, functools.partial(self._take, node, self._now_ns()))

    def clock_set(self) -> None:
        """The time of day was set: when something was asked is not compared with what is answered."""
        self._since_ns = self._now_ns()

    def _take(self, node: str, asked_ns: int, answer: Answer | None) -> None:
        if answer is not None:
            asked_ns = answer.asked_ns or asked_ns
            is_known = self._since_ns <= asked_ns <= self._now_ns()
            self._answered(node, answer, asked_ns if is_known else 0)


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
