"""No loss of observations makes a healthy node look broken (decision 26)."""

from __future__ import annotations

import pytest

from tests.offline import losing
from tests.offline.losing import Tour, accusations, pattern, recorded, verdicts

pytestmark = pytest.mark.slow

PATTERNS = 12
EVERY, EVERY_RECORDED = 211, 13
"""Of the simulated tour, which is long, and of recorded ones; ``make soak`` tries all."""


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Tour:
    """A whole tour on virtual time."""
    return losing.simulated(tmp_path_factory.mktemp("tour"), seconds=20.0)


@pytest.mark.parametrize("name", ["zenoh", "ros2"])
def test_no_single_loss_of_a_recorded_tour_is_a_violation(name: str) -> None:
    tour = recorded(name)
    found = tour.observations
    assert len(found) > 150
    assert not verdicts_of(tour, [])
    for index in found[::EVERY_RECORDED]:
        assert not verdicts_of(tour, [index]), f"without {tour.entries[index]}"


def test_no_single_loss_of_a_whole_tour_is_a_violation(simulated: Tour) -> None:
    found = simulated.observations
    assert len(found) > 1000
    for index in found[::EVERY]:
        assert not verdicts_of(simulated, [index]), f"without {simulated.entries[index]}"


@pytest.mark.parametrize("first", [False, True])
def test_what_came_first_and_last_on_a_channel_may_be_missing(simulated: Tour, first: bool) -> None:
    """The first tells nobody that there is a channel, and after the last comes no number."""
    ends: dict[tuple[str, str, str], int] = {}
    for index in simulated.observations:
        seen = simulated.entries[index]
        key = (seen.source, seen.channel, seen.kind)
        if not first or key not in ends:
            ends[key] = index
    assert len(ends) > 80
    for index in list(ends.values())[::13]:
        assert not verdicts_of(simulated, [index]), f"without {simulated.entries[index]}"


def test_no_pattern_of_losses_is_a_violation(simulated: Tour) -> None:
    zenoh = recorded("zenoh")
    for seed in range(PATTERNS):
        for tour in (zenoh, simulated) if seed % 4 == 0 else (zenoh,):
            lost = pattern(tour, seed)
            assert not verdicts_of(tour, lost), f"{tour.name}, seed {seed}: {len(lost)} lost"


@pytest.mark.parametrize("name", ["T3", "T4", "T5", "T6"])
@pytest.mark.parametrize("transport", ["zenoh", "ros2"])
def test_where_nothing_is_lost_faults_are_found_all_the_same(name: str, transport: str) -> None:
    tour = recorded(transport, name)
    assert accusations(tour.entries)


def verdicts_of(tour: Tour, lost: list[int]) -> list[str]:
    """The violations that are said of ``tour`` without what was ``lost``."""
    return accusations(tour.without(lost))


def test_what_was_lost_is_said() -> None:
    tour = recorded("zenoh")
    said = [v for v in verdicts(tour.without(tour.observations[40:43])) if v.reason]
    assert any("lost" in v.reason or "missing" in v.reason for v in said), said
