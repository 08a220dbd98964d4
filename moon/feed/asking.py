"""A node is asked how far it has reported: where something is due and has not come, whether it did more.

A node that numbers its reports answers up to which number it has reported everything, and until when
(``Tap.ask``). Once all of that was received its silence is known, and is not waited for any longer. A node
that does not answer is judged by the latency bound.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

from moon.feed.clock import NS
from transports.interface import Answer, Tap


class Asking:
    """Asks nodes how far they have reported.

    Args:
        answered: gets the node, its answer, and when it was asked (ns); 0: it may have been at any time.
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
        self._since: dict[str, int] = {}
        """When each was asked first of those that have not answered (ns)."""

    def ask(self, tap: Tap, node: str) -> None:
        """Ask ``node`` now; of one that has just come up, an answer tells that it reports what it takes."""
        now_ns = self._now_ns()
        if now_ns > self._since.get(node, 0) + self._within_s * NS:
            self._since[node] = now_ns
        tap.ask(node, functools.partial(self._take, node), self._within_s)

    def clock_set(self) -> None:
        """The time of day was set: when something was asked is not compared with what is answered."""
        self._since.clear()

    def _take(self, node: str, answer: Answer | None) -> None:
        if answer is not None:
            self._answered(node, answer, self._since.pop(node, 0))
