"""The oracle against the reference, on many random cases.

``python -m tests.oracle.agreement --pairs 100000`` prints how often they say the same, and every
case in which they do not (its seed gives it back: ``case(Random(seed))``). Exit code 1 if there is one
that is not excused: where chance decides, the oracle calculates with ranges and may be too lenient,
but never too strict.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from random import Random

import msgspec

from moon.oracle.bounds import Bounds
from moon.oracle.oracle import Oracle
from moon.verdict import Outcome
from tests.oracle.machines import TIMER_HZ, library
from tests.oracle.strategies import Case, case

CLOCK_ALLOWANCE_NS = round(1e9 / TIMER_HZ) // 1000
"""The oracle allows a timer 0.1 % of its period more than its tolerance."""


class Answer(msgspec.Struct, frozen=True):
    """What both say of one case; ``outcome`` is the oracle's worst verdict."""

    conforms: bool
    outcome: Outcome
    reason: str = ""

    @property
    def same(self) -> bool:
        """Whether they agree."""
        wanted = Outcome.CONFORMING if self.conforms else Outcome.VIOLATED
        return self.outcome is wanted


def answer(found: Case) -> Answer:
    """Ask both."""
    bounds = Bounds(
        latency=found.latency_ns,
        deadline=found.deadline_ns,
        tolerance=found.tolerance_ns - CLOCK_ALLOWANCE_NS,
    )
    oracle = Oracle(found.machine, library(), bounds=bounds)
    oracle.start(0, whole=True)
    verdicts = [verdict for item in found.trace.observations for verdict in oracle.feed(item)]
    verdicts += oracle.advance(found.trace.end_ns + found.latency_ns)
    worst, reason = Outcome.CONFORMING, ""
    for verdict in verdicts:
        if _BADNESS[verdict.outcome] > _BADNESS[worst]:
            worst, reason = verdict.outcome, verdict.reason
    return Answer(found.conforms(check_calls=True), worst, reason)


_BADNESS = {Outcome.CONFORMING: 0, Outcome.INCONCLUSIVE: 1, Outcome.VIOLATED: 2}


def excused(found: Case, given: Answer) -> bool:
    """Whether a difference is one that chance excuses: too lenient, never too strict."""
    by_chance = "Math.random" in found.text
    return by_chance and not given.conforms and given.outcome is Outcome.CONFORMING


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Compare the oracle with the reference.")
    parser.add_argument("--pairs", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    arguments = parser.parse_args()
    counts: Counter[str] = Counter()
    faults = 0
    for seed in range(arguments.first, arguments.first + arguments.pairs):
        found = case(Random(seed))
        given = answer(found)
        said = "conforms" if given.conforms else "does not conform"
        if given.same:
            counts[f"both: {said}"] += 1
            continue
        allowed = excused(found, given)
        faults += not allowed
        counts[f"reference: {said}, oracle: {given.outcome}"] += 1
        note = " (excused: chance)" if allowed else ""
        print(f"seed {seed}: reference {said}, oracle {given.outcome} {given.reason}{note}")
    for text, count in sorted(counts.items()):
        print(f"{count:9d}  {text}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
