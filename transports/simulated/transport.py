"""One node in a simulated world: the transport interface on virtual time."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Callable, Sequence
from typing import Any

from transports import actions
from transports.interface import (
    Action,
    ActionClient,
    Closes,
    GoalHandle,
    Message,
    Observation,
    Reliability,
    Service,
    Topic,
    TransportError,
)
from transports.payloads import PayloadError, TypedCodec
from transports.refusals import Refusals
from transports.simulated.conditions import Rules
from transports.simulated.network import Link
from transports.simulated.presence import View
from transports.simulated.routes import Sent, Tap
from transports.simulated.services import Client, Request, Server
from transports.simulated.world import Completion, Rank, SimulatedWorld
from transports.timers import period_ns

LOG = logging.getLogger("transports.simulated")


class Timer:
    """A running timer."""

    __slots__ = ("_handler", "_node", "_period_ns")

    def __init__(
        self, node: SimulatedTransport, delay_ns: int, period_ns: int, handler: Callable[[], None]
    ) -> None:
        self._node = node
        self._handler: Callable[[], None] | None = handler
        self._period_ns = period_ns
        node.world.schedule(delay_ns, self._fire, None, Rank.TIMER)

    def cancel(self) -> None:
        """Stop it; idempotent."""
        self._handler = None

    def _fire(self, _: object) -> None:
        node = self._node
        if self._handler is None or not node.alive:
            return
        if self._period_ns:
            still_ns = (
                node.still_ns()
            )  # ticks that are slept through are skipped, the phase is kept
            periods = -(-still_ns // self._period_ns) or 1
            node.world.schedule(periods * self._period_ns, self._fire, None, Rank.TIMER)
        node.work(self._run, None)

    def _run(self, _: object) -> None:
        if self._handler is not None:
            self._handler()


class Publisher:
    """Publishes one topic."""

    def __init__(self, node: SimulatedTransport, topic: Topic) -> None:
        self.node = node
        self._topic = topic
        self._codec = TypedCodec(topic.type_name, topic.message)
        self.is_lossy = topic.reliability is Reliability.BEST_EFFORT
        self.declared_ns = node.world.now_ns

    def publish(self, message: Message) -> None:
        """Send ``message`` to every subscriber and tap."""
        payload = self._codec.encode(message)
        node, topic = self.node, self._topic
        if not node.alive:
            raise TransportError(f"cannot publish on {topic.name}: {node.node} is closed")
        number = node.routes.numbers.take(node.node, topic.name)
        stamp_ns = node.world.stamp_of(node.node)
        sent = Sent(node.node, number, topic.type_name, payload, stamp_ns, node.life)
        if topic.transient_local:
            node.routes.transient_local.setdefault(topic.name, {})[self] = sent
        for subscription in node.routes.subscriptions(topic.name):
            subscription.take(self, sent)
        node.routes.message(sent, topic.name)


class Subscription:
    """One node's interest in one topic."""

    def __init__(
        self, node: SimulatedTransport, topic: Topic, handler: Callable[[Any], None]
    ) -> None:
        self._node = node
        self._topic = topic
        self._codec = TypedCodec(topic.type_name, topic.message)
        self._handler = handler
        self._declared_ns = node.world.now_ns
        self._found: dict[Publisher, int] = {}
        """When this and each publisher have found each other (ns)."""
        self._last: dict[Publisher, int] = {}
        """The number of the last message that each has sent here."""

    def take(self, publisher: Publisher, message: Sent) -> None:
        """Let a message be under way to here, if its publisher has found this."""
        world = self._node.world
        if world.network.finds_at_once:
            self._send(publisher, message)
            return
        if self._found_ns(publisher) <= world.now_ns:
            self._send(publisher, message)
        elif self._topic.transient_local:
            self.take_last(publisher)

    def take_last(self, publisher: Publisher) -> None:
        """Let the last message of ``publisher`` be under way to here once it has found this."""
        world = self._node.world
        if world.network.finds_at_once:
            self._send_last(publisher)
        else:
            # what is published until then asks for it, too
            wait_ns = max(self._found_ns(publisher) - world.now_ns, 0)
            world.schedule(wait_ns, self._send_last, publisher)

    def _found_ns(self, publisher: Publisher) -> int:
        found_ns = self._found.get(publisher)
        if found_ns is None:
            since_ns = max(self._declared_ns, publisher.declared_ns)
            found_ns = since_ns + self._node.world.network.discovery_ns()
            self._found[publisher] = found_ns
        return found_ns

    def _send_last(self, publisher: Publisher) -> None:
        last = self._node.routes.transient_local.get(self._topic.name, {}).get(publisher)
        if last is not None and self._last.get(publisher) != last.number:
            self._send(publisher, last)

    def _send(self, publisher: Publisher, message: Sent) -> None:
        self._last[publisher] = message.number
        link = Link(message.source, self._topic.name, self._node.node)
        self._node.world.send(link, self._arrive, message, is_lossy=publisher.is_lossy)

    def _arrive(self, message: Sent) -> None:
        clocks = self._node.world.clocks
        if clocks.differ:
            clocks.see(self._node.node, message.stamp_ns)
        self._node.work(self._receive, message)

    def _receive(self, message: Sent) -> None:
        try:
            self._codec.require(message.type_name)
            decoded = self._codec.decode_bytes(message.payload)
        except PayloadError as error:
            self._node.refusals.refuse(self._topic.name, message.source, error)
            return
        self._node.routes.taken(self._node.node, message, self._topic.name)
        self._handler(decoded)


class SimulatedTransport(Closes):
    """A node in a simulated world; see ``transports.interface.Transport`` for every method.

    ``spin`` runs the whole world, so one thread drives any number of nodes.
    """

    def __init__(self, world: SimulatedWorld, node: str) -> None:
        if not node:
            raise TransportError("a node needs a name")
        if node in world.nodes:
            raise TransportError(f"two nodes are named {node} in this world")
        self.world = world
        self.routes = world.routes
        self.alive = True
        is_ros = world.conditions.rules is Rules.ROS2
        self.repair_s = _ROS2_REPAIR_S if is_ros else 0.0
        self.reports_takes = not is_ros
        self.refusals = Refusals(LOG)
        self.listens = False
        """Whether a tap is its."""
        self._node = node
        self._calls = itertools.count(1)
        self._subscriptions: list[tuple[str, Subscription]] = []
        self._servers: dict[str, Server] = {}
        self._clients: list[Client] = []
        self._own_taps: list[Tap] = []
        self._beside: list[SimulatedTransport] = []
        self._announced = False
        self._free_ns = 0
        self.connected_ns = world.now_ns
        """Virtual time."""
        self.since_ns = SimulatedTransport.now_ns(self)
        """The same by its own clock."""
        self.life = world.next_life()
        self.view = View(self)
        world.nodes[node] = self
        self.routes.begin(node)
        world.presence.connected(self)

    @property
    def node(self) -> str:
        """The name of this node."""
        return self._node

    def beside(self, node: str) -> SimulatedTransport:
        """Another node in the same world."""
        other = SimulatedTransport(self.world, node)
        self._beside.append(other)
        return other

    def now_ns(self) -> int:
        """The clock of this node's host, ns since the epoch."""
        world = self.world
        return world.now_ns + (world.clocks.ahead_ns(self._node) if world.clocks.differ else 0)

    def still_ns(self) -> int:
        """How long this node stands still from now on."""
        return self.world.pauses.after(self._node, self.world.now_ns) - self.world.now_ns

    def steady_ns(self) -> int:
        """See ``transports.interface.VirtualTime``."""
        return self.world.now_ns

    def work(self, handler: Callable[[Any], None], argument: Any) -> None:
        """Run ``handler(argument)`` as this node's next piece of work, when it has time for it."""
        world = self.world
        start = world.pauses.after(self._node, max(world.now_ns, self._free_ns))
        self._free_ns = start + world.busy_ns()
        if start > world.now_ns:
            world.schedule(start - world.now_ns, self._run, (handler, argument))
        else:
            self._run((handler, argument))

    def _run(self, item: tuple[Callable[[Any], None], Any]) -> None:
        if not self.alive:
            return
        world = self.world
        before = world.running
        world.running = world.acted = self._node
        try:
            item[0](item[1])
        except Exception:
            world.failed = world.failed or self._node
            raise
        finally:
            world.running = before

    def publisher(self, topic: Topic) -> Publisher:
        """Declare a publisher."""
        _check_name(topic.name)
        return Publisher(self, topic)

    def subscribe(self, topic: Topic, handler: Callable[[Any], None]) -> None:
        """Call ``handler(message)`` for every message."""
        _check_name(topic.name)
        subscription = Subscription(self, topic, handler)
        self._subscriptions.append((topic.name, subscription))
        self.routes.subscriptions(topic.name).append(subscription)
        if topic.transient_local:
            for publisher in self.routes.transient_local.get(topic.name, {}):
                subscription.take_last(publisher)

    def serve(self, service: Service, handler: Callable[[Request], None]) -> None:
        """Serve ``service``; a second server of it, here or in another node, is reported."""
        _check_name(service.name)
        if service.name in self._servers:
            raise TransportError(f"{service.name} is served by {self._node} already")
        server = Server(self, service, handler)
        servers = self.routes.servers(service.name)
        for other in servers:
            LOG.error(
                "two nodes serve %s: %s and %s; a call reaches only one of them",
                service.name,
                self._node,
                other.node.node,
            )
        servers.append(server)
        self._servers[service.name] = server

    def client(self, service: Service) -> Client:
        """A client of ``service``."""
        _check_name(service.name)
        is_ros = self.world.conditions.rules is Rules.ROS2
        client = Client(self, service, itertools.count(1) if is_ros else self._calls)
        self._clients.append(client)
        return client

    def serve_action(
        self,
        action: Action,
        goal: Callable[[GoalHandle], None],
        cancel: Callable[[GoalHandle], None],
    ) -> None:
        """Serve ``action``."""
        actions.serve_action(self, action, goal, cancel)

    def action_client(self, action: Action) -> ActionClient:
        """A client of ``action``, whose goal ids come from the world's seed."""
        return actions.action_client(self, action, self._goal_id)

    def _goal_id(self) -> str:
        return f"{self.world.random.getrandbits(128):032x}"

    def every(self, period_s: float, handler: Callable[[], None]) -> Timer:
        """Call ``handler`` every ``period_s`` seconds, without drift."""
        period = period_ns(period_s)
        return Timer(self, period, period, handler)

    def after(self, delay_s: float, handler: Callable[[], None]) -> Timer:
        """Call ``handler`` once, ``delay_s`` seconds from now."""
        return Timer(self, max(0, round(delay_s * 1e9)), 0, handler)

    def post(self, handler: Callable[[], None]) -> None:
        """Run ``handler`` as this node's work; callable from any thread."""
        self.world.enter(self._post, handler)

    def post_step(self, handler: Callable[[], None]) -> None:
        """Run ``handler`` as this node's work once no message is due (in a world that ranks)."""
        self.world.schedule(0, self._posted, handler, Rank.STEP)

    def _post(self, handler: Callable[[], None]) -> None:
        self.world.schedule(0, self._posted, handler)

    def _posted(self, handler: Callable[[], None]) -> None:
        self.work(_call, handler)

    def completion(self) -> Completion:
        """A fresh completion; waiting for it runs the world."""
        return Completion(self.world)

    def tick_complete(self) -> None:
        """Nothing to do: taps receive everything at once, and take no time."""

    def wait_for_nodes(self, names: Sequence[str], timeout_s: float) -> Sequence[str]:
        """Run the world until all ``names`` are up; returns those still missing at the end."""

        def missing() -> list[str]:
            there = self.view.names()
            return [name for name in names if name not in there]

        self.world.run_until(lambda: not missing(), timeout_s)
        return missing()

    @property
    def is_announced(self) -> bool:
        """Whether this node counts as up."""
        return self._announced

    def watch_nodes(self, handler: Callable[[str, bool], None]) -> None:
        """``handler(name, up)`` whenever a node announces itself or goes away."""
        self.view.watch(handler)

    def up_since(self, name: str) -> int:
        """When ``name`` joined the world (ns, on its clock); 0 if it is not up, to this node."""
        return self.view.up_since(name)

    def announce(self) -> None:
        """Say that this node has declared everything and is ready."""
        if not self._announced:
            self._announced = True
            self.world.presence.announced(self)

    def tap(self, channels: Sequence[str], handler: Callable[[Observation], None]) -> Tap:
        """Receive everything on channels that match one of the globs (empty: all), passively."""
        tap = Tap(self, channels, handler)
        self._own_taps.append(tap)
        return tap

    def spin(self, until: Callable[[], bool] | None = None) -> None:
        """Run the world on the calling thread until ``close()`` (or until ``until()`` holds)."""
        world = self.world

        def over() -> bool:
            return not self.alive or (until is not None and until())

        while not over():
            if world.idle():
                world.wait_for_threads()
            world.run_until(lambda: over() or world.idle(), _FOREVER_S)

    def close(self) -> None:
        """Leave the world; idempotent, from any thread."""
        self.world.enter(lambda _: self.vanish(), None)

    def vanish(self, killed: bool = False) -> None:
        """Be gone: nothing arrives here any more, and who called this node gets an error.

        Args:
            killed: without a word.
        """
        if not self.alive:
            return
        for other in self._beside:
            other.vanish(killed)
        self.alive = False
        del self.world.nodes[self._node]
        for tap in self._own_taps:
            tap.close()
        for channel, subscription in self._subscriptions:
            self.routes.subscriptions(channel).remove(subscription)
        for channel, server in self._servers.items():
            self.routes.servers(channel).remove(server)
            server.vanish()
        for client in self._clients:
            client.close()
        for publishers in self.routes.transient_local.values():
            for publisher in [one for one in publishers if one.node is self]:
                del publishers[publisher]
        if self._announced:
            self.world.presence.left(self, killed)


_ROS2_REPAIR_S = 3.2
"""As ``transports.ros2`` says of Fast DDS."""
_FOREVER_S = 3600.0 * 24 * 365 * 100


def _call(handler: Callable[[], None]) -> None:
    handler()


def _check_name(channel: str) -> None:
    if not channel.startswith("/") or "" in channel[1:].split("/"):
        raise TransportError(
            f"channel {channel!r} must be absolute, like /a/b, and without empty parts"
        )
