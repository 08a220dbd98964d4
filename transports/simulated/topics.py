"""Topics in a simulated world: a message is under way to each subscriber that its publisher has found."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from transports.interface import Message, Reliability, Topic, TransportError
from transports.payloads import PayloadError, TypedCodec
from transports.simulated.network import Link
from transports.simulated.parts import Node
from transports.simulated.routes import Routes, Sent


class Topics:
    """Who is subscribed to what in one world."""

    def __init__(self) -> None:
        self._subscriptions: dict[str, list[Subscription]] = {}
        self.transient_local: dict[str, dict[Publisher, Sent]] = {}
        """Channel → publisher → its last message."""

    def subscriptions(self, channel: str) -> list[Subscription]:
        """Who is subscribed to ``channel``."""
        return self._subscriptions.setdefault(channel, [])


class Publishing(Node, Protocol):
    """A node with topics."""

    routes: Routes
    topics: Topics


class Publisher:
    """Publishes one topic."""

    def __init__(self, node: Publishing, topic: Topic) -> None:
        self.node = node
        self._world, self._routes = node.world, node.routes
        self._subscriptions = node.topics.subscriptions(topic.name)
        self._name = node.node
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
        number = self._routes.numbers.take(self._name, topic.name)
        stamp_ns = self._world.stamp_of(self._name)
        sent = Sent(self._name, number, topic.type_name, payload, stamp_ns, node.life)
        if topic.transient_local:
            node.topics.transient_local.setdefault(topic.name, {})[self] = sent
        for subscription in self._subscriptions:
            subscription.take(self, sent)
        self._routes.message(sent, topic.name)


class Subscription:
    """One node's interest in one topic."""

    def __init__(self, node: Publishing, topic: Topic, handler: Callable[[Any], None]) -> None:
        self._node = node
        self._topic = topic
        self._codec = TypedCodec(topic.type_name, topic.message)
        self._handler = handler
        self._declared_ns = node.world.now_ns
        self._found: dict[Publisher, int] = {}
        """When this and each publisher have found each other (ns)."""
        self._links: dict[Publisher, Link] = {}
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
        last = self._node.topics.transient_local.get(self._topic.name, {}).get(publisher)
        if last is not None and self._last.get(publisher) != last.number:
            self._send(publisher, last)

    def _send(self, publisher: Publisher, message: Sent) -> None:
        self._last[publisher] = message.number
        world = self._node.world
        link = self._links.get(publisher)
        if link is None:
            link = self._links[publisher] = world.network.link(
                message.source, self._topic.name, self._node.node
            )
        world.send(link, self._arrive, message, is_lossy=publisher.is_lossy)

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
