"""Where a monitor of a fleet shows itself: a live table on a terminal, lines elsewhere, or JSON."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence

from m2c.terminal import folded, show_painted
from moon.fleet.report import closing, table
from moon.fleet.robot import Robot
from moon.fleet.status import FleetSummary
from moon.monitor.report import verdict_lines
from moon.monitor.screen import JsonLines, Screen
from moon.verdict import MIDDLE, Outcome, Verdict

Robots = Callable[[], Sequence[Robot]]
"""The robots as they stand, the gravest first; it takes long, and only a table shows it."""


class Troubles:
    """Which verdicts a person wants to read of a fleet: trouble, and its end.

    That each of thousands of machines conforms, or was found in the middle of its run, is not.
    """

    def __init__(self) -> None:
        self._troubled: set[tuple[str, str]] = set()

    def concerns(self, verdict: Verdict) -> bool:
        """Whether ``verdict`` is one."""
        place = (verdict.robot, verdict.node)
        if verdict.outcome is Outcome.CONFORMING:
            was_troubled = place in self._troubled
            self._troubled.discard(place)
            return was_troubled
        if verdict.outcome is Outcome.INCONCLUSIVE and verdict.reason == MIDDLE:
            return False
        self._troubled.add(place)
        return True


class Lines:
    """Troubles as they come, the robots that are not fine at the end."""

    def __init__(self) -> None:
        self._troubles = Troubles()

    def take(self, verdict: Verdict) -> None:
        """Show it if a person wants to read it."""
        if self._troubles.concerns(verdict):
            show_painted(*verdict_lines(verdict))

    def refresh(self, robots: Robots) -> None:
        """Nothing is shown between verdicts."""

    def finish(self, summary: FleetSummary) -> None:
        """Show the end."""
        show_painted(*table(summary.troubled), *closing(summary))

    def close(self) -> None:
        """The terminal was not changed."""


SHOWN_AT_ONCE = 20
"""Verdicts that appear above a live table at a time; a trouble of all robots would hold up the monitor."""


class LiveTable:
    """The robots in a table that stays in place, troubles above it.

    They appear when the table is drawn: whenever something is written above it, all of it is drawn anew.
    """

    def __init__(self) -> None:
        from rich.live import Live

        self._troubles = Troubles()
        self._robots: Robots = tuple
        """As they were told last."""
        self._new: list[Verdict] = []
        self._more = 0
        self._live = Live(auto_refresh=False, redirect_stderr=sys.stderr.isatty())
        self._live.start()

    def take(self, verdict: Verdict) -> None:
        """Keep it until the table is drawn, if a person wants to read it."""
        if not self._troubles.concerns(verdict):
            return
        if len(self._new) < SHOWN_AT_ONCE:
            self._new.append(verdict)
        else:
            self._more += 1

    def _show_new(self) -> None:
        from rich.text import Text

        if not self._new:
            return
        lines = [line for verdict in self._new for line in verdict_lines(verdict, colour=True)]
        if self._more:
            lines.append(f"… and {self._more:,} more verdicts; --log FILE keeps all")
        self._live.console.print(
            Text.from_ansi("\n".join(part for line in lines for part in folded(line)))
        )
        self._new, self._more = [], 0

    def refresh(self, robots: Robots) -> None:
        """Draw the table anew, and show above it what is new."""
        from moon.fleet.live_table import drawn

        self._robots = robots
        self._show_new()
        width, height = self._live.console.size
        self._live.update(drawn(robots(), width, height), refresh=True)

    def finish(self, summary: FleetSummary) -> None:
        """Leave the robots that are not fine, a line each: the terminal may scroll now."""
        from moon.fleet.live_table import drawn

        self._show_new()
        troubled = {status.robot for status in summary.troubled}
        robots = [robot for robot in self._robots() if robot.name in troubled]
        self._live.update(drawn(robots, self._live.console.width, unfolds=False))
        self.close()
        show_painted(*closing(summary))

    def close(self) -> None:
        """Show the cursor again."""
        self._live.stop()


def fleet_screen(as_json: bool) -> Screen[Robots, FleetSummary]:
    """The screen that the options and standard output ask for."""
    if as_json:
        return JsonLines()
    return LiveTable() if sys.stdout.isatty() else Lines()
