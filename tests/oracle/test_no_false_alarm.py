"""No verdict against an example as it is, whatever the network does within its bounds.

``python -m tests.oracle.test_no_false_alarm RUNS [SEED] [--system NAME]`` is the long run of ``make soak``.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

import pytest

from moon.verdict import Outcome
from tests.oracle.tour import LATENCY_S, Heard, tour, watched
from tests.systems import CHARGING_STATION, LAB_TOUR, NAVIGATION, SORTING_CELL, SYSTEMS
from transports.simulated import Conditions

pytestmark = pytest.mark.slow

RUNS = 64
"""Each delay with each number of intruders four times; ``make soak`` has 10,000."""
BLOCKS = 8
SECONDS = {LAB_TOUR: 6.0, CHARGING_STATION: 20.0, SORTING_CELL: 30.0, NAVIGATION: 15.0}
"""The charging station's supply breaks and is repaired after 10 s to 15 s; the sorting cell's bins are full
after as long. The robot that navigates meets its first obstacle after 4 s, and is paused after 10 s."""

DELAYS_S = (0.0001, 0.002, 0.02, LATENCY_S / 2 - 0.001)
"""Longest delays, of messages and of observations; both together stay within the latency bound."""


def nominal(seed: int, name: str = LAB_TOUR) -> Heard:
    """One run of the example ``name`` under conditions drawn from the run's number, the policy judged too."""
    longest = DELAYS_S[seed % len(DELAYS_S)]
    conditions = Conditions(
        delay_s=(0.0, longest), tap_delay_s=(0.0, longest), busy_s=(0.0, 0.0002 * (seed % 3))
    )
    intruders = (0, 2, 3, 5)[seed // 4 % 4]
    return watched(name, seed, SECONDS[name], conditions, policy=True, intruders=intruders)


def complaints(heard: Heard) -> list[str]:
    """Everything that was said, which should be nothing."""
    return [f"{v.machine} {v.outcome}: {v.reason}" for v in heard.verdicts]


@pytest.mark.parametrize("block", range(BLOCKS))
def test_the_nominal_tour_raises_no_alarm(block: int) -> None:
    size = RUNS // BLOCKS
    for seed in range(block * size, (block + 1) * size):
        heard = nominal(seed)
        assert not heard.verdicts, f"seed {seed}: {complaints(heard)[:3]}"
        assert heard.observations > 300


@pytest.mark.parametrize("seed", range(0, 16, 3))
def test_the_nominal_charging_station_raises_no_alarm(seed: int) -> None:
    heard = nominal(seed, CHARGING_STATION)
    assert not heard.verdicts, complaints(heard)[:3]
    assert heard.observations > 1000


@pytest.mark.parametrize("seed", range(0, 16, 3))
def test_the_nominal_sorting_cell_raises_no_alarm(seed: int) -> None:
    heard = nominal(seed, SORTING_CELL)
    assert not heard.verdicts, complaints(heard)[:3]
    assert heard.observations > 500


@pytest.mark.parametrize("seed", range(0, 16, 3))
def test_the_nominal_navigation_raises_no_alarm(seed: int) -> None:
    heard = nominal(seed, NAVIGATION)
    assert not heard.verdicts, complaints(heard)[:3]
    assert heard.observations > 400


def test_a_long_run_stays_small() -> None:
    heard = tour(1, 300.0, Conditions(delay_s=(0.0, 0.01), tap_delay_s=(0.0, 0.01)))
    assert not heard.verdicts, complaints(heard)[:3]
    assert heard.most_hypotheses <= 16


@pytest.mark.parametrize("seed", range(6))
def test_lost_and_doubled_observations_are_inconclusive_and_no_alarm(seed: int) -> None:
    conditions = Conditions(
        delay_s=(0.0, 0.01), tap_delay_s=(0.0, 0.01), tap_loss=0.002, duplication=0.05
    )
    heard = tour(seed, 40.0, conditions, intruders=seed % 3)
    assert not heard.violations, complaints(heard)[:3]
    said = [v for v in heard.verdicts if v.outcome is Outcome.INCONCLUSIVE]
    assert said, "losses are not told"
    outcomes = [oracle.outcome for oracle in heard.monitor.oracles.values()]
    assert outcomes.count(Outcome.CONFORMING) >= len(outcomes) // 2, "nothing recovers"


@pytest.mark.parametrize("seed", [3, 6, 24, 31])
def test_a_first_loss_of_which_nobody_knew_is_no_alarm(seed: int) -> None:
    heard = tour(seed, 60.0, Conditions(tap_loss=0.0003), lossy=False)
    assert not heard.violations, complaints(heard)[:3]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("linked_s", [0.0, 5.0])
def test_a_monitor_that_joins_in_the_middle_raises_no_alarm_and_finds_the_thread(
    seed: int, linked_s: float
) -> None:
    conditions = Conditions(delay_s=(0.0, 0.01), tap_delay_s=(0.0, 0.01))
    heard = tour(seed, 40.0, conditions, join_after_s=3.0 + seed, linked_s=linked_s)
    assert not heard.violations, complaints(heard)[:3]
    lost = [n for n, o in heard.monitor.oracles.items() if o.outcome is not Outcome.CONFORMING]
    assert len(lost) <= 3, f"not found again: {lost}"


def test_a_run_is_a_function_of_its_seed() -> None:
    runs = [nominal(7) for _ in range(2)]
    assert runs[0].observations == runs[1].observations
    assert runs[0].world.events == runs[1].world.events


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; exit code 1: there was an alarm."""
    parser = argparse.ArgumentParser(description="Count the alarms of runs in which all is well.")
    parser.add_argument("runs", type=int)
    parser.add_argument("first", type=int, nargs="?", default=1000, metavar="seed")
    parser.add_argument("--system", choices=SYSTEMS, default=LAB_TOUR)
    chosen = parser.parse_args(arguments)
    alarms = 0
    for number, seed in enumerate(range(chosen.first, chosen.first + chosen.runs), 1):
        heard = nominal(seed, chosen.system)
        if heard.verdicts:
            alarms += 1
            print(f"seed {seed}: {complaints(heard)[:3]}", flush=True)
        if number % 100 == 0:
            print(f"{number} runs, {alarms} with an alarm", flush=True)
    return 1 if alarms else 0


if __name__ == "__main__":
    sys.exit(main())
