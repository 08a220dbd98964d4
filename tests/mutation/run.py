"""The mutation run: every first-order mutant of every machine of an example, on trial.

``python -m tests.mutation.run [SYSTEM]`` (``make mutants``) writes the example's page, for the lab tour
``docs/mutants.md``. A run that was stopped goes on where it was with ``--resume``. Exit code 1: a machine as it should be raised an alarm, or
fewer than 99 % of the mutants that are not equivalent were found.
"""

from __future__ import annotations

import argparse
import functools
import logging
import multiprocessing
import os
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

import msgspec
from msgspec.structs import replace

from m2c.model.machine import Machine
from m2c.simulation.program import NodeClass, compile_node
from tests.mutation import Mutant, equivalence, mutants
from tests.mutation.by_hand import BY_HAND, HOLES
from tests.mutation.report import GOAL, Found, Result, document, page_of, summary
from tests.mutation.trial import SCENES, Scene, Trial, trial
from tests.mutation.waiting import UNAWAITED, without_unawaited_responses
from tests.systems import LAB_TOUR, SYSTEMS, compiled, read
from transports.interface import Observation

ROOT = Path(__file__).parents[2]
RECORD = ROOT / "build/mutants.jsonl"

PROCESSES = 2
NICE = 10
FIRST_S = 60.0
"""Virtual seconds of the first pass, in each scene…"""
LONG_S = 600.0
"""…and of the second, for survivors."""
FIRST_SEED, LONG_SEED = 1, 2
STUCK_S = 120
"""Seconds of processor time after which a trial is given up: the mutant does not come to rest."""


Key = tuple[str, str, int]
"""Of a trial: the example, the machine, and which of its mutants."""


class _StuckError(Exception):
    """A trial does not end."""


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Put all mutants of an example on trial.")
    parser.add_argument("system", nargs="?", choices=SYSTEMS, default=LAB_TOUR)
    parser.add_argument("--resume", action="store_true", help="keep results of a stopped run")
    parser.add_argument("--machine", action="append", help="only its mutants (repeatable)")
    parser.add_argument("--output", type=Path, help="where the report goes")
    arguments = parser.parse_args()
    output = arguments.output or page_of(arguments.system)
    system = read(arguments.system)
    names = arguments.machine or [machine.name for machine in system.nodes]
    unknown = [name for name in names if system.node(name) is None]
    if unknown:
        known = ", ".join(machine.name for machine in system.nodes)
        print(f"error: no machine {', '.join(unknown)}; there are: {known}", file=sys.stderr)
        return 2
    began = time.monotonic()
    RECORD.parent.mkdir(exist_ok=True)
    if not arguments.resume:
        RECORD.unlink(missing_ok=True)
    trials = [key for name in names for key in _keys(arguments.system, name)]
    results = _read()
    with RECORD.open("ab") as record, multiprocessing.Pool(PROCESSES, _settle_in) as pool:
        for judge, stage in ((_first, "first"), (_second, "second")):
            work = [key for key in trials if _is_open(results.get(key), stage)]
            print(f"{stage} pass: {len(work)} trials, {len(results)} known", flush=True)
            for count, result in enumerate(
                pool.imap_unordered(judge, work, chunksize=4 if judge is _first else 1), start=1
            ):
                record.write(msgspec.json.encode(result) + b"\n")
                record.flush()
                results[_key(result)] = result
                _show(result, stage, count, len(work), time.monotonic() - began)
    ordered = [results[key] for key in trials]
    output.write_text(document(arguments.system, ordered))
    print(summary(ordered))
    print(f"{time.monotonic() - began:.0f} s; written: {output.name}")
    alarms = any(result.found is Found.FALSE_ALARM for result in ordered)
    relevant = [r for r in ordered if r.found in (Found.KILLED, Found.SURVIVED)]
    killed = sum(result.found is Found.KILLED for result in relevant)
    return 1 if alarms or killed < GOAL * len(relevant) else 0


def _read() -> dict[Key, Result]:
    if not RECORD.is_file():
        return {}
    lines = RECORD.read_bytes().splitlines()
    found = [msgspec.json.decode(line, type=Result) for line in lines]
    return {_key(result): result for result in found}


def _key(result: Result) -> Key:
    return result.system, result.machine, result.number


def _keys(system: str, name: str) -> Iterator[Key]:
    """Trial -1 of a machine is the machine as it should be."""
    yield from ((system, name, number) for number in range(-1, len(_mutants(system, name))))


@functools.cache
def _mutants(system: str, name: str) -> list[Mutant]:
    return list(mutants(_machine(system, name)))


def _machine(system: str, name: str) -> Machine:
    machine = read(system).node(name)
    assert machine is not None
    return machine


def _is_open(result: Result | None, stage: str) -> bool:
    if stage == "first" or result is None:
        return result is None
    return result.found is Found.UNDECIDED


def _show(result: Result, stage: str, count: int, total: int, seconds: float) -> None:
    if result.found in (Found.SURVIVED, Found.FALSE_ALARM):
        print(f"{result.found}: {result.description}: {result.reason}", flush=True)
    if not count % 50 or count == total:
        print(f"{stage} pass: {count} of {total}, {seconds:.0f} s", flush=True)


# -- in the processes -----------------------------------------------------------------------------


def _settle_in() -> None:
    os.nice(NICE)
    signal.signal(signal.SIGVTALRM, _give_up)
    logging.disable(logging.CRITICAL)  # mutants complain a lot


def _give_up(number: int, frame: FrameType | None) -> None:
    raise _StuckError


def _first(key: Key) -> Result:
    """A short trial in each scene; who survives is not decided yet."""
    system, name, number = key
    models, program = compiled(system)
    if number < 0:
        description = f"{name} as it should be"
        result = Result(
            system=system, machine=name, number=-1, operator="", description=description
        )
        return _tried_in_all(result, program.nodes[name], FIRST_S, FIRST_SEED)
    machine, mutant = _machine(system, name), _mutants(system, name)[number]
    result = Result(
        system=system,
        machine=name,
        number=number,
        operator=mutant.operator,
        description=_placed(mutant.description),
    )
    reason = _argument(machine, mutant.machine)
    if reason:
        return replace(result, found=Found.EQUIVALENT, reason=reason)
    node = compile_node(mutant.machine, models)
    return _tried_in_all(result, node, FIRST_S, FIRST_SEED)


def _second(key: Key) -> Result:
    """A long trial, for who survived the short one; then it is decided."""
    system, name, number = key
    models, program = compiled(system)
    before = _first_results()[key]
    if number < 0:
        result = _tried_in_all(before, program.nodes[name], LONG_S, LONG_SEED)
        nominal = result.found is Found.UNDECIDED
        return replace(result, found=Found.NOMINAL) if nominal else result
    node = compile_node(_mutants(system, name)[number].machine, models)
    result = _tried_in_all(before, node, LONG_S, LONG_SEED)
    if result.found is not Found.UNDECIDED:
        return result
    if result.reason:
        why = [text for part, text in HOLES.items() if part in result.description]
        return replace(result, found=Found.SURVIVED, reason="; ".join([result.reason, *why]))
    if result.description in BY_HAND:
        return replace(result, found=Found.EQUIVALENT, reason=BY_HAND[result.description])
    return replace(result, found=Found.SURVIVED, reason="never did anything else than the original")


@functools.cache
def _first_results() -> dict[Key, Result]:
    return _read()


def _tried_in_all(result: Result, node: NodeClass, seconds: float, seed: int) -> Result:
    """``result``, decided if a trial in one of the scenes does."""
    system = result.system
    machine = _machine(system, result.machine)
    original = result.number < 0
    difference = result.reason
    # who survived the short trials is most likely to show itself in the last scene
    for scene in SCENES if seconds == FIRST_S else reversed(SCENES):
        found = _tried(system, machine, node, scene, seconds, seed)
        if isinstance(found, str):
            kind = Found.FALSE_ALARM if original else Found.BROKEN
            return replace(result, found=kind, scene=scene, reason=found)
        if found.verdict is not None:
            return replace(
                result,
                found=Found.FALSE_ALARM if original else Found.KILLED,
                scene=scene,
                after_s=found.after_s,
                long=seconds > FIRST_S,
                reason=found.verdict.reason,
            )
        if not original:
            said = _said(system, result.machine, scene, seconds, seed)
            difference = difference or _difference(said, found, scene)
    return replace(result, found=Found.UNDECIDED, reason=difference)


def _argument(machine: Machine, mutant: Machine) -> str:
    """Why ``mutant`` is equivalent; "" if that is not known."""
    found = equivalence(machine, mutant)
    if found:
        return found
    stripped = without_unawaited_responses(mutant)
    if stripped == mutant or not (found := equivalence(machine, stripped)):
        return ""
    return f"{found.rstrip(': ')}: {UNAWAITED}"


def _difference(original: list[Observation], trial: Trial, scene: Scene) -> str:
    """The first thing that a mutant did otherwise than the original in the same world."""
    for expected, seen in zip(original, trial.said, strict=False):
        if expected != seen:
            return f"differs in {scene}: {_told(seen)} instead of {_told(expected)}"
    if len(original) != len(trial.said):
        return f"differs in {scene}: {len(trial.said)} events instead of {len(original)}"
    return ""


@functools.lru_cache(maxsize=8)
def _said(system: str, name: str, scene: Scene, seconds: float, seed: int) -> list[Observation]:
    node = compiled(system)[1].nodes[name]
    found = _tried(system, _machine(system, name), node, scene, seconds, seed)
    return [] if isinstance(found, str) else found.said


def _told(seen: Observation) -> str:
    return f"{seen.kind} on {seen.channel} {seen.data} at {seen.stamp_ns / 1e9 % 1e4:.6f}"


def _tried(
    system: str,
    machine: Machine,
    node: NodeClass,
    scene: Scene,
    seconds: float,
    seed: int,
) -> Trial | str:
    """The trial, or why it could not be held."""
    models, program = compiled(system)
    signal.setitimer(signal.ITIMER_VIRTUAL, STUCK_S)
    try:
        return trial(models, program, machine, node, scene, seconds, seed)
    except _StuckError:
        return f"not at rest after {STUCK_S} s of processor time"
    except Exception as error:  # whatever a mutant's code raises ends its node
        return f"its node ends: {type(error).__name__}: {error}"
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)


def _placed(description: str) -> str:
    """With the file's name only."""
    place, _, what = description.partition(": ")
    return f"{Path(place).name}: {what}"


if __name__ == "__main__":
    sys.exit(main())
