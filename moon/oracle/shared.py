"""What the oracles of one monitor share."""

from __future__ import annotations

import msgspec

from moon.feed.nodes import Nodes
from moon.feed.numbers import Numbers
from moon.oracle.confirmation import Losses, Publishers
from moon.oracle.delivery import Clock


class Shared(msgspec.Struct, frozen=True):
    """What is known to all oracles of one monitor.

    Attributes:
        losses: whether observations get lost.
        clock: how far time has passed.
        publishers: who publishes and calls, by the models of all nodes.
        numbers: those of all sources, where whoever feeds the oracles follows them, and says how each does.
        sources: how far all nodes have reported, where whoever feeds the oracles follows that.
    """

    losses: Losses = msgspec.field(default_factory=Losses)
    clock: Clock = msgspec.field(default_factory=Clock)
    publishers: Publishers = msgspec.field(default_factory=Publishers)
    numbers: Numbers | None = None
    sources: Nodes | None = None
