"""The oracle against a brute-force checker: same verdict on random machines and traces.

Run as a program for long runs: ``python -m tests.oracle.test_against_reference FIRST LAST``.
"""

from __future__ import annotations

import sys
from random import Random

import pytest

from m2c.model.machine import InterfaceKind
from moon.oracle.bounds import Bounds
from moon.oracle.oracle import Oracle
from moon.verdict import Outcome, Verdict
from tests.oracle.machines import library
from tests.oracle.strategies import Case, case

CASES = 1600
"""In the suite; ``make soak`` runs 100 000."""
BLOCKS = 8


def judged(found: Case) -> tuple[Outcome, list[Verdict]]:
    """What the oracle says of a whole case at its end, and all its verdicts."""
    bounds = Bounds(
        latency=found.latency_ns, deadline=found.deadline_ns, tolerance=found.tolerance_ns
    )
    oracle = Oracle(found.machine, library(), found.machine.name, bounds)
    oracle.start(0, whole=True)
    verdicts = [v for item in found.trace.observations for v in oracle.feed(item)]
    # what is settled lags one latency bound behind
    verdicts += oracle.advance(found.trace.end_ns + found.latency_ns)
    outcomes = {verdict.outcome for verdict in verdicts}
    for outcome in (Outcome.VIOLATED, Outcome.INCONCLUSIVE):
        if outcome in outcomes:
            return outcome, verdicts
    return Outcome.CONFORMING, verdicts


def has_timers(found: Case) -> bool:
    """With a timer the oracle allows more: a tick may be as late as a message."""
    return any(item.kind is InterfaceKind.TIMER for item in found.machine.interfaces)


def disagreement(seed: int) -> str:
    """Where oracle and reference differ in one case; "" if they agree."""
    found = case(Random(seed))
    truth = found.conforms(check_calls=True)
    outcome, verdicts = judged(found)
    if outcome is (Outcome.CONFORMING if truth else Outcome.VIOLATED):
        return ""
    if has_timers(found) and not truth and outcome is Outcome.CONFORMING:
        return ""
    reasons = "; ".join(verdict.reason for verdict in verdicts)
    return (
        f"seed {seed} ({found.made or 'unchanged'}): conforms: {truth}, oracle: {outcome} {reasons}"
    )


@pytest.mark.parametrize("block", range(BLOCKS))
def test_the_oracle_agrees_with_the_reference(block: int) -> None:
    size = CASES // BLOCKS
    found = [disagreement(seed) for seed in range(block * size, (block + 1) * size)]
    assert not any(found), "\n".join(filter(None, found))


@pytest.mark.parametrize("seed", [30032, 209455, 577114])
def test_cases_that_once_told_them_apart_are_agreed_on(seed: int) -> None:
    assert not disagreement(seed)


def test_the_cases_are_of_both_kinds() -> None:
    truths = [case(Random(seed)).conforms(check_calls=True) for seed in range(100)]
    assert 20 < sum(truths) < 80


if __name__ == "__main__":
    first, last = int(sys.argv[1]), int(sys.argv[2])
    different = 0
    for number in range(first, last):
        text = disagreement(number)
        if text:
            different += 1
            print(text, flush=True)
        if (number - first) % 1000 == 999:
            print(f"{number - first + 1} cases, {different} disagreements", flush=True)
    sys.exit(1 if different else 0)
