"""The graph of a ROS 2 system: who is there, with a report when it changes.

rcl triggers a guard condition at every change of the graph; one thread waits for it and calls those
who asked. rclpy itself only offers to look again every now and then. The nodes of one rclpy context see
the same graph, and share this.
"""

# rclpy leaves some of its functions without types
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Iterable
from typing import Any

from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

from transports.bounded import BoundedDict
from transports.contested import Contested
from transports.ros2 import native
from transports.ros2.node_names import NodeNames

UNKNOWN = "_NODE_NAME_UNKNOWN_"
"""What rmw says of an endpoint whose node it has not discovered yet."""

_PAUSE_S = 0.005
"""Changes come in bursts (a node that starts makes dozens): each burst is reported once."""
_MOST_NAMED = 100_000
"""Endpoints whose nodes are remembered, as anybody may claim any number; the oldest are forgotten first."""


def request_topic(service: str) -> str:
    """The DDS topic on which requests travel (https://design.ros2.org)."""
    return f"rq{service}Request"


def response_topic(service: str) -> str:
    """The DDS topic on which responses travel."""
    return f"rr{service}Reply"


def service_type_of(dds_type: str) -> str:
    """``pkg/srv/Name`` of a request's DDS type, ``pkg::srv::dds_::Name_Request_``."""
    package, kind, _, name = (*dds_type.split("::"), "", "", "", "")[:4]
    return f"{package}/{kind}/{name.removesuffix('_Request_')}"


class Graph:
    """Tells of changes, and finds names for GIDs.

    Args:
        node: the ``rclpy.node.Node`` by which rcl is asked; it outlives this.
        prefix: the system's namespace as a prefix of channels.
    """

    def __init__(self, node: Any, prefix: str) -> None:
        self._node = node
        self._guard = native.graph_guard(node)
        self._bell = GuardCondition(callback=None, callback_group=None, context=node.context)
        self._stopping = threading.Event()
        self._listeners: tuple[Callable[[], None], ...] = ()
        """Replaced whole, as the graph's thread goes through them."""
        self._subscription: Any = None
        self._lock = threading.Lock()
        self._node_names = NodeNames(prefix, _MOST_NAMED)
        self._twins = Contested()
        self._names: BoundedDict[bytes, str] = BoundedDict(_MOST_NAMED)
        """The node of each endpoint, as ``NodeNames.called`` takes it."""
        self._participants: dict[bytes, set[str]] = {}
        self._alone: dict[bytes, str] = {}
        """Of participants that hold one node, which says so itself."""
        self._itemized: set[bytes] = set()
        """Participants whose nodes say which endpoints are their own."""
        self._thread = threading.Thread(target=self._watch, name="ros2-graph", daemon=True)

    def listen(self, listener: Callable[[], None]) -> None:
        """Call ``listener`` on the graph's thread, soon for the first time and then at each change."""
        with self._lock:
            self._listeners = (*self._listeners, listener)
        self._bell.trigger()

    def look_again(self) -> None:
        """Call those who listen once more, soon, though nothing has changed; from any thread."""
        self._bell.trigger()

    def no_longer(self, listener: Callable[[], None]) -> None:
        """Undo ``listen``; it may be under way for the last time."""
        with self._lock:
            self._listeners = tuple(other for other in self._listeners if other != listener)

    def start(self, subscription: Any) -> None:
        """Begin; a message on ``subscription`` counts as a change too (a listener takes it)."""
        self._subscription = subscription
        self._thread.start()

    def stop(self) -> None:
        """End; idempotent."""
        self._stopping.set()
        if self._thread.is_alive():
            self._bell.trigger()
            self._thread.join()
        self._bell.destroy()

    def _watch(self) -> None:
        wait_set = _rclpy.WaitSet(1, 2, 0, 0, 0, 0, self._node.context.handle)
        while not self._stopping.is_set():
            for listener in self._listeners:
                listener()
            if self._stopping.wait(_PAUSE_S):
                return
            wait_set.clear_entities()
            wait_set.add_subscription(self._subscription.handle)
            wait_set.add_guard_condition(self._bell.handle)
            native.add_guard(wait_set, self._guard)
            wait_set.wait(-1)

    # Who is behind a GID.

    def publisher_of(self, topic: str, gid: bytes) -> str:
        """The node whose publisher of ``topic`` has this GID; empty while nobody knows."""
        name = self._known(gid)
        if name is None and not self._stopping.is_set():
            self._learn(self._node.get_publishers_info_by_topic(topic))
        return self._find(gid) if name is None else name

    def client_of(self, service: str, gid: bytes) -> str:
        """The node whose client of ``service`` has this GID; empty while nobody knows.

        The client's end names itself by its request writer, the server by the response reader.
        """
        name = self._known(gid)
        if name is None and not self._stopping.is_set():
            node = self._node
            self._learn(node.get_publishers_info_by_topic(request_topic(service), no_mangle=True))
            self._learn(
                node.get_subscriptions_info_by_topic(response_topic(service), no_mangle=True)
            )
        return self._find(gid) if name is None else name

    def clients_of(self, service: str) -> set[bytes]:
        """The GIDs of the clients that are there, as a server knows them."""
        topic = response_topic(service)
        found = self._node.get_subscriptions_info_by_topic(topic, no_mangle=True)
        return {native.gid_of(info) for info in found}

    def learn_participants(self) -> None:
        """Note which node is in which participant; every node has a publisher of ``/rosout``."""
        shown: dict[str, set[bytes]] = {}
        for node, gid in self._learn(self._node.get_publishers_info_by_topic("/rosout")):
            shown.setdefault(node, set()).add(native.participant_of(gid))
        called = self._node_names.called
        self._twins.note({called(node) for node, own in shown.items() if len(own) > 1})

    def name_of(self, endpoint: Any) -> str:
        """The node of an endpoint that the graph shows; UNKNOWN while nobody knows."""
        if endpoint.node_name != UNKNOWN:
            return self._node_names.called(
                self._node_names.learn(endpoint.node_name, endpoint.node_namespace)
            )
        return self._find(native.gid_of(endpoint)) or UNKNOWN

    def node_names(self) -> set[str]:
        """Of all nodes that the graph shows."""
        found = self._node.get_node_names_and_namespaces()
        return {self._node_names.called(self._node_names.learn(*names)) for names in found}

    def is_contested(self, name: str) -> bool:
        """Whether several nodes of this name are shown, or were of late."""
        return self._twins.is_contested(name) or self._node_names.contested.is_contested(name)

    def contested(self) -> set[str]:
        """Names of which several nodes are shown at present."""
        return self._twins.names()

    def _learn(self, endpoints: Iterable[Any]) -> list[tuple[str, bytes]]:
        """Note whose these are; returned are the node and the GID of each that has a name."""
        learned = []
        with self._lock:
            for endpoint in endpoints:
                if endpoint.node_name == UNKNOWN:
                    continue
                gid = native.gid_of(endpoint)
                node = self._node_names.learn(endpoint.node_name, endpoint.node_namespace)
                self._names.setdefault(gid, node)
                self._participants.setdefault(native.participant_of(gid), set()).add(node)
                learned.append((node, gid))
        return learned

    def learn_node(self, name: str, participant: bytes, endpoints: Collection[bytes]) -> None:
        """What ``name`` says of itself; the graph may show it seconds later, or never.

        Args:
            name: the node's.
            participant: the one that it is in.
            endpoints: the GIDs of what it has, all in that participant; none: it has that for itself.
        """
        with self._lock:
            self._node_names.learn(name)
            if not endpoints:
                self._alone[participant] = name
                return
            self._alone.pop(participant, None)
            self._itemized.add(participant)
            for endpoint in endpoints:
                self._names[endpoint] = name

    def _known(self, gid: bytes) -> str | None:
        """The node's name, without asking the graph."""
        node = self._names.get(gid)
        if node is None:
            return self._alone.get(native.participant_of(gid))
        return self._node_names.called(node)

    def _find(self, gid: bytes) -> str:
        """By the endpoint, else by its participant if that is known to hold one node only."""
        name = self._known(gid)
        if name is not None:
            return name
        participant = native.participant_of(gid)
        with self._lock:
            nodes = self._participants.get(participant, set())
            is_only = len(nodes) == 1 and participant not in self._itemized
            return self._node_names.called(next(iter(nodes))) if is_only else ""
