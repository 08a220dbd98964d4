"""The sorting cell: what happens in virtual time."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from m2c.check import check_system
from m2c.model import DiagnosticLog, load
from tests.examples.virtual import of, received_of
from tests.systems import EXAMPLES, SORTING_CELL, compiled
from transports.interface import Observation, ObservationKind

SECONDS = 120.0
KINDS = {"letter": (0, 0.5), "box": (1, 2.5)}
"""Bin and weight of each."""


def heard_in(seed: int) -> list[Observation]:
    """What a tap receives of the example."""
    return received_of(compiled(SORTING_CELL)[1], seed, SECONDS)


def events(heard: list[Observation], name: str) -> Iterator[dict[str, Any]]:
    """The params of each event of this name."""
    for seen in of(heard, f"/plain_events/{name}", ObservationKind.MESSAGE):
        yield seen.data


def test_the_example_has_no_findings() -> None:
    log = DiagnosticLog()
    system = load([EXAMPLES / SORTING_CELL / "system.xml"], log)
    assert system is not None
    check_system(system, log)
    assert log.diagnostics == []
    assert (len(system.nodes), len(system.plugins)) == (3, 4)


@pytest.mark.parametrize("seed", range(6))
def test_parcels_come_by_chance_and_leave_in_their_order(seed: int) -> None:
    heard = heard_in(seed)
    lists = [event["parcels"] for event in events(heard, "belt")]
    assert {len(parcels) for parcels in lists} >= {1, 2, 3, 4}
    kinds = {parcel["number"]: parcel["kind"] for parcels in lists for parcel in parcels}
    assert set(kinds.values()) == set(KINDS)
    for parcels in lists:
        numbers = [parcel["number"] for parcel in parcels]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers))) if numbers else True
    gripped = [event["number"] for event in events(heard, "gripped")]
    assert gripped == list(range(1, len(gripped) + 1))
    assert len(gripped) > 80
    slipped = [event["number"] for event in events(heard, "slipped")]
    assert 0.1 < len(slipped) / (len(slipped) + len(gripped)) < 0.35


@pytest.mark.parametrize("seed", range(6))
def test_each_parcel_goes_into_its_bin_or_into_the_third(seed: int) -> None:
    heard = heard_in(seed)
    parcels = {
        parcel["number"]: parcel for event in events(heard, "belt") for parcel in event["parcels"]
    }
    released = list(events(heard, "released"))
    full = 0
    for number, event in enumerate(released, 1):
        usual, weight = KINDS[parcels[number]["kind"]]
        assert event["weight"] == weight
        assert event["bin"] in {usual, 2}
        full += event["bin"] == 2
    assert 0 < full < len(released) / 2
    counts = [[item["count"] for item in event["bins"]] for event in events(heard, "bins")]
    assert max(count[0] for count in counts) == max(count[1] for count in counts) == 3
    assert counts[-1][2] == full


def test_a_run_is_a_function_of_its_seed() -> None:
    assert [seen.data for seen in heard_in(1)] == [seen.data for seen in heard_in(1)]
    assert [seen.data for seen in heard_in(1)] != [seen.data for seen in heard_in(2)]
