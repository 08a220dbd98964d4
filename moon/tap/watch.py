"""A tap at work: from the listener to the output."""

from __future__ import annotations

from collections.abc import Callable

from moon.tap.notices import Notices
from moon.tap.output import Output
from moon.tap.selection import Selection
from moon.tap.stream import MAX_OPEN_BYTES, MAX_OPEN_CALLS, CallMatcher, Line
from transports.interface import Observation, Tap

UNANSWERED_AFTER_S = 10.0
"""A request without a response is shown as unanswered after this long."""


class Watch:
    """Matches, selects and shows what is received.

    Attributes:
        received: observations so far.
        shown: lines so far.
    """

    def __init__(
        self,
        selection: Selection,
        output: Output,
        notices: Notices,
        count: int | None,
        stop: Callable[[], None],
    ) -> None:
        """``stop`` is called once ``count`` lines were shown."""
        self.received = 0
        self.shown = 0
        self._takes = selection.takes
        self._output = output
        self._notices = notices
        self._count = count
        self._stop = stop
        self._matcher = CallMatcher()

    def observe(self, seen: Observation) -> None:
        """Take one observation in."""
        self.received += 1
        line = self._matcher.feed(seen)
        if line is not None:
            self._show(line)

    def look_around(self, listener: Tap, now_ns: int) -> None:
        """Show late calls and the statistics anew; say from whom ``listener`` receives and what it missed.

        ``now_ns`` is the tap's clock.
        """
        self._show_late(now_ns)
        self._output.refresh(now_ns)
        self._notices.problems(self._problems(listener))
        self._notices.links(listener.peers())

    def finish(self, listener: Tap, now_ns: int) -> None:
        """Show what is left, and what was missed in all."""
        self._show_late(now_ns)
        self._output.finish(now_ns)
        self._notices.last_problems(self._problems(listener))

    def _show_late(self, now_ns: int) -> None:
        for line in self._matcher.one_ended(now_ns):
            self._show(line)
        for line in self._matcher.unanswered(now_ns, UNANSWERED_AFTER_S):
            self._show(line)

    def _show(self, line: Line) -> None:
        if self.shown == self._count or not self._takes(line):
            return
        self._output.add(line)
        self.shown += 1
        if self.shown == self._count:
            self._stop()

    def _problems(self, listener: Tap) -> list[str]:
        problems = list(listener.problems())
        if forgotten := self._matcher.forgotten:
            problems.append(
                f"lost track of {forgotten} call{'s' * (forgotten != 1)}: more than "
                f"{MAX_OPEN_CALLS:,} waited for a response at once, or {MAX_OPEN_BYTES // 2**20} MB of their "
                "messages, and the oldest were given up"
            )
        return problems
