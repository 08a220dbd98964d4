"""The table of robots on a terminal of a given size.

Those in trouble come first and unfold to their machines that are not fine. What there is no room for is
counted in the last line.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from rich.table import Table
from rich.text import Text

from moon.fleet.report import HEADER, machine_cells, robot_cells, standing, totals
from moon.fleet.robot import Robot
from moon.fleet.status import RobotStatus
from moon.monitor.live_table import STYLES
from moon.monitor.report import shade
from moon.verdict import Outcome

_UNFOLDED = (str(Outcome.VIOLATED), str(Outcome.INCONCLUSIVE))
_AROUND = 2
"""Lines of the table that are no robots: the headings, and how many there are."""
_NARROW = 60
"""Columns of a terminal that has no room for what was wrong."""


def drawn(robots: Sequence[Robot], width: int, height: int | None = None) -> Table:
    """The table.

    Args:
        robots: the gravest first.
        width: of the terminal, in characters.
        height: of the terminal, in lines; None if it may scroll.
    """
    shown = HEADER if width >= _NARROW else HEADER[:3]
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
    for heading in shown:
        table.add_column(
            Text(heading),
            justify="right" if heading in ("machines", "obs/s") else "left",
            no_wrap=True,
            overflow="ellipsis",
            ratio=1 if heading == "last" else None,
        )
    room = None if height is None else max(height - _AROUND, 1)
    rows, rest = _that_fit(robots, room)
    for verdict, cells in rows:
        texts = [Text(cell) for cell in cells[: len(shown)]]
        texts[1].stylize(STYLES.get(shade(verdict), "dim"))
        table.add_row(*texts)
    if rest:
        counts = Counter(standing(robot.status()) for robot in rest)
        table.add_row(Text(f"… and {totals(dict(counts))}", style="dim"))
    return table


def _that_fit(
    robots: Sequence[Robot], room: int | None
) -> tuple[list[tuple[str, tuple[str, ...]]], Sequence[Robot]]:
    """The rows that there is room for, each with a verdict, and the robots that are in none of them."""
    rows: list[tuple[str, tuple[str, ...]]] = []
    for place, robot in enumerate(robots):
        is_unfolded = robot.verdict in _UNFOLDED
        block = _rows_of(robot.status(unfolded=is_unfolded))
        if room is not None and len(rows) + len(block) > room:
            if len(rows) >= room:
                return rows, robots[place:]
            block = block[:1]
        rows += block
    return rows, ()


def _rows_of(status: RobotStatus) -> list[tuple[str, tuple[str, ...]]]:
    machines = [(status.verdict, cells) for cells in machine_cells(status)]
    return [(status.verdict, robot_cells(status)), *machines]
