"""One node on ROS 2: the transport interface, made of the parts beside this file."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

from transports import ros_forms, ros_names, watchdog
from transports.interface import (
    Observation,
    Service,
    Topic,
    TransportError,
)
from transports.on_executor import OnExecutor
from transports.refusals import Refusals
from transports.ros2 import qos, topics
from transports.ros2.announcements import Announcements
from transports.ros2.call_errors import CallErrors
from transports.ros2.executor import LOG, Executor
from transports.ros2.faults import Declared, Faults
from transports.ros2.introspection import ServiceEvents, outbox
from transports.ros2.last_words import LastWords
from transports.ros2.logs import RosLogHandler
from transports.ros2.parameters import given, positive
from transports.ros2.services import Client, Look, OfNode, Request, Server
from transports.ros2.session import open_node, prefix_of_node
from transports.ros2.shared import Shared
from transports.ros2.subscribing import Subscriber
from transports.ros2.tap import Tap
from transports.timers import Timer

_PART = "/_action/"
"""Between the name of an action and those of its services and topics."""

_FAULTS_DELAY_S = 0.5
"""How long the graph must be quiet before it is looked at for what cannot work."""

_LAST_WORDS_S = 0.5
"""How long a node that closes, with those beside it, waits for what they sent last to arrive."""

_DESTROY_S = 8.0
"""How long ROS 2 may take to destroy a node, which takes it milliseconds: some builds of Fast DDS never
return (decision 31). Less than the 10 s that ``m2c run`` gives a node, so that the node says why it ended."""


def connect(node: str, options: Mapping[str, str]) -> Ros2Transport:
    """Start ``node``; for ``options`` see ``transports.ros2.session``.

    Raises:
        TransportError: an option is unknown or wrong, or ROS 2 refuses the name or cannot start.
    """
    if not node:
        raise TransportError("a node needs a name")
    return Ros2Transport(open_node(node, options), options)


class Ros2Transport(OnExecutor):
    """A node on ROS 2; see ``transports.interface.Transport`` for every method.

    Args:
        ros_node: an ``rclpy.node.Node``; ``close`` destroys it.
        options: see ``transports.ros2.session``.
        shared: what the nodes of its context have in common; None: it opened the context, which ends with it.
    """

    _executor: Executor

    repair_s = 3.2
    """Fast DDS keeps 512 datagrams for a process that stands still, and a writer sends the others again when
    its next heartbeat (each 3 s) is answered."""

    def __init__(
        self, ros_node: Any, options: Mapping[str, str], shared: Shared | None = None
    ) -> None:
        self._refusals = Refusals(LOG)
        super().__init__(ros_node.get_name(), Executor(ros_node, self._refusals))
        self._ros = ros_node
        self._clock = ros_node.get_clock()
        self._options = options
        self._owns_context = shared is None
        self._prefix = prefix = prefix_of_node(ros_node)
        self._shared = shared or Shared(ros_node, self._executor, prefix, self._refusals)
        self._graph = graph = self._shared.graph
        self._change_posted = threading.Event()
        self._announcements = Announcements(
            ros_node, self._executor, graph, self._shared.roster, prefix
        )
        self._own = self._announcements.own
        self._declared = Declared()
        self._faults = Faults(ros_node, graph, self._declared)
        self._faults_timer: Timer | None = None
        self._errors: CallErrors | None = None
        self._outbox = outbox(self._executor)
        self._shared.outboxes.append(self._outbox)
        self._events: dict[str, ServiceEvents] = {}
        self._look = Look()
        self._clients: dict[str, Client] = {}
        self._taps: list[Tap] = []
        self._subscriber = Subscriber(ros_node, self._executor)
        graph.listen(self._graph_changed)
        self._close_at_exit()

    @property
    def ros_node(self) -> Any:
        """The ``rclpy.node.Node``; what is declared on it runs on this transport's executor."""
        return self._ros

    def parameter(self, name: str, default: float, meaning: str) -> float:
        """A positive number that the launcher may set: ``-p name:=2.5``.

        Raises:
            TransportError: what was set is none.
        """
        self._require_open()
        return positive(self._ros, name, default, meaning)

    def given(self, name: str, meaning: str) -> object:
        """What the launcher has set (``-p name:=2``); None if nothing."""
        self._require_open()
        return given(self._ros, name, meaning)

    def log_handler(self, level: int) -> RosLogHandler:
        """Logs as ROS 2 does, what is at ``level`` (of ``logging``) and above.

        One does for all nodes of the process: see ``transports.ros2.logs``.
        """
        return RosLogHandler(lambda: self._shared.nodes, self._node, level)

    def now_ns(self) -> int:
        """The ROS clock, ns since the epoch (the simulation's time with ``use_sim_time``)."""
        simulated_ns = self._executor.simulated_ns()  # rclpy's takes 6 µs to say what time it is
        return time.time_ns() if simulated_ns is None else simulated_ns

    def publisher(self, topic: Topic) -> topics.Publisher:
        """Declare a publisher."""
        name = self._require_type(topic)
        publisher = topics.Publisher(self._ros, name, topic)
        self._declared.publishes[name] = (_ros_type(topic), qos.of_publisher(topic))
        self._own.publishes.append(name)
        self._announcements.say_again()
        return publisher

    def subscribe(self, topic: Topic, handler: Callable[[Any], None]) -> None:
        """Call ``handler(message)`` for every message."""
        name = self._require_type(topic)
        topics.subscribe(self._ros, self._executor, name, topic, handler, self._refusals)
        self._declared.subscribes[name] = (_ros_type(topic), qos.of_subscription(topic))
        self._own.subscribes.append(name)
        self._announcements.say_again()

    def serve(self, service: Service, handler: Callable[[Request], None]) -> None:
        """Serve ``service``; a second server of it, here or in another node, is reported."""
        self._require_open()
        name = self._full_name("service", service.name)
        if name in self._declared.serves:
            raise TransportError(f"{service.name} is served by {self.node} already")
        of_node = self._of_node()
        Server(of_node, self._events_of(name, service), name, service, handler)
        self._declared.serves[name] = service.type_name
        self._own.serves.append(name)
        self._announcements.say_again()

    def client(self, service: Service) -> Client:
        """A client of ``service``; the same one for the same service."""
        self._require_open()
        name = self._full_name("service", service.name)
        client = self._clients.get(name)
        if client is None:
            of_node = self._of_node()
            client = Client(of_node, self._events_of(name, service), name, service)
            self._clients[name] = client
            self._declared.calls[name] = service.type_name
            self._own.calls.append(name)
            self._announcements.say_again()
        elif client.type_name != service.type_name:
            raise TransportError(
                f"cannot call {name} as {service.type_name}: this node calls it as "
                f"{client.type_name} already"
            )
        return client

    def wait_for_nodes(self, names: Sequence[str], timeout_s: float) -> Sequence[str]:
        """Wait until all ``names`` are up; returns those still missing at the end."""
        return self._announcements.wait(names, timeout_s)

    def watch_nodes(self, handler: Callable[[str, bool], None]) -> None:
        """``handler(name, up)`` whenever a node announces itself or goes away."""
        self._announcements.watch(handler)

    def up_since(self, name: str) -> int:
        """When ``name`` began to connect: ns since the epoch, on its clock; 0 if not known."""
        return self._shared.roster.up_since(name)

    def clock_of(self, name: str) -> str:
        """See ``TellsClocks.clock_of``."""
        return self._shared.roster.clock_of(name)

    def announce(self) -> None:
        """Say that this node has declared everything and is ready."""
        self._require_open()
        self._announcements.announce()

    def when_observed(self, by: str, nodes: Collection[str], handler: Callable[[], None]) -> None:
        """See ``transports.interface.LinksByChannel``."""
        self._require_open()
        self._announcements.when_observed(by, nodes, handler)

    def tap(self, channels: Sequence[str], handler: Callable[[Observation], None]) -> Tap:
        """Receive everything on channels that match one of the globs (empty: all), passively."""
        self._require_open()
        tap = Tap(
            self._ros,
            self._executor,
            self._subscriber,
            self._shared,
            self._announcements,
            channels,
            handler,
        )
        self._taps.append(tap)
        return tap

    def close(self) -> None:
        """Stop and release everything; idempotent, from any thread."""
        if self._owns_context and self._shared.last_words is None:
            self._shared.last_words = LastWords(_LAST_WORDS_S)
            for kept in tuple(self._shared.outboxes):  # the nodes are closed one after the other
                kept.flush()
        super().close()

    def _beside(self, node: str) -> Ros2Transport:
        ros_node = self._shared.open_node(node, self._options)
        return Ros2Transport(ros_node, self._options, self._shared)

    def _release(self) -> None:
        for client in self._clients.values():
            client.close()
        self._announcements.close()
        self._executor.wait_until_idle()
        for events in self._events.values():
            events.close()
        self._outbox.close()
        self._shared.outboxes.remove(self._outbox)
        last_words = self._shared.last_words or LastWords(_LAST_WORDS_S)
        last_words.wait(self._ros.publishers)
        self._graph.no_longer(self._graph_changed)
        if self._owns_context:
            self._shared.stop()
        context = self._ros.context
        with watchdog.ended_after(_DESTROY_S, f"{self.node}: destroying the ROS 2 node"):
            self._executor.destroy()
            self._subscriber.close()
            self._ros.destroy_node()
            self._shared.leave(self._node)
            if self._owns_context:
                context.try_shutdown()

    def _full_name(self, kind: str, channel: str) -> str:
        """``channel`` with the namespace, or what a rule of the launcher's puts there, ``-r from:=to``.

        A rule for an action is one for all of its parts. ROS 2 would apply it to single topics and services
        only, and not to those of the events that a tap hears.

        Raises:
            TransportError: ROS 2 does not take it for a ``kind``, or would apply another rule to the result.
        """
        whole, part_of, part = (self._prefix + channel).partition(_PART)
        is_service = kind == "service" and not part_of
        resolve = self._ros.resolve_service_name if is_service else self._ros.resolve_topic_name
        self._check(kind, whole)
        try:
            remapped: str = resolve(whole)
            again: str = resolve(remapped)
        except _rclpy.RCLError as error:
            raise TransportError(f"ROS 2 does not take a name for {whole}: {error}") from error
        if again != remapped:
            what = f"{whole} is remapped to {remapped}, and that to {again}"
            raise TransportError(f"{what}: use another name")
        name = remapped + part_of + part
        self._check(kind, name)
        return name

    def _check(self, kind: str, name: str) -> None:
        refused = ros_names.refusal(kind, name)
        if refused is not None:
            raise TransportError(f"ROS 2 does not take the {kind} {name!r}: {refused[0]}")

    def _require_type(self, topic: Topic) -> str:
        """The full name of ``topic``, which may have one type in this process: DDS allows no other."""
        self._require_open()
        name = self._full_name("topic", topic.name)
        self._shared.require_type(name, _ros_type(topic), self._node)
        return name

    def _events_of(self, name: str, service: Service) -> ServiceEvents:
        events = self._events.get(name)
        if events is None:
            events = ServiceEvents(self._ros, self._outbox, name, service.type_name)
            self._events[name] = events
        return events

    def _of_node(self) -> OfNode:
        return OfNode(
            self._ros,
            self._executor,
            self._graph,
            self._call_errors(),
            self._look,
            self._refusals,
        )

    def _call_errors(self) -> CallErrors:
        if self._errors is None:
            topic = self._prefix + ros_forms.CALL_ERRORS
            self._errors = CallErrors(self._ros, self._executor, topic, self._refusals)
            self._own.publishes.append(topic)
            self._own.subscribes.append(topic)
        return self._errors

    def _graph_changed(self) -> None:
        """On the graph's thread; a burst of changes is looked at once."""
        if not self._change_posted.is_set():
            self._change_posted.set()
            self._executor.post(self._look_at_graph)

    def _look_at_graph(self) -> None:
        self._change_posted.clear()
        for client in list(self._clients.values()):
            client.graph_changed()
        for tap in self._taps:
            tap.refresh()
        if self._faults_timer is not None:
            self._faults_timer.cancel()
        self._faults_timer = self._executor.after_real(_FAULTS_DELAY_S, self._faults.look)


def _ros_type(topic: Topic) -> str:
    return (
        ros_forms.STRING if topic.type_name.startswith(ros_forms.OWN_PACKAGES) else topic.type_name
    )
