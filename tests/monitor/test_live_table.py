"""The live table on terminals of every width: who stands how is never cut."""

from __future__ import annotations

import re

import pytest
from rich.console import Console

from moon.monitor.live_table import drawn
from moon.monitor.status import MachineStatus
from tests.commands.on_terminal import OnTerminal

WHY = (
    "expected response on /VisitorsFollowingRobotSkill/tick {status: 0, is_ok: True} to policy, "
    "observed response on /VisitorsFollowingRobotSkill/tick {status: 1, is_ok: True}"
)
BAD = MachineStatus(
    "VisitorsFollowingRobotSkill", "violated",
    ("waiting_for_an_answer", "driving_to_the_next_poi"), 12_345, 44_444, 15, 0, 12.5, WHY,
)  # fmt: skip
DOUBTFUL = MachineStatus("Policy", "inconclusive", (), 5, 4, 0, 0, 0.5, "started in the middle")
GOOD = MachineStatus("Battery", "conforming", ("idle",), 5, 4, 0, 0, 0.5, "was violated before")
WIDTHS = (60, 80, 100)


def lines_at(width: int, *statuses: MachineStatus, height: int | None = None) -> list[str]:
    console = Console(width=width, height=height or 50)
    with console.capture() as capture:
        console.print(drawn(statuses, width, height))
    return [line.rstrip() for line in capture.get().splitlines()]


@pytest.mark.parametrize("width", WIDTHS)
def test_machines_and_verdicts_stand_whole_on_one_line_and_why_below(width: int) -> None:
    heading, bad, doubtful, good, *below = lines_at(width, BAD, DOUBTFUL, GOOD)
    assert heading.split()[:2] == ["machine", "verdict"]
    assert bad.startswith("VisitorsFollowingRobotSkill  violated ×15")
    assert re.match(r"Policy +inconclusive", doubtful)
    assert re.match(r"Battery +conforming", good)
    assert " ".join(below) == f"{BAD.machine}: {WHY} Policy: started in the middle"
    assert all(len(line) <= width for line in (heading, bad, doubtful, good, *below))


def test_a_narrow_terminal_has_fewer_columns() -> None:
    headings = {width: lines_at(width, BAD)[0].split() for width in (44, *WIDTHS)}
    assert headings == {
        44: ["machine", "verdict"],
        60: ["machine", "verdict", "state", "in"],
        80: ["machine", "verdict", "state", "in", "out", "lag", "[ms]"],
        100: ["machine", "verdict", "state", "in", "out", "lag", "[ms]"],
    }


def test_what_is_too_long_for_any_terminal_takes_several_lines() -> None:
    name = "M" * 70
    long = MachineStatus(name, "violated", ("s",), 1, 1, 2, 0, None, "")
    _, *rows = lines_at(40, long)
    assert "".join(row.split()[0] for row in rows) == name
    assert "violated ×2" in rows[0]


def test_a_low_terminal_shows_first_who_does_not_conform() -> None:
    rows = lines_at(80, *[GOOD] * 30, BAD, DOUBTFUL, height=10)
    assert [row.split()[0] for row in rows[1:4]] == [BAD.machine, "Policy", "Battery"]
    assert rows[9] == "… and 24 more"
    assert len(lines_at(80, *[GOOD] * 30)) == 31


PROGRAM = f"""
from moon.monitor.screen import LiveTable
from moon.monitor.status import MachineStatus, Summary
from moon.feed.counts import Counts

statuses = ({BAD!r}, {GOOD!r})
screen = LiveTable()
for _ in range(3):
    screen.refresh(lambda: statuses)
screen.finish(Summary(1.0, statuses, Counts(), ()))
"""


@pytest.mark.parametrize("width", WIDTHS)
def test_on_a_real_terminal_no_line_is_wider_than_it(width: int) -> None:
    run = OnTerminal("python", "-c", PROGRAM, columns=width)
    assert run.end() == 0, run.text
    plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", run.text.replace("\r", "\n"))
    table = plain.partition("15 violations in")[0].splitlines()
    assert max(map(len, table)) <= width
    assert sum("VisitorsFollowingRobotSkill  violated ×15" in line for line in table) >= 3
    assert "is_ok:" in plain
