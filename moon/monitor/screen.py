"""Where a monitor shows itself: a live table on a terminal, lines elsewhere, or JSON."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Any, Protocol, TypeVar

import msgspec

from m2c.json_lines import versioned_line
from m2c.terminal import folded, show_painted
from moon.monitor.report import closing, table, verdict_lines
from moon.monitor.status import MachineStatus, Summary
from moon.verdict import Verdict

Statuses = Callable[[], Sequence[MachineStatus]]
"""How the machines stand; it takes long, and only a table shows it."""
Statuses_contra = TypeVar("Statuses_contra", contravariant=True)
Summary_contra = TypeVar("Summary_contra", contravariant=True)


class Screen(Protocol[Statuses_contra, Summary_contra]):
    """Shows verdicts, how all stands, and the end."""

    def take(self, verdict: Verdict) -> None:
        """Show a verdict that is new."""
        ...

    def refresh(self, statuses: Statuses_contra) -> None:
        """Show how all stands."""
        ...

    def finish(self, summary: Summary_contra) -> None:
        """Show the end."""
        ...

    def close(self) -> None:
        """Leave the terminal as it was; idempotent, and writes nothing else."""
        ...


class Lines:
    """Verdicts as they come, the table at the end."""

    def take(self, verdict: Verdict) -> None:
        """Show a verdict that is new."""
        show_painted(*verdict_lines(verdict))

    def refresh(self, statuses: Statuses) -> None:
        """Nothing is shown between verdicts."""

    def finish(self, summary: Summary) -> None:
        """Show the end."""
        show_painted(*table(summary.machines), *closing(summary))

    def close(self) -> None:
        """The terminal was not changed."""


class JsonLines:
    """An object a line: ``{"event": "verdict", …}``, and at the end ``{"event": "summary", …}``."""

    def take(self, verdict: Verdict) -> None:
        """Show a verdict that is new."""
        write_event("verdict", verdict)

    def refresh(self, statuses: object) -> None:
        """Nothing is shown between verdicts."""

    def finish(self, summary: msgspec.Struct) -> None:
        """Show the end."""
        write_event("summary", summary)

    def close(self) -> None:
        """The terminal was not changed."""


class LiveTable:
    """The machines in a table that stays in place, verdicts above it."""

    def __init__(self) -> None:
        from rich.live import Live

        self._live = Live(auto_refresh=False, redirect_stderr=sys.stderr.isatty())
        self._live.start()

    def take(self, verdict: Verdict) -> None:
        """Show a verdict that is new."""
        from rich.text import Text

        for line in verdict_lines(verdict, colour=True):
            for part in folded(line):
                self._live.console.print(Text.from_ansi(part))

    def refresh(self, statuses: Statuses) -> None:
        """Draw the table anew."""
        from moon.monitor.live_table import drawn

        width, height = self._live.console.size
        self._live.update(drawn(statuses(), width, height), refresh=True)

    def finish(self, summary: Summary) -> None:
        """Leave the last table standing, whole: the terminal may scroll now."""
        from moon.monitor.live_table import drawn

        self._live.update(drawn(summary.machines, self._live.console.width))
        self.close()
        show_painted(*closing(summary))

    def close(self) -> None:
        """Show the cursor again."""
        self._live.stop()


def screen_for(as_json: bool, is_alone: bool = True) -> Screen[Statuses, Summary]:
    """The screen that the options and standard output ask for.

    Args:
        as_json: an object a line.
        is_alone: nobody else draws on a terminal.
    """
    if as_json:
        return JsonLines()
    if is_alone and sys.stdout.isatty():
        return LiveTable()
    return Lines()


def write_event(kind: str, content: Any) -> None:
    """Show ``content`` as an object on a line, with ``"event": kind``."""
    fields = {"event": kind, **msgspec.to_builtins(content)}
    show_painted(versioned_line(fields).decode())
