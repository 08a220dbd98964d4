"""One monitor of a system whose nodes are on several transports, with bridges between them.

A call that crosses a bridge is observed on both sides, as two calls: the caller's to the bridge, and the
bridge's to the server. Neither is a copy of the other: each side is a whole system in which the bridge
is one more node. So every machine is judged on the side where its node is, by a ``Run`` of its
own, with what is received there; nothing is counted twice, and no client or number of a call need be
translated. All watches run on one thread, that of the first transport, and share their sinks.

Properties are about the whole system. They are judged by one more watch that listens on all sides
(``AllSides``) and leaves out what bridges send: what is left is what the nodes themselves did, once.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial

from moon.feed.clock import clock_nobody_sets
from transports.interface import Answer, BlindSpot, Closes, Connection, Observation, Tap, Timer

NodeHandler = Callable[[str, bool], None]


class Side:
    """What is received on one transport, on the thread of another.

    Args:
        there: listened to; somebody must spin it.
        home: whose executor and clock are used.
    """

    def __init__(self, there: Connection, home: Connection) -> None:
        self._there = there
        self._home = home
        self._steady_ns = clock_nobody_sets(home)

    @property
    def repair_s(self) -> float:
        """Of the transport that is listened to."""
        return self._there.repair_s

    def now_ns(self) -> int:
        """The clock of the home transport."""
        return self._home.now_ns()

    def steady_ns(self) -> int:
        """That of the home transport which nobody sets (``transports.interface.VirtualTime``)."""
        return self._steady_ns()

    def tap(self, channels: Sequence[str], handler: Callable[[Observation], None]) -> Tap:
        """A tap on this side."""
        if self._there is self._home:
            return self._there.tap(channels, handler)
        tap = self._there.tap(channels, lambda seen: self._home.post(partial(handler, seen)))
        return _Taps([tap], self.post)

    def watch_nodes(self, handler: NodeHandler) -> None:
        """Nodes of this side."""
        if self._there is self._home:
            self._there.watch_nodes(handler)
        else:
            self._there.watch_nodes(lambda name, up: self._home.post(partial(handler, name, up)))

    def up_since(self, name: str) -> int:
        """When a node of this side began to connect."""
        return self._there.up_since(name)

    def after(self, delay_s: float, handler: Callable[[], None]) -> Timer:
        """A timer of the home transport."""
        return self._home.after(delay_s, handler)

    def post(self, handler: Callable[[], None]) -> None:
        """Run ``handler`` on the home transport's executor."""
        self._home.post(handler)


class AllSides:
    """What the nodes of all sides do, each thing once.

    Args:
        sides: all of them; the first is whose clock and timers are used.
        bridges: the names of the nodes that hand on from side to side.
    """

    def __init__(self, sides: Sequence[Side], bridges: Collection[str]) -> None:
        self._sides = tuple(sides)
        self._bridges = frozenset(bridges)

    @property
    def repair_s(self) -> float:
        """The longest of all sides."""
        return max(side.repair_s for side in self._sides)

    def now_ns(self) -> int:
        """The clock of the home transport."""
        return self._sides[0].now_ns()

    def steady_ns(self) -> int:
        """That of the home transport which nobody sets (``transports.interface.VirtualTime``)."""
        return self._sides[0].steady_ns()

    def tap(self, channels: Sequence[str], handler: Callable[[Observation], None]) -> Tap:
        """A tap on every side."""

        def receive(seen: Observation) -> None:
            if seen.source not in self._bridges:
                handler(seen)

        return _Taps([side.tap(channels, receive) for side in self._sides], self.post)

    def watch_nodes(self, handler: NodeHandler) -> None:
        """Nodes of all sides; bridges are not of the system."""

        def changed(name: str, up: bool) -> None:
            if name not in self._bridges:
                handler(name, up)

        for side in self._sides:
            side.watch_nodes(changed)

    def up_since(self, name: str) -> int:
        """When a node began to connect, on whichever side it is."""
        return max(side.up_since(name) for side in self._sides)

    def after(self, delay_s: float, handler: Callable[[], None]) -> Timer:
        """A timer of the home transport."""
        return self._sides[0].after(delay_s, handler)

    def post(self, handler: Callable[[], None]) -> None:
        """Run ``handler`` on the home transport's executor."""
        self._sides[0].post(handler)


class _Taps(Closes):
    """The taps on all sides as one; ``post`` hands on to the home transport's executor."""

    def __init__(self, taps: Sequence[Tap], post: Callable[[Callable[[], None]], None]) -> None:
        self._taps = tuple(taps)
        self._post = post

    def ask(
        self, node: str, answered: Callable[[Answer | None], None], within_s: float = 1.0
    ) -> None:
        open_taps = [len(self._taps)]

        def take(answer: Answer | None) -> None:
            open_taps[0] -= 1
            if open_taps[0] >= 0 and (answer is not None or not open_taps[0]):
                open_taps[0] = 0
                answered(answer)

        for tap in self._taps:
            tap.ask(node, lambda answer: self._post(partial(take, answer)), within_s)

    @property
    def is_complete(self) -> bool:
        return all(tap.is_complete for tap in self._taps)

    def is_contested(self, name: str) -> bool:
        return any(tap.is_contested(name) for tap in self._taps)

    def take_dropped(self) -> Collection[tuple[str, str]]:
        return [place for tap in self._taps for place in tap.take_dropped()]

    def blind_spots(self) -> Mapping[BlindSpot, str]:
        return {spot: why for tap in self._taps for spot, why in tap.blind_spots().items()}

    def peers(self) -> Sequence[str]:
        return sorted({peer for tap in self._taps for peer in tap.peers()})

    def problems(self) -> Sequence[str]:
        return [problem for tap in self._taps for problem in tap.problems()]

    def close(self) -> None:
        for tap in self._taps:
            tap.close()
