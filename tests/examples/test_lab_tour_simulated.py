"""Tours in virtual time: under delays of every kind, each is complete and no drive outlives a halt."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.model import DiagnosticLog, load
from m2c.simulation.program import Program, compile_system
from tests.examples.virtual import of, received_of
from transports.interface import Observation, ObservationKind

SYSTEM = Path(__file__).parents[2] / "examples" / "lab_tour" / "system.xml"
TOUR_S = 30.0
"""A tour takes 20 s to 25 s."""
GOAL = "/NavigationComponent/GoToPoi/_action/send_goal"
CANCEL = "/NavigationComponent/GoToPoi/_action/cancel_goal"


@pytest.fixture(scope="module")
def program() -> Program:
    system = load([SYSTEM], DiagnosticLog())
    assert system is not None
    return compile_system(system)


def tour(program: Program, seed: int) -> list[Observation]:
    """What a tap hears of the first tour and the start of the next, in order of its stamps."""
    return received_of(program, seed, TOUR_S)


@pytest.mark.parametrize("seed", range(8))
def test_a_tour_visits_both_points_waits_alarms_and_then_starts_anew(
    program: Program, seed: int
) -> None:
    heard = tour(program, seed)
    received = ObservationKind.REQUEST_RECEIVED
    marks = [
        (seen.data["key"], seen.data["value"])
        for seen in of(heard, "/BlackboardComponent/SetInt", received)
    ]
    assert marks[:4] == [(1, 1), (2, 1), (1, 0), (2, 0)]
    reset_ns = next(of(heard, "/ResetSkill/tick", received)).stamp_ns
    waited = [seen.stamp_ns for seen in of(heard, "/WaitSkill/tick", received)]
    assert waited
    assert waited[0] < reset_ns
    level = 100
    for seen in heard:
        if seen.kind is ObservationKind.MESSAGE_TAKEN:
            continue
        if seen.channel == "/BatteryComponent/level":
            level = seen.data["data"]
        elif seen.channel == "/NotifyUserComponent/alarm" and seen.data["data"]:
            assert level < 30
            assert seen.stamp_ns < reset_ns
            break
    else:
        pytest.fail("no alarm")


@pytest.mark.parametrize("seed", range(8))
def test_a_halt_cancels_the_drive_and_the_next_goal_follows_a_new_tick(
    program: Program, seed: int
) -> None:
    heard = tour(program, seed)
    halts = list(of(heard, "/GoToPoiSkill/halt", ObservationKind.RESPONSE_SENT))
    assert halts
    cancels = [seen.stamp_ns for seen in of(heard, CANCEL, ObservationKind.REQUEST_SENT)]
    ticks = [
        seen.stamp_ns for seen in of(heard, "/GoToPoiSkill/tick", ObservationKind.REQUEST_RECEIVED)
    ]
    goals = [seen.stamp_ns for seen in of(heard, GOAL, ObservationKind.REQUEST_SENT)]
    for halt in halts:
        assert any(halt.stamp_ns - 10**9 < cancel <= halt.stamp_ns for cancel in cancels)
        ticked = min((stamp for stamp in ticks if stamp > halt.stamp_ns), default=None)
        sent = min((stamp for stamp in goals if stamp > halt.stamp_ns), default=None)
        assert sent is None or (ticked is not None and ticked < sent)
