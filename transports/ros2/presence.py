"""Who is up: what each node says of itself when it is ready, held against the graph.

ROS 2 shows a node as soon as it exists, and its endpoints one by one. So a node that is ready
publishes, transient_local on ``<namespace>/_m2c/nodes``, what it has declared (JSON in a
``std_msgs/msg/String``); another node counts it as up once all of that has reached its own graph.
It is down when that publisher has left the graph: at once after ``close()``, after DDS's lease when
it was killed.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Annotated, Any

import msgspec
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from transports.channel_filter import matches
from transports.payloads import PayloadError, decode_with
from transports.refusals import Refusals
from transports.ros2 import native, qos
from transports.ros2.executor import LOG, Executor
from transports.ros2.graph import Graph, request_topic
from transports.service_events import EVENT_SUFFIX

TOPIC = "/_m2c/nodes"
CONTESTED_S = 5.0
"""What a node has sent has come, or comes too late to be judged, so long after it went away."""
_KEPT = 100
"""Nodes that may announce themselves before a newcomer has read the first."""


class Presence(msgspec.Struct):
    """What a node says of itself.

    Attributes:
        node: its name.
        since_ns: when it began to connect, ns since the epoch, on its clock.
        publishes, subscribes, serves, calls: full names of what it had declared.
        taps: globs of what it listens to, and with them it declares to receive what matches.
        refused: topics that its taps cannot receive.
    """

    node: Annotated[str, msgspec.Meta(min_length=1, max_length=255)]
    since_ns: Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)] = 0
    publishes: list[str] = msgspec.field(default_factory=list)
    subscribes: list[str] = msgspec.field(default_factory=list)
    serves: list[str] = msgspec.field(default_factory=list)
    calls: list[str] = msgspec.field(default_factory=list)
    taps: list[str] = msgspec.field(default_factory=list)
    refused: list[str] = msgspec.field(default_factory=list)


class _Announced(msgspec.Struct):
    """An announcement, and what of it the graph has shown: that is not asked again, which takes its time.

    What the node has declared is recognised by its participant, not by its name: names come by another way
    (``ros_discovery_info``), on which Fast DDS may lose somebody for good (decision 20).
    """

    presence: Presence
    participant: bytes
    shown: set[tuple[str, str]] = msgspec.field(default_factory=set)


_encode = msgspec.json.Encoder().encode
_decode = msgspec.json.Decoder(Presence).decode
_MOST_ANNOUNCED = 4096
"""Announcements that are remembered; anybody may make any number."""


class Announcements:
    """The node's own announcement, and those of the others."""

    def __init__(
        self, node: Any, executor: Executor, graph: Graph, prefix: str, refusals: Refusals
    ) -> None:
        self._refusals = refusals
        self._node = node
        self._executor = executor
        self._graph = graph
        self._topic = prefix + TOPIC
        self._taker = native.Taker()
        self._announced: dict[bytes, _Announced] = {}
        self._up: dict[bytes, str] = {}
        self._changed = threading.Condition()
        self._watchers: list[Callable[[str, bool], None]] = []
        self._publisher: Any = None
        self._closed = False
        self.own = Presence(node.get_name(), time.time_ns())
        self._since: dict[str, int] = {}
        self._participants: Mapping[str, frozenset[bytes]] = {}
        """Of each node that is up; replaced whole, as other threads read it."""
        self._contested_until_s: dict[str, float] = {}
        self._subscription = node.create_subscription(
            String,
            self._topic,
            lambda message: None,
            _profile(_KEPT),
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            raw=True,
        )
        executor.ignore(self._subscription)
        graph.listen(self._look)
        graph.start(self._subscription)

    def announce(self) -> None:
        """Say what this node has declared; saying it again reports what has changed."""
        if self._publisher is None:
            self._publisher = self._node.create_publisher(
                String,
                self._topic,
                _profile(1),
                event_callbacks=PublisherEventCallbacks(use_default_callbacks=False),
            )
        self._publisher.publish(String(data=_encode(self.own).decode()))

    def announce_again(self) -> None:
        """``announce`` once more if this node has announced itself."""
        if self._publisher is not None:
            self.announce()

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

    def up_since(self, name: str) -> int:
        """When ``name`` began to connect, by its last announcement; 0 before any."""
        return self._since.get(name, 0)

    def is_of(self, name: str, gid: bytes) -> bool:
        """Whether the endpoint with this GID may be of ``name``: of its participant, once that node is up."""
        own = self._participants.get(name)
        return own is None or native.participant_of(gid) in own

    def is_contested(self, name: str) -> bool:
        """Whether several participants say that they are ``name``, or did of late. A node that was killed and
        started again is there twice until DDS has given up the first.
        """
        until_s = self._contested_until_s.get(name)
        return until_s is not None and until_s >= time.monotonic()

    def contested(self) -> list[str]:
        """Names that several participants have at present."""
        return sorted(name for name, own in self._participants.items() if len(own) > 1)

    def wait(self, names: Sequence[str], timeout_s: float) -> list[str]:
        """Wait until all ``names`` are up; those still missing after ``timeout_s``."""
        deadline = time.monotonic() + timeout_s
        with self._changed:
            while missing := [name for name in names if name not in self._up.values()]:
                left_s = deadline - time.monotonic()
                if self._closed or left_s <= 0 or not self._changed.wait(left_s):
                    return [name for name in names if name not in self._up.values()]
        return missing

    def close(self) -> None:
        """End all waiting."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def release(self) -> None:
        """After the graph's thread has ended."""
        self._taker.close()

    def _look(self) -> None:
        """Something has changed (on the graph's thread)."""
        while (taken := self._taker.take(self._subscription.handle)) is not None:
            try:
                self._take(taken.gid, read_presence(taken.payload))
            except PayloadError as error:
                self._refusals.refuse(self._topic, "", error)
        there = {
            native.gid_of(info) for info in self._node.get_publishers_info_by_topic(self._topic)
        }
        gone = [gid for gid in self._up if gid not in there]
        come = {
            gid: announced.presence
            for gid, announced in self._announced.items()
            if gid not in self._up and gid in there and self._is_complete(announced)
        }
        if not gone and not come:
            return
        with self._changed:  # who begins to watch learns of a change once, by this or by ``watch``
            changes = [*self._note_gone(gone), *self._note_come(come)]
            self._changed.notify_all()
            for watcher in self._watchers:
                for name, up in changes:
                    self._executor.post(partial(watcher, name, up))

    def _take(self, gid: bytes, presence: Presence) -> None:
        if len(self._announced) >= _MOST_ANNOUNCED and gid not in self._announced:
            raise PayloadError(f"more than {_MOST_ANNOUNCED} nodes have announced themselves")
        self._announced[gid] = _Announced(presence, native.participant_of(gid))
        self._graph.learn_node(gid, presence.node)

    def _note_gone(self, gone: list[bytes]) -> Iterator[tuple[str, bool]]:
        for gid in gone:
            self._announced.pop(gid, None)
            name = self._up.pop(gid)
            self._note_participants(name)
            if name not in self._up.values():
                yield name, False

    def _note_come(self, come: dict[bytes, Presence]) -> Iterator[tuple[str, bool]]:
        for gid, presence in come.items():
            if presence.node not in self._up.values():
                yield presence.node, True
            elif presence.node == self.own.node:
                LOG.error("two nodes are named %s", presence.node)
            self._up[gid] = presence.node
            self._note_participants(presence.node)
            # from which of two something comes is not known, and so not what it had done before
            is_twin = len(self._participants[presence.node]) > 1
            self._since[presence.node] = 0 if is_twin else presence.since_ns

    def _note_participants(self, name: str) -> None:
        own = frozenset(native.participant_of(gid) for gid, up in self._up.items() if up == name)
        before = self._participants.get(name, frozenset())
        others = {other: there for other, there in self._participants.items() if other != name}
        self._participants = {**others, name: own} if own else others
        if len(own) > 1:
            self._contested_until_s[name] = math.inf
        elif len(before) > 1:
            self._contested_until_s[name] = time.monotonic() + CONTESTED_S

    def _is_complete(self, announced: _Announced) -> bool:
        """Whether all that the node has declared has reached this node's graph, and its taps have
        found what this node has declared.
        """
        for wanted in self._wanted(announced.presence):
            if wanted in announced.shown:
                continue
            if not self._is_shown(*wanted, announced):
                return False
            announced.shown.add(wanted)
        return True

    def _wanted(self, presence: Presence) -> Iterator[tuple[str, str]]:
        """What the graph has to show of the node: kind and topic."""
        yield from (("publishes", topic) for topic in presence.publishes)
        yield from (("subscribes", topic) for topic in presence.subscribes)
        yield from (("serves", request_topic(service)) for service in presence.serves)
        if not presence.taps or presence.node == self.own.node:
            return
        visible = [
            *((topic, topic) for topic in self.own.publishes),
            *((service, service + EVENT_SUFFIX) for service in (*self.own.serves, *self.own.calls)),
        ]
        for channel, topic in visible:
            if topic not in presence.refused and matches(channel, presence.taps):
                yield "taps", topic

    def _is_shown(self, kind: str, topic: str, announced: _Announced) -> bool:
        if kind == "publishes":
            infos = self._node.get_publishers_info_by_topic(topic)
        else:
            infos = self._node.get_subscriptions_info_by_topic(topic, no_mangle=kind == "serves")
        found = sum(
            native.participant_of(info.endpoint_gid) == announced.participant for info in infos
        )
        # a tap subscribes beside the node itself, if that does too
        return found > (announced.presence.subscribes.count(topic) if kind == "taps" else 0)


def _profile(depth: int) -> QoSProfile:
    return qos.profile(reliable=True, transient_local=True, depth=depth)


def read_presence(payload: bytes) -> Presence:
    """What a node says of itself in a serialized String; PayloadError if it is no such thing.

    That is 4 bytes of CDR header, the text's length, itself, NUL.
    """
    if len(payload) < _TEXT_AT:
        raise PayloadError("it is no String")
    length = int.from_bytes(payload[4:_TEXT_AT], "little" if payload[1] & 1 else "big")
    presence: Presence = decode_with(_decode, payload[_TEXT_AT : _TEXT_AT + max(length - 1, 0)])
    return presence


_TEXT_AT = 8
