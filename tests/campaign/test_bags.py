"""Bags that others make of a run, with what may be wrong with them: nobody is accused who does as its model."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest

from moon.offline.engine import check_recording
from moon.offline.survey import NotJudgedError
from tests.campaign.__main__ import size_of
from tests.campaign.bags import Bag, Flaw, draw_bag, simpler, write_bag
from tests.campaign.circumstances import UNTIL_S
from tests.campaign.plans import write
from tests.campaign.systems import make, traits_of
from tests.campaign.trial import Prepared, try_bags
from transports.interface import Observation, ObservationKind

EACH = 6


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 3, 4, 7])
def test_no_bag_of_a_run_accuses_who_did_as_its_model(seed: int, tmp_path: Path) -> None:
    prepared = Prepared(write(make(seed, size_of(seed), traits_of(seed)), tmp_path))
    run = prepared.happened(seed, UNTIL_S).seen
    bags = [draw_bag(Random(f"{seed} {number}"), run) for number in range(EACH)]
    wrong = [
        f"{failure.fault}: {failure.about}: {failure.text}: {bag}"
        for bag, failure in try_bags(prepared, seed, bags)
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.slow
def test_the_same_run_twice_in_one_bag_is_not_judged(tmp_path: Path) -> None:
    seed = 3
    prepared = Prepared(write(make(seed, size_of(seed), traits_of(seed)), tmp_path))
    subject, monitored = prepared.subject(0.2)
    run = Bag().recorded(prepared.happened(seed, UNTIL_S).seen)
    path = tmp_path / "twice.mcap"
    write_bag(path, Bag(again=True, is_same=True), run, monitored.system)
    with pytest.raises(NotJudgedError, match="two runs in one file, with the same clients"):
        check_recording(path, subject, monitored)
    write_bag(path, Bag(again=True), run, monitored.system)
    result = check_recording(path, subject, monitored)
    assert "its clock was set back once" in "".join(result.recording.limits)


def run_of_two() -> list[Observation]:
    return [
        Observation(
            stamp_ns=10**18 + number,
            received_ns=10**18 + number,
            channel=f"/{number % 2}",
            kind=ObservationKind.MESSAGE,
            type_name="std_msgs/msg/Int32",
            data={"data": number},
            source=f"node{number % 2}",
        )
        for number in range(4)
    ]


def test_every_flaw_is_drawn_and_can_be_left_out() -> None:
    drawn = [draw_bag(Random(seed), run_of_two()) for seed in range(200)]
    usual = Bag()
    for name in set(Bag.__struct_fields__) - {"seed"}:
        assert any(getattr(bag, name) != getattr(usual, name) for bag in drawn), name
        assert any(
            getattr(bag, name) != getattr(usual, name)
            and any(getattr(less, name) == getattr(usual, name) for less in simpler(bag))
            for bag in drawn
        ), name
    assert len(Flaw) > len(Bag.__struct_fields__)
