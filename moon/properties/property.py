"""Properties and verdicts: what must hold, over which observed values, and what a monitor says of it."""

from __future__ import annotations

from enum import StrEnum
from typing import Any

import msgspec

from m2c.diagnostics import Position
from m2c.language.expressions import Expression
from moon.properties.formula import Formula
from moon.properties.patterns import Pattern
from transports.interface import Observation, ObservationKind


class PropertySeverity(StrEnum):
    """How bad a violation is, for the operator."""

    CRITICAL = "critical"
    ERROR = "error"
    WARNING = "warning"
    INFO = "info"


class Role(StrEnum):
    """Whether the system owes the property, or its environment does."""

    GUARANTEE = "guarantee"
    ASSUMPTION = "assumption"


class Port(msgspec.Struct, frozen=True):
    """A name that predicates use, and the observations that give it its value.

    Attributes:
        name: how predicates call it.
        channel: the topic or service; ``*`` for any (its field then selects the observations).
        kinds: which observations count. Where both ends of a call are observed, only the first kind
            that was ever observed on the channel counts, so that a call counts once.
        path: the fields that lead to the value; empty for the whole message.
        event: true while it happens (one tick), false otherwise; else the last value, kept.
        condition: of an event: which messages count (over the variable ``data``).
        initial: of a state: the value before the first observation; UNSET: unknown until then.
        position: where it is declared.
    """

    name: str
    channel: str
    kinds: tuple[ObservationKind, ...] = (ObservationKind.MESSAGE,)
    path: tuple[str, ...] = ()
    event: bool = False
    condition: Expression | None = None
    initial: Any = msgspec.UNSET
    position: Position = Position("")


class Property(msgspec.Struct, frozen=True):
    """One property of a file (or of the API).

    Attributes:
        name: its id.
        formula: what must hold at every instant of time (a pattern's formula or a free one).
        ports: the names its predicates use.
        text: what to tell the operator; may be empty.
        severity: how bad a violation is.
        role: guarantee or assumption.
        meaning: the property in one English sentence.
        deadline_ticks: the time after which an open obligation counts as broken; None: there is none.
        position: where it is written.
        pattern: what the formula is of, if it is a pattern's.
    """

    name: str
    formula: Formula
    ports: tuple[Port, ...] = ()
    text: str = ""
    severity: PropertySeverity = PropertySeverity.ERROR
    role: Role = Role.GUARANTEE
    meaning: str = ""
    deadline_ticks: int | None = None
    position: Position = Position("")
    pattern: Pattern | None = None


class Status(StrEnum):
    """The three verdicts."""

    TRUE = "true so far"
    FALSE = "false"
    INCONCLUSIVE = "inconclusive"


class Fact(msgspec.Struct, frozen=True):
    """A predicate's value over some time, and the observation that gave it.

    Attributes:
        predicate: its text.
        value: what it was.
        start_ns: first instant.
        end_ns: last instant (included).
        observation: what set the value; None if it held from the start or by lapse of time.
    """

    predicate: str
    value: bool
    start_ns: int
    end_ns: int
    observation: Observation | None = None


class Witness(msgspec.Struct, frozen=True):
    """Why a property is false: whatever else had been observed, with these facts it would be.

    Attributes:
        at_ns: the instant at which the property became false.
        facts: what made it so, in order of time.
        complete: False if some of it is no longer remembered (only the latest changes are).
    """

    at_ns: int
    facts: tuple[Fact, ...]
    complete: bool = True


class Verdict(msgspec.Struct, frozen=True):
    """A property's verdict.

    Attributes:
        status: true so far, false or inconclusive.
        since_ns: since when; -1 before the first observation.
        final: no further observation can change it; what can is a loss that had begun by then, and is
            reported only now.
        witness: why it is false.
        reason: why it is inconclusive.
    """

    status: Status
    since_ns: int = -1
    final: bool = False
    witness: Witness | None = None
    reason: str = ""
