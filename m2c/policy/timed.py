"""``Sleep``, ``Delay`` and ``Timeout`` by the transport's clock.

They look at the clock when they are ticked, so a run in virtual time repeats itself, and a skill is
only ever halted by the thread that ticks the tree.
"""

from __future__ import annotations

from typing import Any

from m2c.policy.program import Leaf
from m2c.policy.ticking import Children, TreeNode, read_port
from transports.interface import Transport

_NS_PER_MS = 1_000_000


class TimedLeaf:
    """All places where one ``Sleep``, ``Delay`` or ``Timeout`` of the policy stands.

    ``Sleep`` is RUNNING until its time has passed and succeeds then; ``Delay`` ticks its child from
    then on; ``Timeout`` halts its child then, and fails.
    """

    def __init__(self, leaf: Leaf, transport: Transport, factory: Any) -> None:
        self._leaf = leaf
        self._transport = transport
        self._factory = factory
        self._places: dict[int, _Place] = {}

    def tick(self, node: TreeNode) -> str:
        """SUCCESS, FAILURE or RUNNING."""
        place = self._places.get(id(node))
        if place is None:
            children = Children(self._factory, self._leaf.id, self._leaf.children, node)
            place = self._places[id(node)] = _Place(node, children)
        now_ns = self._transport.now_ns()
        if place.due_ns is None:
            waits_ms = int(read_port(self._leaf.inputs[0], node))
            place.due_ns = now_ns + waits_ms * _NS_PER_MS
        status = self._status(place, now_ns >= place.due_ns)
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

    def halt(self, node: TreeNode) -> None:
        """Stop what is RUNNING."""
        place = self._places.get(id(node))
        if place is not None:
            place.end()


class _Place:
    """One node of the tree; ``due_ns`` is None while it is not running."""

    def __init__(self, node: TreeNode, children: Children) -> None:
        self.node = node  # kept, so that no other node gets its id()
        self.children = children
        self.due_ns: int | None = None

    def end(self) -> None:
        """Its next tick starts anew."""
        self.due_ns = None
        self.children.halt_all()
