"""A failing case, made smaller as long as it fails in the same way, and the command that repeats it."""

from __future__ import annotations

import shlex
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec

from m2c.model import ModelError
from moon.monitor.subject import NothingLeftError
from tests.campaign.circumstances import Circumstances, fewer
from tests.campaign.plans import InvalidPlanError, Plan, write
from tests.campaign.reductions import candidates, is_valid
from tests.campaign.systems import Trait, make
from tests.campaign.trial import Failure, Fault, Prepared, Result, try_one

_SHORTEST_S = 0.5


class Case(msgspec.Struct, frozen=True):
    """What is tried.

    Attributes:
        seed, size, traits: of the system (``systems.make``); the seed is the world's, too.
        made: what it is run under.
        less: which of ``reductions.candidates`` was taken, again and again: the system is smaller.
    """

    seed: int
    size: int
    made: Circumstances
    less: tuple[int, ...] = ()
    traits: tuple[Trait, ...] = ()

    def plan(self) -> Plan:
        """The system.

        Raises:
            ValueError: ``less`` names none.
        """
        plan = make(self.seed, self.size, self.traits)
        for number in self.less:
            plan = _nth(candidates(plan), number)
        return plan

    def command(self) -> str:
        """What repeats it."""
        words = [
            "python",
            "-m",
            "tests.campaign",
            "--seed",
            str(self.seed),
            "--size",
            str(self.size),
        ]
        words += [word for trait in self.traits for word in ("--trait", trait)]
        if self.less:
            words += ["--less", ",".join(map(str, self.less))]
        words += ["--conditions", msgspec.json.encode(_short(self.made)).decode()]
        return shlex.join(words)


def _nth(plans: Iterator[Plan], number: int) -> Plan:
    for at, plan in enumerate(plans):
        if at == number:
            return plan
    raise ValueError(f"there is no smaller system {number}")


def _short(made: Circumstances) -> dict[str, object]:
    """What is not as usual."""
    shown: dict[str, object] = msgspec.to_builtins(made)
    usual = msgspec.to_builtins(Circumstances().conditions)
    conditions = msgspec.to_builtins(made.conditions)
    shown["conditions"] = {
        name: value for name, value in conditions.items() if value != usual[name]
    }
    return shown


def run(case: Case, keep: Path | None = None, source: Path | None = None) -> Result:
    """Try ``case``.

    Args:
        case: which.
        keep: where the recording is left; None: nowhere.
        source: where the system is left; None: nowhere.
    """
    with tempfile.TemporaryDirectory() as folder:
        prepared = Prepared(write(case.plan(), source or Path(folder)))
        return try_one(prepared, case.seed, case.made, keep)


class Shrinker:
    """Makes one case smaller.

    Args:
        case: it fails.
        fault: in this way; a smaller one fails so, too, whomever it is about.
        seconds: so long at most.
    """

    def __init__(self, case: Case, fault: Fault, seconds: float) -> None:
        self.case = case
        self._fault = fault
        self._until_s = time.monotonic() + seconds

    def shrink(self) -> Case:
        """The smallest that was found."""
        changed = True
        while changed and not self._is_over():
            changed = self._circumstances() | self._seconds() | self._system()
        return self.case

    def _is_over(self) -> bool:
        return time.monotonic() >= self._until_s

    def _fails(self, case: Case) -> bool:
        if self._is_over():
            return False
        try:
            result = run(case)
        except (InvalidPlanError, ModelError, NothingLeftError):
            return False
        if any(failure.fault is self._fault for failure in result.failures):
            self.case = case
            return True
        return False

    def _circumstances(self) -> bool:
        found = False
        while any(self._fails(self._with(made)) for made in fewer(self.case.made)):
            found = True
        return found

    def _with(self, made: Circumstances) -> Case:
        return msgspec.structs.replace(self.case, made=made)

    def _seconds(self) -> bool:
        found = False
        for share in (0.5, 0.75, 0.9):
            while self.case.made.seconds > _SHORTEST_S:
                seconds = round(self.case.made.seconds * share, 2)
                made = msgspec.structs.replace(self.case.made, seconds=seconds)
                if not self._fails(self._with(made)):
                    break
                found = True
        return found

    def _system(self) -> bool:
        found = False
        at = 0
        while not self._is_over():
            plan = self.case.plan()
            taken = self._take_one(plan, at)
            if taken is None:
                return found
            found, at = True, taken  # what stands before it does not make it smaller
        return found

    def _take_one(self, plan: Plan, begin: int) -> int | None:
        for number, smaller in enumerate(candidates(plan)):
            if number < begin or not is_valid(smaller):
                continue
            less = (*self.case.less, number)
            if self._fails(msgspec.structs.replace(self.case, less=less)):
                return number
            if self._is_over():
                return None
        return None


def shrunk(case: Case, failures: Sequence[Failure], seconds: float) -> Case:
    """``case`` as small as it gets in ``seconds``, failing as the first of ``failures`` says."""
    return Shrinker(case, failures[0].fault, seconds).shrink()
