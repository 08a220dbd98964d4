"""``Sleep``, ``Delay`` and ``Timeout`` by the transport's timers.

They look whether their time is over when they are ticked, so a run in virtual time repeats itself, and a
skill is only ever halted by the thread that ticks the tree. A timer goes by no clock that can be set: a
``Timeout`` is neither over at once nor an hour late where the time of day is.
"""

from __future__ import annotations

from m2c.policy.library import TreeFactory
from m2c.policy.program import Leaf
from m2c.policy.ticking import Children, TreeNode, read_port
from m2c.policy.ticks import LeafTick
from transports.interface import Timer, Transport


class TimedLeaf:
    """All places where one ``Sleep``, ``Delay`` or ``Timeout`` of the policy stands.

    ``Sleep`` is RUNNING until its time has passed and succeeds then; ``Delay`` ticks its child from
    then on; ``Timeout`` halts its child then, and fails.
    """

    def __init__(self, leaf: Leaf, transport: Transport, factory: TreeFactory) -> None:
        self._leaf = leaf
        self._transport = transport
        self._factory = factory
        self._places: dict[int, _Place] = {}

    def tick(self, node: TreeNode, record: LeafTick) -> str:
        """SUCCESS, FAILURE or RUNNING; SKIPPED where its child is."""
        place = self._places.get(id(node))
        if place is None:
            children = Children(self._factory, self._leaf.id, self._leaf.children, node)
            place = self._places[id(node)] = _Place(node, children)
        if place.waiting is None:
            waits_ms = int(read_port(self._leaf.inputs[0], node))
            place.waiting = _Waiting(self._transport, waits_ms / 1e3)
        record.elapsed = place.waiting.is_over
        status = self._status(place, record.elapsed)
        if status != "RUNNING":
            place.end()
        return status

    def _status(self, place: _Place, elapsed: bool) -> str:
        match self._leaf.timed:
            case "Sleep":
                return "SUCCESS" if elapsed else "RUNNING"
            case "Delay":
                return place.children.tick(0) if elapsed else "RUNNING"
            case _:
                return "FAILURE" if elapsed else place.children.tick(0)

    def halt(self, node: TreeNode, record: LeafTick) -> None:
        """Stop what is RUNNING."""
        place = self._places.get(id(node))
        if place is not None:
            place.end()


class _Waiting:
    """A time that passes, from now on: ``is_over`` once ``delay_s`` have."""

    def __init__(self, transport: Transport, delay_s: float) -> None:
        self.is_over = delay_s <= 0
        self._timer: Timer | None = None
        self._ended = self.is_over
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


class _Place:
    """One node of the tree; ``waiting`` is None while it is not running."""

    def __init__(self, node: TreeNode, children: Children) -> None:
        self.node = node  # kept, so that no other node gets its id()
        self.children = children
        self.waiting: _Waiting | None = None

    def end(self) -> None:
        """Its next tick starts anew."""
        if self.waiting is not None:
            self.waiting.end()
            self.waiting = None
        self.children.halt_all()
