"""What the overhead comparison measures, and what counts: monitors, growth, the plan, processes."""

from __future__ import annotations

import itertools
import os
import time

import msgspec
import pytest

from benchmarks import processes
from examples.overhead import blocks, measuring
from examples.overhead.load import LEVEL_S, phases
from examples.overhead.observers import CONFIGURATIONS, Heard, deaf, told
from examples.overhead.plant import read_system
from m2c.model.machine import InterfaceKind
from tests.examples.overhead_made_up import made_up, run

# -- monitors ---------------------------------------------------------------------------------------

BY_NAME = {item.name: item for item in CONFIGURATIONS}


def test_a_monitor_that_heard_too_little_does_not_count() -> None:
    both = BY_NAME["both"]
    assert "received 3 of at least" in deaf(both, Heard(3, 0, 9), ticks=10)
    assert deaf(both, Heard(1000, 0, 9), ticks=10) == ""
    assert deaf(BY_NAME["none"], Heard(), ticks=10) == ""


def test_a_monitor_that_found_a_fault_where_there_is_none_does_not_count() -> None:
    assert "1 violations" in deaf(BY_NAME["models"], Heard(1000, 1, 4), ticks=10)


def test_a_monitor_that_found_nothing_to_conform_does_not_count() -> None:
    alone = BY_NAME["models-in-process"]
    assert deaf(alone, Heard(1000, 0, 0), ticks=10) == "found nothing to be as it should"
    doubts = ("P1: messages on /level were missed",)
    heard = Heard(1000, 0, 0, doubts=doubts)
    assert deaf(alone, heard, ticks=10).endswith(f"should: {doubts[0]}")


def test_what_a_monitor_could_not_judge_is_kept_with_its_reason() -> None:
    machine = {"violations": 0, "lag_ms": None}
    said = [
        {
            "event": "summary",
            "machines": [
                {"machine": "P1", "verdict": "inconclusive", "last": "a loss", **machine},
                {"machine": "P2", "verdict": "conforming", "last": "", **machine},
            ],
            "counts": {"heard": 7},
            "problems": [],
        }
    ]
    assert told(said) == Heard(7, 0, 1, None, doubts=("P1: a loss",))


# -- growth -----------------------------------------------------------------------------------------


def test_the_knee_is_where_the_whole_interval_is_dear() -> None:
    runs = [
        run(x, micros, number)
        for number in range(3)
        for x, micros in ((0, 100.0), (1, 105.0), (2, 140.0), (4, 300.0))
    ]
    runs = [msgspec.structs.replace(item, busy=0.95) if item.x == 2 else item for item in runs]
    (line,) = blocks.lines(blocks.cells(runs))
    assert [point.ratio.value for point in line if point.ratio] == [1.0, 1.05, 1.4, 3.0]
    point, why = blocks.knee(line)
    assert point.x == 2
    assert why == "a tick costs 1.40 times; the machine is full (95% busy)"


def test_a_watcher_that_is_late_is_a_knee_too() -> None:
    runs = [run(0, 100.0), run(1, 100.0, lag_ms=20.0, lag_p99_ms=150.0, processor=0.99)]
    point, why = blocks.knee(blocks.cells(runs))
    assert point.x == 1
    assert "150 ms behind; the watchers use 1.0 cores" in why


def test_where_nothing_is_dear_there_is_no_knee() -> None:
    assert blocks.knee(blocks.cells([run(0, 100.0), run(1, 101.0)])) is None


def test_saturation_comes_after_all_rates() -> None:
    runs = [
        run(0, 100.0, experiment="rate", rate_hz=rate_hz, configuration=who)
        for rate_hz in (0.0, 100.0, 1.0)
        for who in ("none", "both")
    ]
    (line,) = blocks.lines(blocks.cells(runs))
    assert [point.rate_hz for point in line] == [1.0, 100.0, 0.0]


# -- the plan ---------------------------------------------------------------------------------------


def test_what_is_far_from_any_target_has_its_turn_in_the_first_rounds_only() -> None:
    plan = measuring.Plan(rounds=3, ticks={0.0: 1}, few=1)
    turns = [
        {item.name for item in CONFIGURATIONS if plan.has_turn(item, number)} for number in range(3)
    ]
    core = set(measuring.CORE)
    assert turns == [{item.name for item in CONFIGURATIONS}, core, core]


def test_ratios_are_of_the_rounds_in_which_there_was_a_turn() -> None:
    own = [b for b in made_up().blocks if b.round == 0 or b.configuration in measuring.CORE]
    counts = {
        cell.configuration: (cell.found.count, round(cell.ratio.value, 2))
        for cell in blocks.cells(own)
        if (cell.experiment, cell.series, cell.rate_hz) == ("table3", "ROOT", 10) and cell.ratio
    }
    assert counts == {
        "none": (6, 1.0),
        "control": (6, 1.01),
        "both": (6, 1.04),
        "both-websocket": (3, 3.0),
    }


def test_orders_begin_anywhere_between_two_levels_evenly() -> None:
    for taken in (6, 8, 30):
        places = sorted(itertools.islice(phases(), taken))
        gaps = [after - before for before, after in itertools.pairwise([0.0, *places, 1.0])]
        assert max(gaps) < 2.7 / taken, taken


def test_the_battery_tells_its_level_as_often_as_the_load_takes_it() -> None:
    (battery,) = (node for node in read_system().nodes if node.name == "BatteryComponent")
    (measure,) = (item for item in battery.interfaces if item.kind is InterfaceKind.TIMER)
    assert measure.rate_hz == 1 / LEVEL_S


# -- accounts ---------------------------------------------------------------------------------------


def test_the_account_of_a_process_is_its_processor_time() -> None:
    before, own = processes.processor_s(os.getpid()), time.process_time()
    assert abs(before - own) < 0.1
    sum(range(300_000))
    assert processes.processor_s(os.getpid()) > before


def test_a_process_that_is_not_there_has_no_account() -> None:
    with pytest.raises(OSError, match="process 999999999"):
        processes.processor_s(999_999_999)


def test_the_bytes_of_an_interface_are_counted() -> None:
    sent, packets = processes.bytes_sent(os.getpid(), "lo")
    assert sent >= packets >= 0
    with pytest.raises(KeyError):
        processes.bytes_sent(os.getpid(), "no_such_interface")
