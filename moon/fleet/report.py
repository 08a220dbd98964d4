"""A fleet in words: a line a robot, its machines below it, and the end."""

from __future__ import annotations

from collections.abc import Sequence

from m2c.printable import printable
from m2c.suggestions import first_of
from moon.fleet.status import FleetSummary, RobotStatus
from moon.monitor.report import UNTIL_IT_ENDED, aligned, cells
from moon.verdict import Outcome

HEADER = ("robot", "verdict", "machines", "obs/s", "last")
NUMBERS = ("machines", "obs/s")
"""The columns whose cells are aligned to the right."""
MOST_MACHINES = 5
"""So many machines of a robot are shown below it; of more, a number."""
_MOST_NAMED = 5


def standing(status: RobotStatus) -> str:
    """Its verdict, and whether it is gone."""
    if status.present:
        return status.verdict
    if status.verdict == Outcome.CONFORMING:
        return f"gone, {UNTIL_IT_ENDED}"
    return f"gone, {status.verdict}"


def robot_cells(status: RobotStatus) -> tuple[str, ...]:
    """A row of the table, as :data:`HEADER` has it."""
    verdict = standing(status)
    if status.violations > 1:
        verdict += f" ×{status.violations:,}"
    rate = f"{status.per_second:,.0f}" if status.present else ""
    machines = f"{status.fine}/{status.judged}"
    return tuple(map(printable, (status.robot, verdict, machines, rate, status.last)))


def machine_cells(status: RobotStatus) -> list[tuple[str, ...]]:
    """The rows of its machines that are not fine, in the same columns."""
    rows: list[tuple[str, ...]] = []
    for machine in status.machines[:MOST_MACHINES]:
        name, verdict, state, *_ = cells(machine)
        rows.append((f"  {name}", f"  {verdict}", "", "", f"{state}  {printable(machine.last)}"))
    if (more := len(status.machines) - MOST_MACHINES) > 0:
        rows.append((f"  … and {more} more", "", "", "", ""))
    return rows


def table(statuses: Sequence[RobotStatus]) -> list[str]:
    """Robots as lines of text, one each."""
    return aligned(HEADER, map(robot_cells, statuses), NUMBERS) if statuses else []


def totals(robots: dict[str, int]) -> str:
    """``100 robots: 98 conforming, 2 violated``."""
    count = sum(robots.values())
    parts = [f"{number:,} {verdict}" for verdict, number in sorted(robots.items())]
    return f"{count:,} robot{'s' * (count != 1)}{': ' if parts else ''}{', '.join(parts)}"


def closing(summary: FleetSummary) -> list[str]:
    """The last lines."""
    count = summary.violations
    lines = [
        f"{count:,} violation{'s' * (count != 1)} in {summary.seconds:.1f} s; "
        f"{totals(summary.robots)}; received {summary.received:,} observations"
    ]
    if summary.problems:
        names = sorted(summary.problems)
        lines.append(f"not all was received or judged of {printable(first_of(names, _MOST_NAMED))}")
    return lines + [printable(sentence) for sentence in summary.unmonitored]
