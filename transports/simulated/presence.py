"""Who is there, as each node of a simulated world sees it."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Protocol

from transports.contested import Contested
from transports.interface import HERE
from transports.simulated.conditions import Cut, Rules
from transports.simulated.parts import Node, World

Watcher = Callable[[str, bool], None]


class View:
    """The nodes that are up, to one of them.

    A node that was killed and started again is there twice until the first is missed.

    Args:
        of: whose view it is.
    """

    def __init__(self, of: Node) -> None:
        self._of = of
        self._there: dict[str, list[Node]] = {}
        self._since: dict[str, int] = {}
        self.contested = Contested(lambda: of.world.now_ns)
        self._watchers: list[Watcher] = []

    def watch(self, handler: Watcher) -> None:
        """``handler(name, up)`` as work of the node, at once for those who are up."""
        self._watchers.append(handler)
        for name in self._there:
            self._of.post(functools.partial(handler, name, True))

    def names(self) -> list[str]:
        """Who is up."""
        return list(self._there)

    def up_since(self, name: str) -> int:
        """When ``name`` began to connect, on its clock (ns); 0: it is not up, or was there twice."""
        return self._since.get(name, 0)

    def clock_of(self, name: str) -> str:
        """See ``TellsClocks.clock_of``."""
        conditions = self._of.world.conditions
        if name and not self._since.get(name):
            return ""
        host = conditions.host_of(name or self._of.node)
        return HERE if host == conditions.host_of(self._of.node) else f"host {host}"

    def appear(self, other: Node) -> None:
        """``other`` is found."""
        there = self._there.setdefault(other.node, [])
        if not self._of.alive or other in there:
            return
        there.append(other)
        if len(there) > 1:  # which of them something comes from is not known
            self._since[other.node] = 0
            self.contested.begin(other.node)
            return
        self._since[other.node] = other.since_ns
        self._report(other.node, True)

    def disappear(self, other: Node) -> None:
        """``other`` is missed."""
        there = self._there.get(other.node, [])
        if other not in there:
            return
        there.remove(other)
        if there:
            self.contested.end(other.node)
            return
        del self._there[other.node], self._since[other.node]
        self._report(other.node, False)

    def _report(self, name: str, up: bool) -> None:
        for handler in self._watchers:
            self._of.post(functools.partial(handler, name, up))


class Viewer(Node, Protocol):
    """A node with a view of the others."""

    view: View


class Presence:
    """What all nodes of a world learn of each other: after a while, and not across a cut."""

    def __init__(self, world: World, nodes: Mapping[str, Viewer]) -> None:
        self._world = world
        self._nodes = nodes
        self._network = world.network
        for cut, from_ns, until_ns in self._network.long_cuts():
            world.schedule(from_ns - world.now_ns, self._part, cut)
            world.schedule(until_ns - world.now_ns, self._join, cut)

    def connected(self, node: Viewer) -> None:
        """``node`` is new: it finds those who are up."""
        for other in self._nodes.values():
            if other.is_announced:
                self._find(node, other)

    def announced(self, node: Viewer) -> None:
        """``node`` is up: the others find it."""
        for viewer in tuple(self._nodes.values()):
            self._find(viewer, node)

    def left(self, node: Viewer, killed: bool) -> None:
        """``node`` has gone; where ``killed``, without a word."""
        is_missed_late = killed and self._world.conditions.rules is Rules.ROS2
        lease_ns = round(self._world.conditions.lease_s * 1e9) if is_missed_late else 0
        for viewer in tuple(self._nodes.values()):
            self._later(lease_ns, viewer.view.disappear, node)

    def _find(self, viewer: Viewer, other: Viewer) -> None:
        world, network = self._world, self._network
        now_ns = world.now_ns
        found_ns = now_ns
        if not network.finds_at_once and viewer is not other:
            found_ns += network.discovery_ns()
        found_ns = network.healed_ns(viewer.node, other.node, found_ns)
        self._later(found_ns - now_ns, functools.partial(_appear, viewer), other)

    def _later(
        self,
        delay_ns: int,
        event: Callable[[Viewer], None],
        node: Viewer,
    ) -> None:
        if delay_ns:
            self._world.schedule(delay_ns, event, node)
        else:
            event(node)

    # --- cuts --------------------------------------------------------------------------------------

    def _part(self, cut: Cut) -> None:
        for viewer, other in self._across(cut):
            viewer.view.disappear(other)

    def _join(self, cut: Cut) -> None:
        for viewer, other in self._across(cut):
            if other.is_announced:
                self._find(viewer, other)

    def _across(self, cut: Cut) -> list[tuple[Viewer, Viewer]]:
        nodes = tuple(self._nodes.values())
        return [
            (one, other)
            for one in nodes
            for other in nodes
            if self._network.separates(cut, one.node, other.node)
        ]


def _appear(viewer: Viewer, other: Node) -> None:
    if other.alive:
        viewer.view.appear(other)
