"""Trees of every shape, whatever their skills answer: no alarm while the tree runs that is expected."""

from __future__ import annotations

import re
from random import Random

import pytest

from moon.verdict import Outcome
from tests.monitor_policy.scripted import ACTIONS, CONDITIONS, HALTED, leaf, run, tree
from tests.monitor_policy.trees import random_tree
from transports.simulated import Conditions

pytestmark = pytest.mark.slow

LATE = Conditions(delay_s=(0.0, 0.02), tap_delay_s=(0.0, 0.15))
LOSSY = Conditions(delay_s=(0.0, 0.02), tap_delay_s=(0.0, 0.15), tap_loss=0.02, duplication=0.03)
BLOCKS = 4
BLOCK = 20


@pytest.mark.parametrize("block", range(BLOCKS))
def test_a_tree_that_runs_as_it_should_raises_no_alarm(block: int) -> None:
    for seed in range(block * BLOCK, (block + 1) * BLOCK):
        body = random_tree(Random(seed))
        heard = run(tree(body), seed, conditions=LATE)
        assert not heard.verdicts, f"{seed} {body}: {heard.reasons[:2]}"
        assert heard.oracle.outcome is Outcome.CONFORMING
        assert heard.oracle.outputs >= 60
        assert heard.oracle.inputs == heard.oracle.outputs


@pytest.mark.parametrize("block", range(BLOCKS))
def test_a_tree_that_remembers_or_waits_raises_no_alarm(block: int) -> None:
    conforming = 0
    for seed in range(block * BLOCK, (block + 1) * BLOCK):
        body = random_tree(Random(seed), remembering=True)
        heard = run(tree(body), seed, conditions=LATE)
        assert not heard.violations, f"{seed} {body}: {heard.reasons[:2]}"
        conforming += heard.oracle.outcome is Outcome.CONFORMING
    assert conforming >= BLOCK * 0.8


@pytest.mark.parametrize("block", range(BLOCKS))
def test_a_policy_found_in_the_middle_of_its_run_raises_no_alarm_and_is_found(block: int) -> None:
    found = 0
    for seed in range(block * BLOCK, (block + 1) * BLOCK):
        body = random_tree(Random(seed))
        heard = run(tree(body), seed, conditions=LATE, join_after=1 + seed % 7)
        assert not heard.violations, f"{seed} {body}: {heard.reasons[:2]}"
        found += heard.oracle.outcome is Outcome.CONFORMING
    assert found >= BLOCK * 0.7


@pytest.mark.parametrize("block", range(BLOCKS))
def test_lost_and_doubled_observations_raise_no_alarm(block: int) -> None:
    told = recovered = 0
    for seed in range(block * BLOCK, (block + 1) * BLOCK):
        body = random_tree(Random(seed), remembering=seed % 3 == 0)
        heard = run(tree(body), seed, conditions=LOSSY, join_after=seed % 2)
        assert not heard.violations, f"{seed} {body}: {heard.reasons[:2]}"
        told += bool(heard.verdicts)
        recovered += bool(heard.verdicts) and heard.oracle.outcome is Outcome.CONFORMING
    assert told > BLOCK / 4
    assert recovered > 0


@pytest.mark.parametrize("seed", range(20))
def test_a_policy_that_ends_and_starts_again_raises_no_alarm(seed: int) -> None:
    body = random_tree(Random(seed))
    heard = run(tree(body), seed, 20, LATE, runs=3)
    assert not heard.violations, f"{body}: {heard.reasons[:2]}"


def test_leaves_that_are_exchanged_are_noticed_wherever_they_stand() -> None:
    """The tree that runs has one leaf of another skill: its first tick is the first violation."""
    names = CONDITIONS + ACTIONS + HALTED
    noticed = 0
    for seed in range(60):
        draw = Random(seed)
        body = random_tree(draw)
        places = [match.span() for match in re.finditer(r"<(Action|Condition) [^>]*/>", body)]
        absent = [name for name in names if leaf(name) not in body]
        if not absent:
            continue
        start, end = draw.choice(places)
        other = draw.choice(absent)
        heard = run(tree(body), seed, actual=tree(body[:start] + leaf(other) + body[end:]))
        wrong = [
            seen.stamp_ns
            for seen in heard.observations
            if seen.source == "policy" and seen.channel == f"/{other}Skill/tick"
        ]
        stamps = [verdict.stamp_ns for verdict in heard.violations]
        assert bool(stamps) == bool(wrong)
        if wrong:
            assert min(stamps) == min(wrong), f"{seed} {body}"
            noticed += 1
    assert noticed > 30
