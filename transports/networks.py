"""Nodes for the conformance suite: real ones, on threads."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol

from transports.interface import Connection

PATIENCE_S = 20.0
"""How long a check waits for what must happen; only a failing check waits that long."""


class Network(Protocol):
    """Some nodes that can reach one another, and a way to let things happen."""

    def node(self, name: str) -> Connection:
        """A node whose executor runs."""
        ...

    def until(self, condition: Callable[[], object]) -> bool:
        """Let things happen until ``condition()`` holds; False if it does not in PATIENCE_S."""
        ...

    def caller(self, work: Callable[[], Any]) -> Callable[[], Any]:
        """Run ``work`` on a thread that may wait; what is returned waits for its value."""
        ...

    def close(self) -> None:
        """Close all nodes."""
        ...


class ThreadedNetwork:
    """Nodes of a real transport in this process, each with a thread that spins.

    Args:
        connect: ``connect(name, others)``: a node called ``name``; ``others`` are those that are
            there already (the first to come may have to listen).
    """

    def __init__(self, connect: Callable[[str, Sequence[Connection]], Connection]) -> None:
        self._connect = connect
        self._nodes: list[Connection] = []
        self._threads: list[threading.Thread] = []

    def node(self, name: str) -> Connection:
        """A node that spins on a thread of its own."""
        transport = self._connect(name, self._nodes)
        thread = threading.Thread(target=transport.spin, name=name)
        thread.start()
        self._nodes.append(transport)
        self._threads.append(thread)
        return transport

    def until(self, condition: Callable[[], object]) -> bool:
        """Wait, looking every few milliseconds."""
        deadline = time.monotonic() + PATIENCE_S
        pause = threading.Event()
        while not condition():
            if time.monotonic() > deadline:
                return False
            pause.wait(0.002)
        return True

    def caller(self, work: Callable[[], Any]) -> Callable[[], Any]:
        """A thread of its own."""
        found: list[Any] = []
        thread = threading.Thread(target=lambda: found.append(work()))
        thread.start()

        def value() -> Any:
            thread.join(PATIENCE_S)
            assert found, "the caller did not end, or raised an error"
            return found[0]

        return value

    def close(self) -> None:
        """Close all nodes, the last to come first; every spin must end."""
        _end(self._nodes, self._threads)


def _end(nodes: Sequence[Connection], threads: Sequence[threading.Thread]) -> None:
    for node in reversed(nodes):
        node.close()
    for thread in threads:
        thread.join(PATIENCE_S)
        assert not thread.is_alive(), f"{thread.name} still spins after close()"


@contextlib.contextmanager
def spinning(*nodes: Connection) -> Iterator[None]:
    """Each of ``nodes`` spins on a thread of its own; at the end they are closed, the last of them first."""
    threads = [threading.Thread(target=node.spin, name=node.node) for node in nodes]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        _end(nodes, threads)
