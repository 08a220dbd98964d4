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
    """

    expected: tuple[str, ...]
    observed: str
    states: tuple[str, ...] = ()
    evidence: tuple[Evidence, ...] = ()
    places: tuple[str, ...] = ()


class Verdict(msgspec.Struct, frozen=True, omit_defaults=True):
    """What the oracle says after an observation, or after some time without one.

    Attributes:
        machine: the model's name.
        node: the node that runs it.
        outcome: what is known.
        stamp_ns: of the observation, or of the moment at which something was due.
        reason: one sentence; "" while all is well.
        explanation: for violations.
        kind: ``model``, or ``property``: then ``machine`` and ``node`` are its id.
        robot: in a fleet, the namespace of the robot; else "".
    """

    machine: str
    node: str
    outcome: Outcome
    stamp_ns: int
    reason: str = ""
    explanation: Explanation | None = None
    kind: str = "model"
    robot: str = ""
