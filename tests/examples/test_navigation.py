"""The navigation: a tree as for Nav2, whose leaves are its servers' actions, services and topics."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from m2c.check import check_system
from m2c.model import DiagnosticLog
from m2c.policy.ticks import TreeTick
from m2c.simulation.run import SimulatedRun
from tests.examples.virtual import SLOW, of, received_of
from tests.systems import NAVIGATION, compiled, read
from transports.interface import Observation, ObservationKind
from transports.simulated import SimulatedWorld

SECONDS = 60.0
PLACES = [(4.0, 0.0), (4.0, 3.0), (0.0, 0.0)]
ENDS = {4: "succeeded", 5: "canceled", 6: "aborted"}

seeds = pytest.mark.parametrize("seed", range(3))


def heard_in(seed: int) -> list[Observation]:
    """What a tap receives of the example."""
    return received_of(compiled(NAVIGATION)[1], seed, SECONDS)


def ticked(seed: int) -> list[TreeTick]:
    run = SimulatedRun(compiled(NAVIGATION)[1], SimulatedWorld(seed, SLOW))
    run.run(SECONDS)
    return run.ticks


def results(heard: list[Observation], action: str) -> list[Any]:
    """How its goals ended: status and result."""
    channel, sent = f"{action}/_action/get_result", ObservationKind.RESPONSE_SENT
    return [(ENDS[seen.data["status"]], seen.data["result"]) for seen in of(heard, channel, sent)]


def answers(ticks: list[TreeTick], leaf: str) -> Iterator[str]:
    return (item.status for tick in ticks for item in tick.leaves if item.name == leaf)


def test_the_example_has_no_findings() -> None:
    log = DiagnosticLog()
    system = read(NAVIGATION)
    check_system(system, log)
    assert log.diagnostics == []
    assert (len(system.nodes), len(system.plugins)) == (4, 6)


@seeds
def test_the_robot_drives_from_place_to_place(seed: int) -> None:
    poses = of(heard_in(seed), "/robot_pose", ObservationKind.MESSAGE)
    at = [
        (seen.data["pose"]["position"]["x"], seen.data["pose"]["position"]["y"]) for seen in poses
    ]
    visited = [place for place in at if place in PLACES]
    changes = [
        place for number, place in enumerate(visited) if visited[number - 1 : number] != [place]
    ]
    assert len(changes) > 8
    assert changes == [PLACES[number % 3] for number in range(len(changes))]


@seeds
def test_goals_end_in_every_way_and_results_go_to_ports(seed: int) -> None:
    heard, ticks = heard_in(seed), ticked(seed)
    driven = results(heard, "/follow_path")
    assert {end for end, _ in driven} == set(ENDS.values())
    assert {result["error_code"] for end, result in driven if end == "aborted"} == {106}
    planned = results(heard, "/compute_path_to_pose")
    assert {len(result["path"]["poses"]) for end, result in planned if end == "succeeded"} == {4}
    assert {result["error_code"] for end, result in planned if end == "aborted"} == {208}
    written = {out.key for tick in ticks for leaf in tick.leaves for out in leaf.outputs}
    assert written == {"goal", "path", "distance", "error_code_id"}


@seeds
def test_it_recovers_and_stands_still_while_it_is_paused(seed: int) -> None:
    ticks = ticked(seed)
    assert {"SUCCESS", "RUNNING"} <= set(answers(ticks, "Spin"))
    assert set(answers(ticks, "ClearEntireCostmap")) == {"SUCCESS"}
    assert "HALTED" in set(answers(ticks, "FollowPath"))
    assert {tick.status for tick in ticks} == {"SUCCESS", "FAILURE", "RUNNING"}
    paused = [tick for tick in ticks if tick.leaves[0].status == "SUCCESS"]
    running = [leaf for tick in paused for leaf in tick.leaves if leaf.status == "RUNNING"]
    assert len(paused) > 30
    assert not running
