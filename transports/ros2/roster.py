"""Who is there: what the nodes say of themselves, held against the graph. One for the nodes of a process.

A node is there once all that it has declared has reached this process's graph, and until the publisher by
which it said so has left: at once after ``close()``, after DDS's lease when it was killed.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from typing import Any

import msgspec
from rclpy.event_handler import SubscriptionEventCallbacks
from std_msgs.msg import String

from transports import host
from transports.contested import Contested
from transports.payloads import PayloadError
from transports.refusals import Refusals
from transports.ros2 import native
from transports.ros2.executor import Executor
from transports.ros2.graph import UNKNOWN, Graph, request_topic
from transports.ros2.presence import MOST_ENDPOINTS, TOPIC, Presence, profile, read_presence

_KEPT = 1000
"""Nodes that may announce themselves before a newcomer has read the first."""
_MOST_ANNOUNCED = 4096
"""Announcements that are remembered; anybody may make any number."""


class Announced(msgspec.Struct, eq=False):
    """An announcement, and what of it the graph has shown: that is not asked again, which takes its time.

    What the node has declared is recognised by its GIDs, not by the node's name: names come by another way
    (``ros_discovery_info``), on which Fast DDS may lose somebody for good (decision 20).
    """

    presence: Presence
    participant: bytes
    gids: frozenset[bytes]
    shown: set[tuple[str, str]] = msgspec.field(default_factory=set)
    has_publisher: bool = False
    """Whether the graph has shown who announced it."""


class Roster:
    """All that have announced themselves.

    Args:
        node: the ``rclpy.node.Node`` that opened the context.
        executor: its own.
        graph: of the context; its thread does the work, and calls those who listen to it behind this.
        prefix: put before every channel.
        refusals: where announcements that are none are counted.
    """

    def __init__(
        self, node: Any, executor: Executor, graph: Graph, prefix: str, refusals: Refusals
    ) -> None:
        self._node = node
        self._graph = graph
        self._refusals = refusals
        self._topic = prefix + TOPIC
        self._taker = native.Taker()
        self._announced: dict[bytes, Announced] = {}
        self.there: Mapping[bytes, Announced] = {}
        """Those who are there, by who announced them; replaced whole, as other threads read it."""
        self._since: dict[str, int] = {}
        self._hosts: dict[str, str] = {}
        self._participants: Mapping[str, Set[bytes]] = {}
        """Of each node that is there; replaced whole."""
        self._contested = Contested()
        self._subscription = node.create_subscription(
            String,
            self._topic,
            lambda message: None,
            profile(_KEPT),
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            raw=True,
        )
        executor.ignore(self._subscription)
        graph.listen(self._look)
        graph.start(self._subscription)

    def up_since(self, name: str) -> int:
        """When ``name`` began to connect, by its last announcement; 0 before any."""
        return self._since.get(name, 0)

    def clock_of(self, name: str) -> str:
        """See ``TellsClocks.clock_of``."""
        return host.clock_of(self._hosts.get(name, "") if name else host.ID)

    def is_there(self, name: str) -> bool:
        """Whether a node of this name has announced itself, and is there."""
        return name in self._participants

    def is_of(self, name: str, gid: bytes) -> bool:
        """Whether the endpoint with this GID may be of ``name``: of its participant, once it is there."""
        own = self._participants.get(name)
        return own is None or native.participant_of(gid) in own

    def is_contested(self, name: str) -> bool:
        """Whether several participants say that they are ``name``, or did of late. A node that was killed and
        started again is there twice until DDS has given up the first. Of a name that nobody announces the
        graph shows how many have it.
        """
        if self._contested.is_contested(name):
            return True
        return not self.is_there(name) and self._graph.is_contested(name)

    def contested(self) -> list[str]:
        """Names that several participants have at present."""
        unannounced = self._graph.contested() - self._participants.keys()
        return sorted(self._contested.names() | unannounced)

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
        shown = {
            native.gid_of(info) for info in self._node.get_publishers_info_by_topic(self._topic)
        }
        for gid in [gid for gid, one in self._announced.items() if one.has_publisher]:
            if gid not in shown:
                del self._announced[gid]
        for gid in shown & self._announced.keys():
            self._announced[gid].has_publisher = True
        there = {
            gid: one
            for gid, one in self._announced.items()
            if one.has_publisher and (gid in self.there or self._has_all(one))
        }
        before = self.there
        self.there = there
        if there.keys() != before.keys():
            self._note_participants(there)
            for gid in there.keys() - before.keys():
                presence = there[gid].presence
                # from which of two something comes is not known, and so not what it had done before
                is_twin = len(self._participants[presence.node]) > 1
                self._since[presence.node] = 0 if is_twin else presence.since_ns
                self._hosts[presence.node] = "" if is_twin else presence.host

    def _take(self, gid: bytes, presence: Presence) -> None:
        known = self._announced.get(gid)
        if known is None and len(self._announced) >= _MOST_ANNOUNCED:
            raise PayloadError(f"more than {_MOST_ANNOUNCED} nodes have announced themselves")
        participant = native.participant_of(gid)
        gids = presence.gids(participant)
        announced = Announced(presence, participant, gids)
        if known is not None:
            announced.has_publisher = known.has_publisher
            if gids == known.gids and presence.subscribes == known.presence.subscribes:
                announced.shown = known.shown
        self._announced[gid] = announced
        self._graph.learn_node(presence.node, participant, gids)

    def _note_participants(self, there: Mapping[bytes, Announced]) -> None:
        participants: dict[str, set[bytes]] = {}
        for one in there.values():
            participants.setdefault(one.presence.node, set()).add(one.participant)
        self._participants = participants
        self._contested.note({name for name, own in participants.items() if len(own) > 1})

    # What the graph shows.

    def _has_all(self, one: Announced) -> bool:
        """Whether all that the node has declared has reached this process's graph."""
        presence = one.presence
        return (
            all(self.shows(one, "publishes", topic) for topic in presence.publishes)
            and all(self.shows(one, "subscribes", topic) for topic in presence.subscribes)
            and all(self.shows(one, "serves", request_topic(name)) for name in presence.serves)
        )

    def shows(self, one: Announced, how: str, topic: str) -> bool:
        """Whether the graph shows, or has shown, that the node has to do with ``topic``: ``publishes``,
        ``subscribes``, ``serves`` (requests) or ``taps`` it. On the graph's thread.
        """
        if (how, topic) not in one.shown:
            if how == "publishes":
                infos = self._node.get_publishers_info_by_topic(topic)
            else:
                infos = self._node.get_subscriptions_info_by_topic(topic, no_mangle=how == "serves")
            found = sum(self._is_its(one, how, info) for info in infos)
            # a tap subscribes beside the node itself, if that does too
            if found <= (one.presence.subscribes.count(topic) if how == "taps" else 0):
                return False
            one.shown.add((how, topic))
        return True

    def _is_its(self, one: Announced, how: str, endpoint: Any) -> bool:
        gid = native.gid_of(endpoint)
        if native.participant_of(gid) != one.participant:
            return False
        if gid in one.gids or not one.gids:
            return True
        is_listed = how != "taps" and len(one.gids) < MOST_ENDPOINTS
        return not is_listed and self._graph.name_of(endpoint) in (one.presence.node, UNKNOWN)
