"""What the overhead comparison measures, and what counts: monitors, the plan, processes."""

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
from tests.examples.overhead_made_up import made_up

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


# -- the plan ---------------------------------------------------------------------------------------


def test_saturation_comes_after_all_rates() -> None:
    found = [
        msgspec.structs.replace(block, rate_hz=rate_hz)
        for rate_hz in (0.0, 100.0, 1.0)
        for block in made_up().blocks[:4]
    ]
    assert list(dict.fromkeys(cell.rate_hz for cell in blocks.cells(found))) == [1.0, 100.0, 0.0]


def test_what_is_far_from_any_target_has_its_turn_in_the_first_rounds_only() -> None:
    turns = list(measuring.Plan(rounds=3, ticks={0.0: 1}, few=1).turns())
    by_round = [{item.name for number, item in turns if number == wanted} for wanted in range(3)]
    core = set(measuring.CORE)
    assert by_round == [{item.name for item in CONFIGURATIONS}, core, core]


def test_ratios_are_of_the_rounds_in_which_there_was_a_turn() -> None:
    own = [b for b in made_up().blocks if b.round == 0 or b.configuration in measuring.CORE]
    counts = {
        cell.configuration: (cell.found.count, round(cell.ratio.value, 2))
        for cell in blocks.cells(own)
        if (cell.series, cell.rate_hz) == ("ROOT", 10)
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
