"""Nodes for the conformance suite that are beside one another, or simulated."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any

from transports.interface import Connection
from transports.networks import PATIENCE_S, ThreadedNetwork, spinning
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld


@contextlib.contextmanager
def nodes_beside(
    owner: Connection, connect: Callable[[str], Connection] | None = None
) -> Iterator[ThreadedNetwork]:
    """A network whose nodes are all beside ``owner``, which is none of them and ends last.

    Args:
        owner: does not spin yet.
        connect: how a node is connected, if not by ``owner.beside``.
    """
    network = ThreadedNetwork(lambda name, _: (connect or owner.beside)(name))
    with spinning(owner), contextlib.closing(network):
        yield network


class SimulatedNetwork:
    """Nodes in a simulated world."""

    def __init__(self, seed: int = 0, conditions: Conditions | None = None) -> None:
        self.world = SimulatedWorld(seed, conditions)

    def node(self, name: str) -> SimulatedTransport:
        """A node in the world."""
        return SimulatedTransport(self.world, name)

    def until(self, condition: Callable[[], object]) -> bool:
        """Let the world's events happen."""
        return self.world.run_until(condition, PATIENCE_S)

    def caller(self, work: Callable[[], Any]) -> Callable[[], Any]:
        """A caller on the world's time."""
        found: list[Any] = []
        self.world.spawn(lambda: found.append(work()), "caller")

        def value() -> Any:
            assert self.until(lambda: bool(found)), "the caller did not end"
            return found[0]

        return value

    def close(self) -> None:
        """Close all nodes."""
        self.world.close()
