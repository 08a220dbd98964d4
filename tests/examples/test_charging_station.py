"""The charging station: what happens in virtual time."""

from __future__ import annotations

import pytest

from m2c.check import check_system
from m2c.model import DiagnosticLog, load
from tests.examples.virtual import of, received_of
from tests.systems import CHARGING_STATION, EXAMPLES, compiled
from transports.interface import Observation, ObservationKind

EXAMPLE = EXAMPLES / CHARGING_STATION
SECONDS = 40.0
"""Two lives of the supply: it is repaired after 15 s to 20 s."""
ACTION = "/ChargingStation/Charge/_action"


def heard_in(seed: int) -> list[Observation]:
    """What a tap receives of the example."""
    return received_of(compiled(CHARGING_STATION)[1], seed, SECONDS)


def test_the_example_has_no_findings() -> None:
    log = DiagnosticLog()
    system = load([EXAMPLE / "system.xml"], log)
    assert system is not None
    check_system(system, log)
    assert log.diagnostics == []
    assert len(system.nodes) == 7


@pytest.mark.parametrize("seed", range(6))
def test_goals_are_accepted_rejected_and_end_in_every_way(seed: int) -> None:
    heard = heard_in(seed)
    sent = ObservationKind.RESPONSE_SENT
    assert {seen.data["accepted"] for seen in of(heard, f"{ACTION}/send_goal", sent)} == {
        True,
        False,
    }
    results = list(of(heard, f"{ACTION}/get_result", sent))
    reasons = {(seen.data["status"], seen.data["result"]["reason"]) for seen in results}
    assert {(4, ""), (5, "canceled")} < reasons
    aborted = {reason for status, reason in reasons if status == 6}
    assert aborted
    assert aborted <= {"tripped", "broken"}
    feedback = of(heard, f"{ACTION}/feedback", ObservationKind.MESSAGE)
    assert any(seen.data["feedback"]["level"] > 50 for seen in feedback)


@pytest.mark.parametrize("seed", range(6))
def test_both_bays_are_taken_at_once_and_never_more(seed: int) -> None:
    load = of(heard_in(seed), "/ChargingStation/load", ObservationKind.MESSAGE)
    assert {seen.data["data"] for seen in load} == {0, 1, 2}


@pytest.mark.parametrize("seed", range(6))
def test_a_supply_that_fails_is_reset_and_after_the_third_failure_repaired(seed: int) -> None:
    heard = heard_in(seed)
    sent = ObservationKind.RESPONSE_SENT
    resets = [seen.data["reason"] for seen in of(heard, "/PowerSupply/Reset", sent)]
    assert {"", "too hot", "broken"} == set(resets)
    repairs = list(of(heard, "/PowerSupply/Repair", sent))
    assert repairs
    assert all(seen.data["is_ok"] for seen in repairs)
    states = [
        seen.data["state"] for seen in of(heard, "/PowerSupply/status", ObservationKind.MESSAGE)
    ]
    life = [state for state, before in zip(states, ["", *states], strict=False) if state != before]
    assert life[:7] == ["on", "tripped", "on", "tripped", "on", "broken", "on"]
    before = resets.index("broken")
    assert resets[before : before + 3] == ["broken"] * 3, "the policy gives up after three attempts"


@pytest.mark.parametrize("seed", range(6))
def test_the_courier_says_how_many_jobs_wait_and_leaves_its_bay_only_for_one(seed: int) -> None:
    jobs = left = 0
    level = 100
    for seen in heard_in(seed):
        if seen.channel == "/Courier/jobs":
            jobs += 1
            assert seen.data == {"data": jobs}
        elif seen.channel == "/Courier/battery":
            if seen.data["data"] < level:
                jobs = 0  # it works
            level = seen.data["data"]
        elif seen.channel == f"{ACTION}/cancel_goal" and seen.source == "Courier":
            assert jobs > 0
            left += 1
    assert left > 0
