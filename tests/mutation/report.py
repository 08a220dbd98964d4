"""What the mutation run found, as a page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path

import msgspec

from tests.mutation import OPERATORS
from tests.mutation.trial import SCENES
from tests.systems import LAB_TOUR, SYSTEMS

GOAL = 0.99
"""Of the mutants that are not equivalent, this part should be found."""


ROOT = Path(__file__).parents[2]


class Found(StrEnum):
    """What came of a mutant, or of a machine as it should be."""

    KILLED = "killed"
    EQUIVALENT = "equivalent"
    SURVIVED = "survived"
    BROKEN = "broken"
    """Its own node ended or never came to rest: no monitor is needed to notice."""
    UNDECIDED = "undecided"
    """Not killed by the short trials."""
    NOMINAL = "nominal"
    FALSE_ALARM = "false alarm"


class Result(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What came of one mutant.

    Attributes:
        system: the example.
        machine, number: which of whose mutants; -1 is the machine as it should be.
        operator: that made it.
        description: where and what was changed.
        found: what came of it.
        scene: where it was found.
        after_s: virtual seconds until then.
        long: whether only the long pass found it.
        reason: the verdict's, the equivalence's, or what a survivor did differently.
    """

    system: str
    machine: str
    number: int
    operator: str
    description: str
    found: Found = Found.UNDECIDED
    scene: str = ""
    after_s: float = 0.0
    long: bool = False
    reason: str = ""


def summary(results: Sequence[Result]) -> str:
    """One line."""
    counts = Counter(result.found for result in results)
    killed, survived = counts[Found.KILLED], counts[Found.SURVIVED]
    part = killed / (killed + survived) if killed + survived else 1.0
    return (
        f"{killed} killed, {survived} survived, {counts[Found.EQUIVALENT]} equivalent, "
        f"{counts[Found.BROKEN]} broken by themselves, {counts[Found.FALSE_ALARM]} false alarms; "
        f"{part:.2%} of the non-equivalent killed (goal ≥ {GOAL:.0%})"
    )


def page_of(system: str) -> Path:
    """The page of the example ``system``."""
    name = "mutants" if system == LAB_TOUR else f"mutants-{system.replace('_', '-')}"
    return ROOT / "docs" / f"{name}.md"


def document(system: str, results: Sequence[Result]) -> str:
    """The page of the example ``system``."""
    if system == LAB_TOUR:
        others = [(name, page_of(name).name) for name in SYSTEMS if name != system]
        links = ", ".join(f"[{_called(name)}]({page})" for name, page in others)
        introduction = f"{_INTRODUCTION}\n\nThe same was done with other examples: {links}."
    else:
        introduction = (
            f"# Mutants of {_called(system)}\n\nWritten by `make mutants`; how they are found, and what "
            f"the words mean, is said [of the lab tour's](mutants.md)."
        )
    parts = [introduction, f"**{summary(results)}.**", _by_operator(results), _by_scene(results)]
    parts += [_by_machine(results), _list_of(results)]
    return "\n\n".join(parts) + "\n"


def _called(system: str) -> str:
    return f"the {system.replace('_', ' ')}"


_INTRODUCTION = """# Mutants: what the oracle would miss

Written by `make mutants`. Every first-order mutant of every lab-tour machine (`tests/mutation`) is generated
as code, put in the original's place on the simulated transport, and watched by the oracle of the *original*
model. A mutant is killed when the oracle says *violated*. Compound states are changed as they were written.
Each mutant is tried for one virtual minute in each of three scenes, and who survives that, for ten (the last
scene first):

* the system: the lab tour as it is. Whatever it never does, it cannot show: most of what handles errors,
  refusals and second requests;
* the system, and further callers: nodes that also call the machine's services, send it goals, cancel them, and
  publish to it, alone and at once;
* among moody partners: the machine's node with those callers, and one node in the place of everything it
  calls, that answers rightly, wrongly, late, with an error or never, and rejects, aborts and cancels goals.

The machines as they should be run in the same scenes, as long; an alarm there would be a failure of the run.

A mutant is equivalent if a normal form that keeps everything observable is the original's
(`tests/mutation/equivalence.py`); if all that it does, the original may do, as some outcomes of a draw by
probability never come; if it only adds responses that nobody can be waiting for
(`tests/mutation/waiting.py`); or by an argument written by hand (`tests/mutation/by_hand.py`), which counts
only if the mutant never did anything else than the original did in the same worlds. What a survivor did
otherwise is listed with it."""


def _by_operator(results: Sequence[Result]) -> str:
    rows = [
        "| operator | mutants | killed | equivalent | broken | survived |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    for operator in OPERATORS:
        counts = Counter(item.found for item in results if item.operator == operator)
        rows.append(_row(operator, counts))
    total = Counter(item.found for item in results if item.operator)
    return "\n".join(["## By operator\n", *rows, _row("all", total)])


def _by_machine(results: Sequence[Result]) -> str:
    rows = [
        "| machine | mutants | killed | equivalent | broken | survived | as it should be |",
        "|---|---:|---:|---:|---:|---:|---|",
    ]
    for machine in dict.fromkeys(item.machine for item in results):
        mine = [item for item in results if item.machine == machine]
        counts = Counter(item.found for item in mine if item.operator)
        nominal = next((item for item in mine if not item.operator), None)
        said = "" if nominal is None else " ".join((nominal.found, nominal.reason)).strip()
        said = "no alarm" if said == Found.NOMINAL else said
        rows.append(f"{_row(machine, counts)} {said} |")
    return "\n".join(["## By machine\n", *rows])


def _row(name: str, counts: Counter[Found]) -> str:
    kinds = (Found.KILLED, Found.EQUIVALENT, Found.BROKEN, Found.SURVIVED)
    numbers = " | ".join(str(counts[kind]) for kind in kinds)
    return f"| {name} | {sum(counts[kind] for kind in kinds)} | {numbers} |"


def _by_scene(results: Sequence[Result]) -> str:
    killed = [item for item in results if item.found is Found.KILLED]
    rows = ["| found in | in a minute | in ten |", "|---|---:|---:|"]
    for scene in SCENES:
        here = [item for item in killed if item.scene == scene]
        late = sum(item.long for item in here)
        rows.append(f"| {scene} | {len(here) - late} | {late} |")
    return "\n".join(["## Where they were found\n", *rows])


def _list_of(results: Sequence[Result]) -> str:
    parts = []
    for kind, title in (
        (Found.SURVIVED, "Survivors"),
        (Found.FALSE_ALARM, "False alarms"),
        (Found.EQUIVALENT, "Equivalent"),
        (Found.BROKEN, "Broken by themselves"),
    ):
        lines = [
            f"* {item.description} ({item.operator}): {item.reason}"
            for item in results
            if (item.found is kind and item.operator) or item.found is kind is Found.FALSE_ALARM
        ]
        if lines:
            parts.append("\n".join([f"## {title}\n", *lines]))
    return "\n\n".join(parts) or "No mutant survived."
