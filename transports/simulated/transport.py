"""One node in a simulated world: the transport interface on virtual time."""

from __future__ import annotations

import functools
import itertools
import logging
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from transports import actions
from transports.interface import (
    Action,
    ActionClient,
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
from transports.simulated.routes import Sent, Tap
from transports.simulated.services import Client, Request, Server
from transports.simulated.world import Completion, Rank, SimulatedWorld, world_called
from transports.timers import period_ns

LOG = logging.getLogger("transports.simulated")


def connect(node: str, options: Mapping[str, str]) -> SimulatedTransport:
    """A node in the world that the option ``world`` names (default ``default``), in this process.

    Raises:
        TransportError: an option is unknown or wrong, or the world has a node of that name.
    """
    others = {name: value for name, value in options.items() if name != "world"}
    return SimulatedTransport(world_called(options.get("world", "default"), others), node)


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
        if self._handler is None or not self._node.alive:
            return
        if self._period_ns:
            self._node.world.schedule(self._period_ns, self._fire, None, Rank.TIMER)
        self._node.work(self._run, None)

    def _run(self, _: object) -> None:
        if self._handler is not None:
            self._handler()


class Publisher:
    """Publishes one topic."""

    def __init__(self, node: SimulatedTransport, topic: Topic) -> None:
        self._node = node
        self._topic = topic
        self._codec = TypedCodec(topic.type_name, topic.message)
        self._lossy = topic.reliability is Reliability.BEST_EFFORT

    def publish(self, message: Message) -> None:
        """Send ``message`` to every subscriber and tap."""
        payload = self._codec.encode(message)
        node, topic = self._node, self._topic
        if not node.alive:
            raise TransportError(f"cannot publish on {topic.name}: {node.node} is closed")
        world = node.world
        sent = Sent(node.node, node.routes.number(node.node, topic.name), topic.type_name, payload)
        for subscription in node.routes.subscriptions(topic.name):
            copies = world.copies(world.conditions.loss) if self._lossy else 1
            for _ in range(copies):
                subscription.send(sent)
        if topic.transient_local:
            node.routes.transient_local.setdefault(topic.name, {})[node.node] = sent
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

    def send(self, message: Sent) -> None:
        """Let a message be under way to here."""
        link = (message.source, self._topic.name, self._node.node)
        self._node.world.send(link, self._arrive, message)

    def _arrive(self, message: Sent) -> None:
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


class SimulatedTransport:
    """A node in a simulated world; see ``transports.interface.Transport`` for every method.

    ``spin`` runs the whole world, so one thread drives any number of nodes.
    """

    repair_s: float = 0.0
    reports_takes: bool = True

    def __init__(self, world: SimulatedWorld, node: str) -> None:
        if not node:
            raise TransportError("a node needs a name")
        if node in world.nodes:
            raise TransportError(f"two nodes are named {node} in this world")
        self.world = world
        self.routes = world.routes
        self.alive = True
        self.refusals = Refusals(LOG)
        self._node = node
        self._calls = itertools.count(1)
        self._subscriptions: list[tuple[str, Subscription]] = []
        self._servers: dict[str, Server] = {}
        self._clients: list[Client] = []
        self._own_taps: list[Tap] = []
        self._beside: list[SimulatedTransport] = []
        self._announced = False
        self._watching: list[Callable[[str, bool], None]] = []
        self._free_ns = 0
        self._since_ns = world.now_ns
        world.nodes[node] = self

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
        """The virtual clock, ns since the epoch."""
        return self.world.now_ns

    def work(self, handler: Callable[[Any], None], argument: Any) -> None:
        """Run ``handler(argument)`` as this node's next piece of work, when it has time for it."""
        world = self.world
        start = max(world.now_ns, self._free_ns)
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
            for message in self.routes.transient_local.get(topic.name, {}).values():
                subscription.send(message)

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
        client = Client(self, service, self._calls)
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
            nodes = self.world.nodes
            return [n for n in names if n not in nodes or not nodes[n].is_announced]

        self.world.run_until(lambda: not missing(), timeout_s)
        return missing()

    @property
    def is_announced(self) -> bool:
        """Whether this node counts as up."""
        return self._announced

    def watch_nodes(self, handler: Callable[[str, bool], None]) -> None:
        """``handler(name, up)`` whenever a node announces itself or goes away."""
        self._watching.append(handler)
        for name, node in self.world.nodes.items():
            if node.is_announced:
                self.post(functools.partial(handler, name, True))

    def up_since(self, name: str) -> int:
        """When ``name`` joined the world (ns); 0 if it is not up."""
        node = self.world.nodes.get(name)
        return node._since_ns if node is not None and node.is_announced else 0

    def announce(self) -> None:
        """Say that this node has declared everything and is ready."""
        if not self._announced:
            self._announced = True
            self._report_to_watchers(True)

    def _report_to_watchers(self, up: bool) -> None:
        for other in tuple(self.world.nodes.values()):
            for handler in other._watching:
                other.post(functools.partial(handler, self._node, up))

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

    def vanish(self) -> None:
        """Be gone: nothing arrives here any more, and who called this node gets an error."""
        if not self.alive:
            return
        for other in self._beside:
            other.vanish()
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
            publishers.pop(self._node, None)
        if self._announced:
            self._report_to_watchers(False)


_FOREVER_S = 3600.0 * 24 * 365 * 100


def _call(handler: Callable[[], None]) -> None:
    handler()


def _check_name(channel: str) -> None:
    if not channel.startswith("/") or "" in channel[1:].split("/"):
        raise TransportError(
            f"channel {channel!r} must be absolute, like /a/b, and without empty parts"
        )
