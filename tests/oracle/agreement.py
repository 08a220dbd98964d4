"""The oracle against the reference, on many random cases.

``python -m tests.oracle.agreement --pairs 100000`` prints how often they say the same, and every
case in which they do not (its seed gives it back: ``case(Random(seed))``). Exit code 1 if there is one.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Iterable
from random import Random

import msgspec
from msgspec.structs import replace

from moon.oracle.bounds import Bounds
from moon.oracle.confirmation import Losses
from moon.oracle.oracle import Oracle
from moon.oracle.shared import Shared
from moon.verdict import Outcome
from tests.oracle.machines import NAME, TIMER_HZ, library, model, nested_model
from tests.oracle.reference import TooLongError
from tests.oracle.strategies import Case, case
from transports.interface import Observation

CLOCK_ALLOWANCE_NS = round(1e9 / TIMER_HZ) // 1000
"""The oracle allows a timer 0.1 % of its period more than its tolerance."""


class Answer(msgspec.Struct, frozen=True):
    """What both say of one case.

    Attributes:
        conforms: what the reference says.
        outcome: the oracle's worst verdict.
        reason: its reason.
        excused: the oracle lets a timer be off its time anew in each period, so that a clock that was set by
            some ms is no fault, and a machine stand still where what it does shows it, and does not conclude
            from an output when a delay began: whether the reference, allowing that, finds the case to conform
            as well.
    """

    conforms: bool
    outcome: Outcome
    reason: str = ""
    excused: bool = False

    @property
    def same(self) -> bool:
        """Whether they agree."""
        wanted = Outcome.CONFORMING if self.conforms or self.excused else Outcome.VIOLATED
        return self.outcome is wanted


def bounds_of(found: Case, hypotheses: int = Bounds().hypotheses) -> Bounds:
    """The bounds by which an oracle judges ``found`` as the reference does."""
    return Bounds(
        latency=found.latency_ns,
        deadline=found.deadline_ns,
        tolerance=found.tolerance_ns - CLOCK_ALLOWANCE_NS,
        hypotheses=hypotheses,
    )


def accusations(
    oracle: Oracle, received: Iterable[Observation], step_ns: int, until_ns: int
) -> list[str]:
    """Why ``oracle`` finds the machine violated, while time passes as things are received.

    Args:
        oracle: started.
        received: what is received, in that order.
        step_ns: time passes in such steps (ns) between two of them.
        until_ns: and after the last until then.
    """
    now_ns, verdicts = 0, []
    for item in received:
        for at_ns in range(now_ns, item.received_ns, step_ns):
            verdicts += oracle.advance(at_ns)
        now_ns = item.received_ns
        verdicts += oracle.feed(item)
    verdicts += oracle.advance(until_ns)
    return [verdict.reason for verdict in verdicts if verdict.outcome is Outcome.VIOLATED]


def answer(found: Case, ordered: bool = False, hypotheses: int = Bounds().hypotheses) -> Answer:
    """Ask both.

    Args:
        found: the case.
        ordered: whether the machine's node numbers all that it does.
        hypotheses: so many are followed at once.
    """
    bounds = bounds_of(found, hypotheses)
    oracle = Oracle(
        found.machine, library(), bounds=bounds, shared=Shared(losses=Losses(possible=False))
    )
    oracle.start(0, whole=True)
    heard = found.trace.observations
    verdicts = [v for item in (numbered(heard) if ordered else heard) for v in oracle.feed(item)]
    # what is settled lags one latency bound behind
    verdicts += oracle.advance(found.trace.end_ns + found.latency_ns)
    worst, reason = Outcome.CONFORMING, ""
    for verdict in verdicts:
        if _BADNESS[verdict.outcome] > _BADNESS[worst]:
            worst, reason = verdict.outcome, verdict.reason
    conforms = found.conforms(check_calls=True, allowed_ns=CLOCK_ALLOWANCE_NS)
    excused = (
        not conforms
        and worst is Outcome.CONFORMING
        and found.conforms(
            check_calls=True,
            adds_up=True,
            stands_still=True,
            wide=True,
            allowed_ns=CLOCK_ALLOWANCE_NS,
        )
    )
    return Answer(conforms, worst, reason, excused)


def numbered(heard: Iterable[Observation]) -> list[Observation]:
    """What the machine's node did, in the order of the stamps, has numbers."""
    order = itertools.count()
    return [
        replace(item, order=next(order)) if item.source == NAME else item
        for item in sorted(heard, key=lambda item: item.stamp_ns)
    ]


_BADNESS = {Outcome.CONFORMING: 0, Outcome.INCONCLUSIVE: 1, Outcome.VIOLATED: 2}


def disagreement(seed: int, nested: bool = False, delays: bool = False) -> str:
    """Where oracle and reference differ in one case; "" if they agree.

    Args:
        seed: of the case.
        nested: of a machine with compound states.
        delays: of a machine with delayed transitions and events.
    """
    draw = Random(seed)
    found = case(draw, text=(nested_model if nested else model)(draw, delays))
    for ordered in (False, True):
        try:
            given = answer(found, ordered)
        except TooLongError:
            return ""
        if not given.same:
            return (
                f"seed {seed} ({found.made or 'unchanged'}{', ordered' if ordered else ''}): "
                f"conforms: {given.conforms}, oracle: {given.outcome} {given.reason}"
            )
    return ""


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Compare the oracle with the reference.")
    parser.add_argument("--pairs", type=int, default=10_000)
    parser.add_argument("--nested", action="store_true", help="machines with compound states")
    parser.add_argument("--delays", action="store_true", help="delayed transitions and events")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    arguments = parser.parse_args()
    different = 0
    for count in range(1, arguments.pairs + 1):
        text = disagreement(arguments.first + count - 1, arguments.nested, arguments.delays)
        if text:
            different += 1
            print(text, flush=True)
        if count % 200 == 0 or count == arguments.pairs:
            print(f"{count} cases, {different} disagreements", flush=True)
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
