"""The table of machines on a terminal of a given size.

What a machine is called and how it stands is never cut. A narrow terminal has shorter states, then fewer
columns; a low one has the machines that do not conform first. Explanations stand below the table, as wide as
the terminal.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from rich.cells import cell_len
from rich.console import Group
from rich.table import Table
from rich.text import Text

from moon.monitor.report import HEADER, NUMBERS, cells, last_explanations, shade
from moon.monitor.status import MachineStatus
from moon.verdict import Outcome

STYLES = {"31": "red", "32": "green", "33": "yellow"}
_LEFT_OUT_FIRST = ("lag [ms]", "out", "in", "state")
_SHORTEST_STATE = 8
"""Of a state so many characters tell something; a narrower column is left out."""
GAP = 2
"""Between columns."""
_GRAVITY = (str(Outcome.VIOLATED), str(Outcome.INCONCLUSIVE))


def drawn(statuses: Sequence[MachineStatus], width: int, height: int | None = None) -> Group:
    """The table and the explanations below it.

    Args:
        statuses: how the machines stand.
        width: of the terminal, in characters.
        height: of the terminal, in lines; None if it may scroll.
    """
    shown, more = _that_fit(statuses, height)
    rows = [dict(zip(HEADER, cells(status), strict=True)) for status in shown]
    widths = _widths(rows, width)
    table = table_of(widths, NUMBERS, {"state"})
    for status, row in zip(shown, rows, strict=True):
        texts = {heading: Text(row[heading]) for heading in widths}
        texts["verdict"].stylize(STYLES.get(shade(status.verdict), "dim"))
        table.add_row(*texts.values())
    below = [Text(f"… and {more} more", style="dim")] if more else []
    below += [Text(line) for line in last_explanations(shown)]
    return Group(table, *below)


def table_of(widths: Mapping[str, int], numbers: Collection[str], cut: Collection[str]) -> Table:
    """A table without rows.

    Args:
        widths: of its columns, by their headings.
        numbers: the columns that are aligned to the right.
        cut: the columns in which what is too long is cut; in others it takes several lines.
    """
    table = Table(box=None, pad_edge=False, padding=(0, GAP, 0, 0), header_style="bold")
    for heading, width in widths.items():
        is_cut = heading in cut
        table.add_column(
            Text(heading),
            justify="right" if heading in numbers else "left",
            width=width,
            no_wrap=is_cut,
            overflow="ellipsis" if is_cut else "fold",
        )
    return table


def _that_fit(
    statuses: Sequence[MachineStatus], height: int | None
) -> tuple[Sequence[MachineStatus], int]:
    """Those that a terminal of ``height`` lines has room for, and how many others there are."""
    room = len(statuses) if height is None else height - 1  # below the headings
    if len(statuses) <= room:
        return statuses, 0
    room = max(room - 1, 1)  # a line says how many there are more
    graver = sorted(statuses, key=lambda status: status.verdict not in _GRAVITY)
    return graver[:room], len(statuses) - room


def _widths(rows: Sequence[dict[str, str]], width: int) -> dict[str, int]:
    """The columns that are shown, and how wide each is."""
    widths = {
        heading: max(cell_len(text) for text in (heading, *(row[heading] for row in rows)))
        for heading in HEADER
    }
    whole_state = widths["state"]
    widths["state"] = min(whole_state, _SHORTEST_STATE)
    for heading in _LEFT_OUT_FIRST:
        if total(widths) <= width:
            break
        del widths[heading]
    if "state" in widths:
        widths["state"] = min(whole_state, widths["state"] + width - total(widths))
    elif total(widths) > width:  # then names and verdicts take several lines
        widths["verdict"] = min(widths["verdict"], max((width - GAP) // 2, 1))
        widths["machine"] = min(widths["machine"], max(width - GAP - widths["verdict"], 1))
    return widths


def total(widths: Mapping[str, int]) -> int:
    """How wide a table is."""
    return sum(widths.values()) + GAP * (len(widths) - 1)
