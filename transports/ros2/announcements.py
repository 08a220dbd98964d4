"""One node's own announcement, and who is up to it.

Another node counts as up once it is there (``transports.ros2.roster``), has said that it is ready, and its
taps have found what this one has declared.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from functools import partial
from typing import Any

import msgspec
from rclpy.event_handler import PublisherEventCallbacks
from std_msgs.msg import String

from transports import host
from transports.channel_filter import matches
from transports.ros2 import endpoints, native
from transports.ros2.executor import LOG, Executor
from transports.ros2.graph import Graph
from transports.ros2.presence import (
    MOST_ENDPOINTS,
    TOPIC,
    Presence,
    encode,
    entity_of,
    profile,
)
from transports.ros2.roster import Announced, Roster
from transports.service_events import EVENT_SUFFIX


class _Awaited(msgspec.Struct, frozen=True, eq=False):
    """Who waits for the taps of the node ``by``, and until it has found ``nodes``."""

    by: str
    nodes: frozenset[str]
    handler: Callable[[], None]


class Announcements:
    """What one node says of itself, and learns of the others.

    Args:
        node: an ``rclpy.node.Node``.
        executor: its own; who watches is called there.
        graph, roster: of its context.
        prefix: put before every channel.
    """

    def __init__(
        self, node: Any, executor: Executor, graph: Graph, roster: Roster, prefix: str
    ) -> None:
        self._node = node
        self._executor = executor
        self._graph = graph
        self._roster = roster
        self._topic = prefix + TOPIC
        self._up: dict[bytes, str] = {}
        self._changed = threading.Condition()
        self._watchers: list[Callable[[str, bool], None]] = []
        self._awaited: list[_Awaited] = []
        """Whose taps this node waits for."""
        self._publisher: Any = None
        self._closed = False
        self.own = Presence(node.get_name(), time.time_ns(), is_ready=False, host=host.ID)
        graph.listen(self._look)

    def announce(self) -> None:
        """Say that this node is ready, and what it has declared."""
        self.own.is_ready = True
        self.say()

    def say(self) -> None:
        """Say what this node has declared; saying it again reports what has changed."""
        if self._publisher is None:
            self._publisher = self._node.create_publisher(
                String,
                self._topic,
                profile(1),
                event_callbacks=PublisherEventCallbacks(use_default_callbacks=False),
            )
        participant = native.participant_of(native.gid_of_publisher(self._publisher.handle))
        own = endpoints.of_node(self._node, participant)
        self.own.endpoints = [entity_of(gid) for gid in own[:MOST_ENDPOINTS]]
        self._publish()

    def _publish(self) -> None:
        self._publisher.publish(String(data=encode(self.own).decode()))

    def say_again(self) -> None:
        """``say`` once more if this node has said something."""
        if self._publisher is not None:
            self.say()

    def watch(self, handler: Callable[[str, bool], None]) -> None:
        """``handler(name, up)`` on the executor, at once for those who are up."""
        with self._changed:
            self._watchers.append(handler)
            for name in sorted(set(self._up.values())):
                self._executor.post(partial(handler, name, True))

    def names(self) -> set[str]:
        """The nodes that are up."""
        with self._changed:
            return set(self._up.values())

    def wait(self, names: Sequence[str], timeout_s: float) -> list[str]:
        """Wait until all ``names`` are up; those still missing after ``timeout_s``."""
        deadline = time.monotonic() + timeout_s
        with self._changed:
            while missing := [name for name in names if name not in self._up.values()]:
                left_s = deadline - time.monotonic()
                if self._closed or left_s <= 0 or not self._changed.wait(left_s):
                    return [name for name in names if name not in self._up.values()]
        return missing

    def when_observed(self, by: str, nodes: Collection[str], handler: Callable[[], None]) -> None:
        """``handler()`` once, on the graph's thread: when the taps of ``by`` have found what this node has
        declared, and it has found ``nodes``.
        """
        self.say()  # who listens knows then whose messages come
        with self._changed:
            self._awaited.append(_Awaited(by, frozenset(nodes), handler))
        self._graph.look_again()

    def close(self) -> None:
        """End all waiting, and look no more."""
        self._graph.no_longer(self._look)
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def _look(self) -> None:
        """Something may have changed (on the graph's thread, behind the roster)."""
        there = self._roster.there
        for awaited in tuple(self._awaited):
            if any(self._is_observed(awaited, one) for one in there.values()):
                self._awaited.remove(awaited)
                awaited.handler()
        gone = [gid for gid in self._up if gid not in there]
        come = {
            gid: one.presence
            for gid, one in there.items()
            if gid not in self._up and one.presence.is_ready and self._is_tapped(one)
        }
        if not gone and not come:
            return
        with self._changed:  # who begins to watch learns of a change once, by this or by ``watch``
            changes = [*self._note_gone(gone), *self._note_come(come)]
            self._changed.notify_all()
            for watcher in self._watchers:
                for name, up in changes:
                    self._executor.post(partial(watcher, name, up))
            self._executor.post(partial(self._say_found, sorted(set(self._up.values()))))

    def _note_gone(self, gone: Iterable[bytes]) -> Iterator[tuple[str, bool]]:
        for gid in gone:
            name = self._up.pop(gid)
            if name not in self._up.values():
                yield name, False

    def _note_come(self, come: dict[bytes, Presence]) -> Iterator[tuple[str, bool]]:
        for gid, presence in come.items():
            if presence.node not in self._up.values():
                yield presence.node, True
            elif presence.node == self.own.node:
                LOG.error("two nodes are named %s", presence.node)
            self._up[gid] = presence.node

    def _is_observed(self, awaited: _Awaited, one: Announced) -> bool:
        presence = one.presence
        if presence.node != awaited.by or not presence.taps:
            return False
        return awaited.nodes <= set(presence.found) and self._is_tapped(one)

    def _say_found(self, names: list[str]) -> None:
        """Those who watch here have been told that these are up; on the executor."""
        if self.own.taps and not self._closed:
            self.own.found = names
            self._publish()

    def _is_tapped(self, one: Announced) -> bool:
        """Whether the other's taps have found what this node has declared."""
        presence, own = one.presence, self.own
        if not presence.taps or presence.node == own.node:
            return True
        visible = [
            *((topic, topic) for topic in own.publishes),
            *((service, service + EVENT_SUFFIX) for service in (*own.serves, *own.calls)),
        ]
        return all(
            self._roster.shows(one, "taps", topic)
            for channel, topic in visible
            if topic not in presence.refused and matches(channel, presence.taps)
        )
