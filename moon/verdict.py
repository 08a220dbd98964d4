"""Verdicts: what a monitor says, and why."""

from __future__ import annotations

from enum import StrEnum

import msgspec


class Outcome(StrEnum):
    """What is known about a monitored machine or property."""

    CONFORMING = "conforming"
    """Everything observed agrees."""
    VIOLATED = "violated"
    """What was observed cannot be."""
    INCONCLUSIVE = "inconclusive"
    """Something is missing: started in the middle, observations lost, too many possibilities."""


class Cause(StrEnum):
    """What is wrong, or missing: what programs decide by, where ``reason`` is for people."""

    UNEXPECTED = "unexpected"
    """It did something else than what was expected."""
    UNRESPONSIVE = "unresponsive"
    """What was expected did not come in time."""
    NOT_TAKEN = "not taken"
    """It never took what was sent to it."""
    UNDECLARED = "undeclared"
    """It sent something on a channel that its model does not name."""
    MISSING_OBSERVATION = "missing observation"
    """It is *violated*, unless an observation is missing that explains it."""


MIDDLE = "started in the middle of a run: waiting until its state is certain"
"""Why what was found in the middle of a run is inconclusive, for people."""

_SILENT = (Cause.UNRESPONSIVE, Cause.NOT_TAKEN)


class Difference(msgspec.Struct, frozen=True):
    """The first field in which what was observed differs from what was expected.

    Attributes:
        path: of the field, as ``header.stamp.sec`` or ``ranges[3]``.
        expected: its value, for people; a range where the model draws it.
        observed: its value, for people.
    """

    path: str
    expected: str
    observed: str


class Evidence(msgspec.Struct, frozen=True):
    """One observation that led to a verdict.

    Attributes:
        stamp_ns: when it happened, ns since the epoch.
        text: what it was.
    """

    stamp_ns: int
    text: str


class Explanation(msgspec.Struct, frozen=True, omit_defaults=True):
    """Why a machine is in violation, for who has to repair it.

    Attributes:
        expected: what the model would have had it do (each possibility).
        observed: what it did.
        states: state and data before, for each possibility.
        evidence: what led there, oldest first.
        places: ``file:line:column`` of the transitions that owed the output.
        channel: on which it did that, or did not.
        differences: where messages differ: the first field, for each possibility.
    """

    expected: tuple[str, ...]
    observed: str
    states: tuple[str, ...] = ()
    evidence: tuple[Evidence, ...] = ()
    places: tuple[str, ...] = ()
    channel: str = ""
    differences: tuple[Difference, ...] = ()


class Verdict(msgspec.Struct, frozen=True, omit_defaults=True):
    """What the oracle says after an observation, or after some time without one.

    Attributes:
        machine: the model's name.
        node: the node that runs it.
        outcome: what is known.
        stamp_ns: of the observation, or of the moment at which something was due.
        reason: one sentence; "" while all is well.
        explanation: for violations.
        kind: ``model``, or ``property`` for what is no machine: then ``machine`` and ``node`` are its name.
        robot: in a fleet, the namespace of the robot; else "".
        cause: of a violation of a model, or of one that is not certain yet.
    """

    machine: str
    node: str
    outcome: Outcome
    stamp_ns: int
    reason: str = ""
    explanation: Explanation | None = None
    kind: str = "model"
    robot: str = ""
    cause: Cause | None = None

    @classmethod
    def of(
        cls,
        name: str,
        outcome: Outcome,
        stamp_ns: int,
        reason: str = "",
        explanation: Explanation | None = None,
    ) -> Verdict:
        """The verdict on what is no machine: on a property, or whatever else a judge judges.

        Args:
            name: of what is judged.
            outcome: what is known.
            stamp_ns: since when, ns since the epoch.
            reason: one sentence; empty while all is well.
            explanation: for violations.
        """
        return cls(name, name, outcome, stamp_ns, reason, explanation, kind="property")

    @property
    def is_silence(self) -> bool:
        """Whether it is that something did not happen."""
        return self.cause in _SILENT

    @property
    def pattern(self) -> Pattern:
        """What two verdicts share that repeat one another, whatever the values in them."""
        why = self.explanation
        if why is None:
            return (self.machine, self.node, self.cause, "", (), ())
        paths = tuple(sorted({difference.path for difference in why.differences}))
        return (self.machine, self.node, self.cause, why.channel, why.places, paths)


Pattern = tuple[str, str, Cause | None, str, tuple[str, ...], tuple[str, ...]]
"""Machine, node, cause, channel, places in the model and paths of differing fields of a verdict."""


def violation_of(
    machine: str, node: str, stamp_ns: int, explanation: Explanation, cause: Cause
) -> Verdict:
    """The verdict on a machine that did not do what ``explanation`` says it should have done.

    Args:
        machine: the model's name.
        node: the node that runs it.
        stamp_ns: when (ns since the epoch).
        explanation: why.
        cause: what is wrong.
    """
    expected = " or ".join(explanation.expected) or "nothing"
    silent = "unresponsive: " if cause in _SILENT else ""
    reason = f"{silent}expected {expected}, observed {explanation.observed}"
    return Verdict(machine, node, Outcome.VIOLATED, stamp_ns, reason, explanation, cause=cause)
