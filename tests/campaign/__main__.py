"""The campaign: ``python -m tests.campaign --seeds FROM:TO``, or ``--seed N --size K --conditions JSON`` for one case.

Each seed is a system, and some circumstances under which it is run. Ends with 1 if anything that was said is
wrong; each failing case is made smaller and printed as the command that repeats it.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import msgspec

from moon.monitor.subject import NothingLeftError
from tests import garbage
from tests.campaign.bags import draw_bag
from tests.campaign.circumstances import UNTIL_S, Circumstances, draw, later, nominal
from tests.campaign.plans import write
from tests.campaign.shrink import Case, run, shrunk
from tests.campaign.systems import SIZES, Trait, make, traits_of
from tests.campaign.trial import Failure, Fault, Prepared, Result, try_one

EACH = 5
"""So many trials of each system: one in which nothing is wrong, one with a mutant, the others drawn. A mutant
that is found is tried once more, with a monitor that comes late."""
MOST_STUCK = 0.1
"""So great a share of the machines that should be judged again at most is not: silence would be sound, too."""
MOST_UNFOUND = 0.1
"""So great a share of the mutants that go on showing at most is not found by who came late: what shows only by
data that was set before nobody can find, and no rule but the oracle's own tells which these are.
"""
_ENOUGH = 20
"""A share of fewer is none."""
_LONG_S = 30.0
"""A trial of which is said that it takes long: most take less than one."""
_SIZES = (1, 1, 2, 2, 3)


class Tried(msgspec.Struct):
    """A case, what came of it, and how long that took (s)."""

    case: Case
    result: Result
    took_s: float = 0.0


def size_of(seed: int) -> int:
    """The size of the system of a seed."""
    return random.Random(f"size {seed}").choice(_SIZES)


def cases(seed: int, each: int = EACH, besides: Sequence[Trait] = ()) -> Iterator[Tried]:
    """Try the system of ``seed`` in ``each`` ways, with the traits ``besides`` its own."""
    size, traits = size_of(seed), tuple(dict.fromkeys((*traits_of(seed), *besides)))
    with tempfile.TemporaryDirectory() as folder:
        plan = make(seed, size, traits)
        try:
            prepared = Prepared(write(plan, Path(folder)))
            happened = prepared.happened(seed, UNTIL_S)
        except (
            NothingLeftError
        ):  # all of its machines hear what is best effort, and there is no property
            return
        except (
            Exception
        ) as error:  # a system that cannot even run is a fault of m2c's, or of the campaign's
            failure = Failure(Fault.RAISED, plan.name, f"{type(error).__name__}: {error}")
            yield Tried(
                Case(seed, size, Circumstances(), (), traits),
                Result((failure,), 0, 0, 0, ()),
            )
            return
        for number in range(each):
            choice = random.Random(f"{seed} {number}")
            made = nominal(choice) if number < 2 else draw(choice, happened)
            if number == 0:
                bag = draw_bag(random.Random(f"bag {seed}"), happened.seen)
                made = msgspec.structs.replace(made, bag=bag)
            if number == 1:
                made = msgspec.structs.replace(made, faulty=prepared.faulty(choice))
            tried = _tried(prepared, Case(seed, size, made, (), traits))
            yield tried
            if tried.result.detected and made.is_whole:
                late = later(random.Random(f"late {seed}"), made)
                yield _tried(prepared, Case(seed, size, late, (), traits))


def _tried(prepared: Prepared, case: Case) -> Tried:
    began_s = time.monotonic()
    result = try_one(prepared, case.seed, case.made)
    return Tried(case, result, time.monotonic() - began_s)


def all_cases(seed: int, each: int, besides: Sequence[Trait]) -> list[Tried]:
    """The same at once, for another process."""
    return list(cases(seed, each, besides))


class Summary:
    """What came of all."""

    def __init__(self) -> None:
        self.trials = self.observations = self.judged = self.settled = self.stuck = 0
        self.mutants = self.found = self.late_mutants = self.found_late = 0
        self.of_bags = self.in_bags = 0
        self.faults: Counter[Fault] = Counter()
        self.slowest = Tried(Case(0, 1, Circumstances()), Result((), 0, 0, 0, ()))

    def take(self, tried: Tried) -> None:
        """One more."""
        result = tried.result
        self.slowest = max(self.slowest, tried, key=lambda one: one.took_s)
        self.trials += 1
        self.observations += result.observations
        self.judged += result.judged
        self.settled += result.settled
        self.stuck += len(result.stuck)
        self.in_bags += result.in_bag[0]
        self.of_bags += result.in_bag[1]
        if result.detected is not None and tried.case.made.joins_s:
            self.late_mutants += 1
            self.found_late += result.detected
        elif result.detected is not None:
            self.mutants += 1
            self.found += result.detected
        found = (failure.fault for failure in result.failures)
        self.faults.update(fault for fault in found if fault is not Fault.MISSED_LATE)

    @property
    def is_too_silent(self) -> bool:
        """Whether too many machines stay inconclusive for no reason that lasts."""
        return self.settled >= _ENOUGH and self.stuck > MOST_STUCK * self.settled

    @property
    def is_too_blind(self) -> bool:
        """Whether who came late does not find too many mutants that go on showing."""
        missed = self.late_mutants - self.found_late
        return self.late_mutants >= _ENOUGH and missed > MOST_UNFOUND * self.late_mutants

    @property
    def has_failed(self) -> bool:
        """Whether anything is wrong."""
        return bool(self.faults) or self.is_too_silent or self.is_too_blind

    def table(self) -> str:
        """For people."""
        rows = [
            ("trials", self.trials),
            ("observations", self.observations),
            ("machines, policies and properties judged", self.judged),
            ("mutants that the run shows, found", f"{self.found} of {self.mutants}"),
            (
                "mutants that go on showing, found by who came late",
                f"{self.found_late} of {self.late_mutants}",
            ),
            (
                "machines to be judged again at the end, that are not",
                f"{self.stuck} of {self.settled}",
            ),
            (
                "machines of which something is concluded from a bag of others",
                f"{self.in_bags} of {self.of_bags}",
            ),
            (
                f"seconds that the slowest took, seed {self.slowest.case.seed}",
                f"{self.slowest.took_s:.1f}",
            ),
            *((f"wrong: {fault}", count) for fault, count in sorted(self.faults.items())),
        ]
        width = max(len(name) for name, _ in rows)
        return "\n".join(f"{name:{width}}  {value}" for name, value in rows)


def campaign(
    seeds: Iterable[int],
    seconds: float | None,
    each: int,
    processes: int,
    shrink_s: float,
    besides: Sequence[Trait] = (),
) -> Summary:
    """Try all ``seeds``, or as many as ``seconds`` allow, with the traits ``besides`` their own."""
    began_s = told_s = time.monotonic()
    summary = Summary()
    waiting = iter(seeds)
    with ProcessPoolExecutor(processes, initializer=garbage.look_seldom) as pool:
        running = {
            pool.submit(all_cases, seed, each, besides) for seed in _some(waiting, 2 * processes)
        }
        while running:
            done = next(as_completed(running))
            running.remove(done)
            for tried in done.result():
                summary.take(tried)
                if tried.took_s > _LONG_S:
                    print(
                        f"  {tried.took_s:.0f} s: {tried.case.command()}",
                        file=sys.stderr,
                        flush=True,
                    )
                if tried.result.failures:
                    tell(tried, shrink_s)
            now_s = time.monotonic()
            if seconds is None or now_s - began_s < seconds:
                running |= {
                    pool.submit(all_cases, seed, each, besides) for seed in _some(waiting, 1)
                }
            if now_s - told_s > 30:
                told_s = now_s
                wrong = sum(summary.faults.values())
                print(f"{summary.trials} trials, {wrong} wrong", file=sys.stderr, flush=True)
    return summary


def _some(seeds: Iterator[int], count: int) -> list[int]:
    return [seed for seed, _ in zip(seeds, range(count), strict=False)]


def tell(tried: Tried, shrink_s: float) -> None:
    """Print what is wrong, and how it is repeated."""
    case = tried.case
    for failure in tried.result.failures:
        print(f"{failure.fault}: {failure.about}: {failure.text}", flush=True)
    if shrink_s:
        case = shrunk(case, tried.result.failures, shrink_s)
    print(f"  again: {case.command()}", flush=True)


def one(chosen: argparse.Namespace) -> int:
    """Try one case, as the command line says; the exit code."""
    made = msgspec.json.decode(chosen.conditions, type=Circumstances)
    if chosen.system is not None:
        return told(try_one(Prepared(chosen.system), chosen.seed, made, chosen.record))
    less = tuple(int(number) for number in chosen.less.split(",") if number)
    size = size_of(chosen.seed) if chosen.size is None else chosen.size
    case = Case(chosen.seed, size, made, less, tuple(map(Trait, chosen.trait)))
    result = run(case, chosen.record, chosen.write)
    if result.failures and chosen.shrink:
        tell(Tried(case, result), chosen.shrink)
        return 1
    return told(result)


def told(result: Result) -> int:
    """Print what came of one case; the exit code."""
    for failure in result.failures:
        print(f"{failure.fault}: {failure.about}: {failure.text}")
    for name in result.stuck:
        print(f"still inconclusive: {name}")
    print(f"{result.observations} observations, {len(result.failures)} wrong")
    return 1 if result.failures else 0


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.campaign", description=__doc__)
    parser.add_argument("--seeds", help="FROM:TO, without TO")
    parser.add_argument("--seconds", type=float, help="no new system is begun after so many")
    parser.add_argument("--each", type=int, default=EACH, help="trials of each system")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--shrink", type=float, default=60.0, help="seconds for each failing case")
    parser.add_argument("--seed", type=int, help="of one case")
    parser.add_argument("--size", type=int, choices=SIZES)
    parser.add_argument(
        "--trait",
        action="append",
        default=[],
        choices=list(Trait),
        help="of one case, or of all besides their own (repeatable)",
    )
    parser.add_argument("--system", type=Path, help="a system file instead of a random system")
    parser.add_argument(
        "--less", default="", help="which smaller system, as a failing case prints it"
    )
    parser.add_argument("--conditions", default="{}", help="of one case, JSON")
    parser.add_argument("--record", type=Path, help="leave the recording of one case here")
    parser.add_argument("--write", type=Path, help="leave the system of one case here")
    chosen = parser.parse_args(arguments)
    if (chosen.seed is None) == (chosen.seeds is None):
        parser.error("give --seeds FROM:TO, or --seed N for one case")
    if chosen.seed is not None:
        return one(chosen)
    first, _, last = chosen.seeds.partition(":")
    summary = campaign(
        range(int(first), int(last)),
        chosen.seconds,
        chosen.each,
        chosen.processes,
        chosen.shrink,
        tuple(map(Trait, chosen.trait)),
    )
    print(summary.table())
    if summary.is_too_silent:
        print(f"{Fault.STUCK}: more than {MOST_STUCK:.0%}")
    if summary.is_too_blind:
        print(f"{Fault.MISSED_LATE}: more than {MOST_UNFOUND:.0%}")
    return 1 if summary.has_failed else 0


if __name__ == "__main__":
    sys.exit(main())
