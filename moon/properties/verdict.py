"""What a monitor says of a property, and why."""

from __future__ import annotations

from enum import StrEnum

import msgspec

from transports.interface import Observation


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
