"""What a policy publishes of each tick of its tree."""

from __future__ import annotations

from typing import ClassVar

import msgspec

from m2c.runtime.messages import TypedMessage, structure_of
from transports.interface import Topic

TICKS_CHANNEL = "/policy/ticks"


class PortOutput(TypedMessage):
    """A value that a plugin wrote to the blackboard: its port, and the value as text."""

    __type_name__: ClassVar[str] = "m2c/msg/PortOutput"
    key: str = ""
    value: str = ""


class LeafTick(TypedMessage):
    """One leaf in one tick of the tree: its status, and how long its skill took to answer (µs).

    What no call shows is said, too: whether the time of a ``Sleep``, ``Delay`` or ``Timeout`` was over
    (``elapsed``), and what a plugin wrote (``outputs``, in order).
    """

    __type_name__: ClassVar[str] = "m2c/msg/LeafTick"
    name: str = ""
    status: str = ""
    duration_us: float = 0.0
    elapsed: bool = False
    outputs: list[PortOutput] = msgspec.field(default_factory=list)


class TreeTick(TypedMessage):
    """One tick of the tree; ``leaves`` are those that were ticked, in order."""

    __type_name__: ClassVar[str] = "m2c/msg/TreeTick"
    tick: int = 0
    status: str = ""
    leaves: list[LeafTick] = msgspec.field(default_factory=list)


TICK_TYPE = structure_of(TreeTick)
"""The type of these messages; no interface package defines it."""
TICKS = Topic(TICKS_CHANNEL, TreeTick.__type_name__, TreeTick)

HALTED = "HALTED"
"""The status of a leaf that the tree halted."""
