"""A property: what must hold, over which observed values, and what to say when it does not."""

from __future__ import annotations

from enum import StrEnum
from typing import Any

import msgspec

from m2c.model.diagnostics import Position
from m2c.model.expressions import Expression
from moon.properties.formula import Formula
from moon.properties.patterns import Pattern
from transports.interface import ObservationKind


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


REQUESTS = (ObservationKind.REQUEST_RECEIVED, ObservationKind.REQUEST_SENT)
RESPONSES = (ObservationKind.RESPONSE_SENT, ObservationKind.RESPONSE_RECEIVED)


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
