"""The table of robots on a terminal of a given size.

Those in trouble come first and unfold to their machines that are not fine. What there is no room for is
counted in the last line.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from rich.cells import cell_len
from rich.console import Group
from rich.text import Text

from moon.fleet.report import HEADER, NUMBERS, machine_cells, robot_cells, standing, totals
from moon.fleet.robot import Robot
from moon.fleet.status import RobotStatus
from moon.monitor.live_table import STYLES, table_of, total
from moon.monitor.report import shade
from moon.verdict import Outcome

_UNFOLDED = (str(Outcome.VIOLATED), str(Outcome.INCONCLUSIVE))
_AROUND = 2
"""Lines of the table that are no robots: the headings, and how many there are."""
_SHORTEST_LAST = 12
"""Of what was wrong so many characters tell something; a narrower column is left out."""
_LEFT_OUT_FIRST = ("last", "obs/s", "machines")

_Row = tuple[str, tuple[str, ...]]
"""A verdict, for the colour, and the cells."""


def drawn(
    robots: Sequence[Robot], width: int, height: int | None = None, unfolds: bool = True
) -> Group:
    """The table.

    Args:
        robots: the gravest first.
        width: of the terminal, in characters.
        height: of the terminal, in lines; None if it may scroll.
        unfolds: whether the machines of a robot in trouble are shown.
    """
    room = None if height is None else max(height - _AROUND, 1)
    rows, rest = _that_fit(robots, room, unfolds)
    widths = _widths([cells for _, cells in rows], width)
    table = table_of(widths, NUMBERS, widths)
    for verdict, cells in rows:
        row = dict(zip(HEADER, map(Text, cells), strict=True))
        row["verdict"].stylize(STYLES.get(shade(verdict), "dim"))
        table.add_row(*(row[heading] for heading in widths))
    if not rest:
        return Group(table)
    counts = Counter(standing(robot.status()) for robot in rest)
    more = Text(f"… and {totals(dict(counts))}", style="dim", no_wrap=True, overflow="ellipsis")
    return Group(table, more)


def _widths(rows: Sequence[tuple[str, ...]], width: int) -> dict[str, int]:
    """The columns that there is room for, and how wide each is; what was wrong has what is left."""
    columns = zip(HEADER, *rows, strict=True)
    widths = {column[0]: max(map(cell_len, column)) for column in columns}
    whole_last = widths["last"]
    widths["last"] = min(whole_last, _SHORTEST_LAST)
    for heading in _LEFT_OUT_FIRST:
        if total(widths) > width:
            del widths[heading]
    spare = width - total(widths)
    if "last" in widths:
        widths["last"] = min(whole_last, widths["last"] + spare)
    elif spare < 0:
        widths["robot"] = max(widths["robot"] + spare, 1)
    return widths


def _that_fit(
    robots: Sequence[Robot], room: int | None, unfolds: bool
) -> tuple[list[_Row], Sequence[Robot]]:
    """The rows that there is room for, each with a verdict, and the robots that are in none of them."""
    rows: list[_Row] = []
    for place, robot in enumerate(robots):
        is_unfolded = unfolds and robot.verdict in _UNFOLDED
        block = _rows_of(robot.status(unfolded=is_unfolded))
        if room is not None and len(rows) + len(block) > room:
            if len(rows) >= room:
                return rows, robots[place:]
            block = block[:1]
        rows += block
    return rows, ()


def _rows_of(status: RobotStatus) -> list[_Row]:
    machines = [(status.verdict, cells) for cells in machine_cells(status)]
    return [(status.verdict, robot_cells(status)), *machines]
