"""The nodes that m2c itself runs, by the transport's timers.

They look whether their time is over when they are ticked, so a run in virtual time repeats itself, and a
skill is only ever halted by the thread that ticks the tree. A timer goes by no clock that can be set: a
``Timeout`` is neither over at once nor an hour late where the time of day is.
"""

from __future__ import annotations

import math

from m2c.policy.controls import Control
from m2c.policy.program import Leaf
from m2c.policy.ticking import Children, Nesting, TreeNode
from m2c.policy.ticks import LeafTick
from transports.interface import Timer, Transport


class ControlLeaf:
    """All places where one such node of the policy stands; see :mod:`m2c.policy.controls`.

    Args:
        leaf: the node.
        transport: whose timers tell the time.
        nesting: of the trees of its children.
    """

    def __init__(self, leaf: Leaf, transport: Transport, nesting: Nesting) -> None:
        self._leaf = leaf
        self._transport = transport
        self._nesting = nesting
        self._places: dict[int, Control] = {}
        self._clocks: dict[int, _TimerClock] = {}

    def tick(self, node: TreeNode, record: LeafTick) -> str:
        """SUCCESS, FAILURE or RUNNING; SKIPPED where its children are."""
        place = self._places.get(id(node))
        if place is None:
            leaf = self._leaf
            children = Children(self._nesting, leaf.id, leaf.children, node)
            clock = self._clocks[id(node)] = _TimerClock(self._transport)
            place = self._places[id(node)] = Control(leaf, node, children, clock)
        clock = self._clocks[id(node)]
        clock.was_over = False
        try:
            return place.tick()
        finally:
            record.elapsed = clock.was_over

    def halt(self, node: TreeNode, record: LeafTick) -> None:
        """Stop what is RUNNING."""
        place = self._places.get(id(node))
        if place is not None:
            place.halt()


class _TimerClock:
    """A time that passes by a timer of ``transport``; ``was_over``: what it said when it was asked."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport
        self._waiting: _Waiting | None = None
        self.was_over = False

    def start(self, delay_s: float) -> None:
        self.stop()
        self._waiting = _Waiting(self._transport, delay_s)

    def is_over(self) -> bool:
        self.was_over = self._waiting is not None and self._waiting.is_over
        return self.was_over

    def stop(self) -> None:
        if self._waiting is not None:
            self._waiting.end()
            self._waiting = None


class _Waiting:
    """A time that passes, from now on: ``is_over`` once ``delay_s`` have."""

    def __init__(self, transport: Transport, delay_s: float) -> None:
        self.is_over = delay_s <= 0
        self._timer: Timer | None = None
        self._ended = self.is_over or delay_s == math.inf
        if not self._ended:
            transport.post(lambda: self._begin(transport, delay_s))
        self._post = transport.post

    def _begin(self, transport: Transport, delay_s: float) -> None:
        if not self._ended:
            self._timer = transport.after(delay_s, self._elapsed)

    def _elapsed(self) -> None:
        self.is_over = True

    def end(self) -> None:
        """Nobody waits any more."""
        self._ended = True
        self._post(self._cancel)

    def _cancel(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
