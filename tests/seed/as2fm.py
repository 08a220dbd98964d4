"""Runs of AS2FM's systems as it has them: in steps, until their properties are decided."""

from __future__ import annotations

import itertools
import logging
import sys
import time
from pathlib import Path
from typing import Any

import msgspec

from m2c.check.reading import read_and_check
from m2c.model import DiagnosticLog, Severity
from m2c.model.system import System
from m2c.simulation.program import Program, compile_system
from m2c.simulation.run import SimulatedRun
from m2c.simulation.semantics import Semantics
from tests.seed.jani import Decider, Property, State, leaves_of, properties_of
from transports.interface import Observation

SEED = Path(__file__).parents[3] / "shared" / "as2fm"
MAX_EVENTS = 200_000
"""A chain of steps without end needs no time: a run that has not decided after so many does not."""


class Case(msgspec.Struct, frozen=True):
    """What AS2FM's own tests expect: the probability of a property."""

    system: str
    property: str
    probability: float
    tolerance: float
    upstream_checks_it: bool


def cases() -> list[Case]:
    """All of them."""
    return msgspec.json.decode((SEED / "expected.json").read_bytes(), type=list[Case])


class Row(msgspec.Struct):
    """What became of a case: how far it came, and in how many of how many runs its property held."""

    case: Case
    accepted: bool = False
    generated: bool = False
    fault: str = ""
    held: int = 0
    runs: int = 0

    @property
    def agrees(self) -> bool:
        """Whether each run says what a probability of 0 or 1 does."""
        return bool(self.runs) and not self.fault and self.held == self.runs * self.case.probability

    def line(self) -> str:
        """This row of the table."""
        case = self.case
        steps = [self.accepted, self.generated, bool(self.runs) and not self.fault]
        got = f"{self.held}/{self.runs}" if self.runs else "-"
        name = case.system.removesuffix(".xml").removesuffix("/main")
        marks = "  ".join("yes" if step else "NO " for step in steps)
        return (
            f"{name:48} {case.property:42} {marks}  {case.probability:5g}  {got:>5}  {self.fault}"
        )


HEADER = f"{'system':48} {'property':42} acc  gen  run  expct    got"


def table(chosen: list[Case], seeds: int, **changed: object) -> list[Row]:
    """What becomes of ``chosen``: each system is read once, and run with that many seeds.

    ``changed``: attributes of the systems that are other than their files say.
    """
    rows = []
    for name, found in itertools.groupby(chosen, lambda case: case.system):
        mine = [Row(case) for case in found]
        rows += mine
        log = DiagnosticLog()
        system = read_and_check([SEED / name], [], log)
        if system is None or log.has_errors:
            errors = [item for item in log.diagnostics if item.severity is Severity.ERROR]
            for row in mine:
                row.fault = str(errors[0]) if errors else "nothing was read"
            continue
        system = msgspec.structs.replace(system, **changed)
        program = compile_system(system, Semantics.AS2FM)
        known = properties_of(SEED / name)
        for row in mine:
            row.accepted = row.generated = True
        for seed in range(seeds):
            held, fault = run(system, program, [known[row.case.property] for row in mine], seed)
            for row in mine:
                row.runs += 1
                row.held += held[row.case.property]
                row.fault = row.fault or fault
    return rows


class _Errors(logging.Handler):
    """Keeps what nodes log as errors."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.texts: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep ``record``."""
        self.texts.append(f"{record.name}: {record.getMessage()}")


def run(
    system: System, program: Program, wanted: list[Property], seed: int
) -> tuple[dict[str, bool], str]:
    """Which of ``wanted`` one run satisfies (what is not decided at its end, it does not), and its first error."""
    world = program.semantics.world(seed)
    seconds = system.max_time_s or 100.0
    deciders = {item.name: Decider(item) for item in wanted}

    def entry(key: str) -> Any:
        board = running.policy._tree.root_blackboard()  # type: ignore[union-attr]  # the tests' own way in
        try:
            return board.get_int(key)
        except RuntimeError:
            return None

    state = State(leaves_of(system.policy) if system.policy else {}, entry)
    end_ns = world.now_ns + round(seconds * 1e9)

    def observe(event: Observation) -> None:
        if event.received_ns <= end_ns:
            state.observe(event)
            look()

    def look() -> None:
        for decider in deciders.values():
            decider.look(state)

    def is_over() -> bool:
        return world.events > MAX_EVENTS or all(it.holds is not None for it in deciders.values())

    world.connect("observer").tap([], observe)
    running = SimulatedRun(
        program, world, program.semantics.settings(seconds), tick_timeout_s=seconds + 1.0
    )
    look()
    errors = _Errors()
    logging.getLogger().addHandler(errors)
    try:
        running.run(seconds, is_over)
    finally:
        logging.getLogger().removeHandler(errors)
    world.close()
    held = {name: bool(decider.holds) for name, decider in deciders.items()}
    return held, next(iter(errors.texts), "")


def main() -> None:
    """Print the table, of the systems whose names have one of the given parts."""
    parts = sys.argv[1:]
    chosen = [it for it in cases() if not parts or any(part in it.system for part in parts)]
    print(HEADER)
    for name, found in itertools.groupby(chosen, lambda case: case.system):
        began = time.monotonic()
        for row in table(list(found), 2):
            print(" " if row.agrees else "*", row.line())
        print(f"    {name} {time.monotonic() - began:.2f} s", file=sys.stderr)


if __name__ == "__main__":
    main()
