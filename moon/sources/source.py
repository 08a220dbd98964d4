"""What a watch is given: where it listens, and who takes its verdicts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import Enum
from typing import Protocol

import msgspec

from moon.verdict import Verdict
from transports.interface import Observation, Tap, Timer


class Source(Protocol):
    """Where what a watch judges comes from: a transport, what stands before one, or a recording."""

    @property
    def repair_s(self) -> float:
        """See ``Listener.repair_s``."""
        ...

    def now_ns(self) -> int:
        """See ``Transport.now_ns``."""
        ...

    def tap(self, channels: Sequence[str], handler: Callable[[Observation], None]) -> Tap:
        """See ``Listener.tap``."""
        ...

    def watch_nodes(self, handler: Callable[[str, bool], None]) -> None:
        """See ``Listener.watch_nodes``."""
        ...

    def up_since(self, name: str) -> int:
        """See ``Listener.up_since``."""
        ...

    def after(self, delay_s: float, handler: Callable[[], None]) -> Timer:
        """See ``Transport.after``."""
        ...

    def post(self, handler: Callable[[], None]) -> None:
        """See ``Transport.post``."""
        ...


class Reach(Enum):
    """To whom a verdict is reported."""

    PEOPLE = 0
    """To everybody."""
    PROGRAMS = 1
    """Not to people: what it says is part of something that they are told once."""
    NOBODY = 2
    """It repeats one that was reported, and is counted."""


class Sink(Protocol):
    """Takes verdicts."""

    def take(self, verdict: Verdict) -> None:
        """Take one."""
        ...


class Outputs(msgspec.Struct, frozen=True):
    """Where what a run finds goes.

    Attributes:
        sinks: each gets every verdict that is new.
        say: called with what a person should know, one sentence each.
        screens: sinks for people, who are told once when all machines are resynchronised, not of each.
        repeated: takes each violation that repeats one of its node (``Verdict.pattern``): sinks do not.
    """

    sinks: Sequence[Sink] = ()
    say: Callable[[str], None] = lambda sentence: None
    screens: Sequence[Sink] = ()
    repeated: Callable[[Verdict], None] = lambda verdict: None
