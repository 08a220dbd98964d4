"""The table of robots on terminals of every size."""

from __future__ import annotations

import pytest
from rich.console import Console

from moon.fleet.live_table import drawn
from moon.fleet.screen import SHOWN_AT_ONCE, LiveTable
from moon.verdict import Outcome, Verdict
from tests.fleet.by_hand import FleetByHand


@pytest.fixture
def by_hand(tmp_path) -> FleetByHand:
    made = FleetByHand(tmp_path)
    for number in range(100):
        robot = made.robot(f"robots/r{number:02}")
        robot.start()
        if number in (42, 77):
            robot.run(status=1)
    return made


def lines_of(made: FleetByHand, width: int = 120, height: int | None = None) -> list[str]:
    console = Console(width=width, height=height or 500)
    with console.capture() as capture:
        console.print(drawn(made.fleet.robots(), width, height))
    return [line.rstrip() for line in capture.get().splitlines()]


@pytest.mark.parametrize("height", [4, 10, 24, 60])
@pytest.mark.parametrize("width", [40, 80, 200])
def test_it_fits_and_says_how_many_robots_there_are_more(by_hand, width, height) -> None:
    lines = lines_of(by_hand, width, height)
    assert len(lines) <= height
    assert all(len(line) <= width for line in lines)
    shown = [line for line in lines if line.startswith("robots/")]
    assert lines[-1].startswith(f"… and {100 - len(shown)} robots")
    assert shown[0].split()[:2] == ["robots/r42", "violated"]


def test_a_robot_in_trouble_comes_first_and_unfolds_to_its_machines(by_hand) -> None:
    heading, *lines = lines_of(by_hand, height=24)
    assert heading.split()[:3] == ["robot", "verdict", "machines"]
    assert lines[0].split()[:3] == ["robots/r42", "violated", "0/1"]
    assert lines[1].split()[:2] == ["Level", "violated"]
    assert "expected response on /Level/tick" in lines[1]
    assert lines[2].split()[0] == "robots/r77"
    assert lines[4].split()[0] == "robots/r00"


def test_a_table_without_an_end_has_all(by_hand) -> None:
    lines = lines_of(by_hand)
    assert len(lines) == 1 + 100 + 2


def test_names_from_the_wire_cannot_paint_the_terminal(by_hand) -> None:
    by_hand.robot("robots/\x1b[31mred").start()
    assert not any("\x1b" in line for line in lines_of(by_hand))


def test_what_is_violated_appears_above_the_table_but_not_everything_at_once(
    by_hand, capsys
) -> None:
    screen = LiveTable()
    for number in range(SHOWN_AT_ONCE + 7):
        screen.take(Verdict("Level", "Level", Outcome.VIOLATED, 0, f"why {number}", robot="r1"))
    capsys.readouterr()
    screen.refresh(by_hand.fleet.robots)
    shown = capsys.readouterr().out
    assert f"why {SHOWN_AT_ONCE - 1}" in shown
    assert f"why {SHOWN_AT_ONCE}" not in shown
    assert "… and 7 more verdicts; --log FILE keeps all" in shown
    screen.refresh(by_hand.fleet.robots)
    assert "why" not in capsys.readouterr().out
    screen.finish(by_hand.fleet.summary())
    *_, last = capsys.readouterr().out.splitlines()
    assert "2 violations in " in last


def test_at_the_end_each_robot_in_trouble_has_one_line(by_hand) -> None:
    console = Console(width=120)
    with console.capture() as capture:
        console.print(drawn(by_hand.fleet.robots()[:2], 120, unfolds=False))
    assert len(capture.get().splitlines()) == 1 + 2
