"""Cases for differential tests of the oracle: a random machine, a random trace, and the truth.

For hypothesis: :func:`cases`, :func:`conforming_cases`, :func:`perturbed_cases`. For long loops,
where hypothesis costs more than the test: :func:`case` of a seed.
"""

from __future__ import annotations

from random import Random
from typing import Any

import msgspec
from hypothesis import strategies as st

from m2c.model import Machine
from tests.oracle.changes import perturbed
from tests.oracle.machines import model, read
from tests.oracle.reference import conforms
from tests.oracle.steps import EndlessLoopError, Stepper
from tests.oracle.traces import (
    DEADLINE_NS,
    LATENCY_NS,
    TOLERANCE_NS,
    Trace,
    conforming,
)


class Case(msgspec.Struct, frozen=True):
    """A machine, what was heard of it, and how the trace was made.

    The machine starts at stamp 0. ``made`` is "" for a trace of the machine itself, else what was
    changed; such a trace may conform all the same.
    """

    text: str
    machine: Machine
    trace: Trace
    made: str = ""
    latency_ns: int = LATENCY_NS
    deadline_ns: int = DEADLINE_NS
    tolerance_ns: int = TOLERANCE_NS

    def owes_at_start(self) -> bool:
        """Whether entering the initial state owes outputs, which a tap may come too late to hear."""
        return any(sent for _, sent in Stepper(self.machine).start())

    def conforms(self, **options: Any) -> bool:
        """The reference's verdict."""
        return conforms(
            self.machine,
            self.trace.observations,
            self.latency_ns,
            self.deadline_ns,
            self.trace.end_ns,
            tolerance_ns=self.tolerance_ns,
            **options,
        )

    def __str__(self) -> str:
        lines = [f"made by: {self.made or 'the machine itself'}", self.text]
        for item in self.trace.observations:
            lines.append(
                f"{item.stamp_ns / 1e6:11.4f} ms  {item.source:<8} {item.kind:<18} "
                f"{item.channel:<12} {item.data} {item.error}"
            )
        return "\n".join([*lines, f"{self.trace.end_ns / 1e6:11.4f} ms  judged"])


def case(draw: Random, *, perturb: bool | None = None, text: str | None = None) -> Case:
    """A random case; the same for the same seed of ``draw``.

    Args:
        draw: where all chance comes from.
        perturb: whether something is changed in the trace; None: in two of three.
        text: a model of the family of :func:`tests.oracle.machines.model` to make traces of, as
            reading one costs more than running it.
    """
    text = model(draw) if text is None else text
    machine = read(text)
    if perturb is None:
        perturb = draw.random() < 2 / 3
    if not perturb:
        return Case(text, machine, conforming(machine, draw))
    try:
        trace, made = perturbed(machine, draw)
    except EndlessLoopError:  # of a mutant: it says nothing, for ever
        return Case(text, machine, conforming(machine, draw))
    return Case(text, machine, trace, made)


def machines() -> st.SearchStrategy[Machine]:
    """Random small machines called ``Probe``."""
    return _randoms().map(lambda draw: read(model(draw)))


def cases() -> st.SearchStrategy[Case]:
    """Random machines with conforming and perturbed traces."""
    return _randoms().map(case)


def conforming_cases() -> st.SearchStrategy[Case]:
    """Random machines with traces of their own."""
    return _randoms().map(lambda draw: case(draw, perturb=False))


def perturbed_cases() -> st.SearchStrategy[Case]:
    """Random machines with traces in which something was changed."""
    return _randoms().map(lambda draw: case(draw, perturb=True))


def _randoms() -> st.SearchStrategy[Random]:
    return st.randoms(use_true_random=False)
