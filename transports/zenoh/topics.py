"""Topics: publications and subscriptions."""

from __future__ import annotations

import threading
from collections.abc import Callable, Container
from typing import Any, Protocol

import zenoh
from zenoh import ext

from transports.interface import Message, Reliability, Topic, TransportError
from transports.payloads import PayloadError
from transports.refusals import Refusals
from transports.service_events import MESSAGE_TAKEN
from transports.zenoh.introspection import Events
from transports.zenoh.names import key_of
from transports.zenoh.orders import Orders
from transports.zenoh.wire import UNKNOWN, Codec, attachment, contents, life_of, read_attachment
from transports.zenoh_link.executor import Executor


class _Declared(Protocol):
    def put(self, payload: bytes, *, attachment: bytes) -> None: ...

    def undeclare(self) -> None: ...


class Sequence:
    """Numbers of what one node publishes on one channel, from 0; taken under ``lock`` with the
    publication itself, so that numbers and messages leave in the same order.
    """

    __slots__ = ("lock", "next")

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.next = 0


class Publisher:
    """Publishes one topic.

    Reliable topics wait for room when a link's queue is full (Zenoh closes the link of a reader
    that does not read at all), best-effort ones drop.
    """

    def __init__(
        self,
        session: zenoh.Session,
        topic: Topic,
        node: bytes,
        sequence: Sequence,
        orders: Orders,
    ) -> None:
        self._topic = topic
        self._codec = Codec(topic.type_name, topic.message)
        self._node = node
        self._sequence = sequence
        self._orders = orders
        self.declared = _declare_publisher(session, topic, self._codec)

    def publish(self, message: Message) -> None:
        """Send ``message``; nobody is waited for.

        Raises:
            TransportError: it cannot be sent, as where another thread closes the node just now.
        """
        payload = self._codec.encode(message)
        sequence = self._sequence
        try:
            with sequence.lock:
                number = sequence.next
                sequence.next = number + 1
                _, order = self._orders.begin()
                try:
                    self.declared.put(payload, attachment=attachment(number, order, self._node))
                finally:
                    self._orders.end(order)
        except (zenoh.ZError, RuntimeError) as error:  # RuntimeError: it is being undeclared
            raise TransportError(f"cannot publish on {self._topic.name}: {error}") from error


def _declare_publisher(session: zenoh.Session, topic: Topic, codec: Codec) -> _Declared:
    reliable = topic.reliability is Reliability.RELIABLE
    key = key_of(topic.name)
    congestion = zenoh.CongestionControl.BLOCK if reliable else zenoh.CongestionControl.DROP
    if topic.transient_local:
        transient_local: _Declared = ext.declare_advanced_publisher(
            session,
            key,
            encoding=codec.encoding,
            congestion_control=congestion,
            cache=ext.CacheConfig(max_samples=1),
            publisher_detection=True,
        )
        return transient_local
    plain: _Declared = session.declare_publisher(
        key,
        encoding=codec.encoding,
        congestion_control=congestion,
        reliability=zenoh.Reliability.RELIABLE if reliable else zenoh.Reliability.BEST_EFFORT,
    )
    return plain


def subscribe(
    session: zenoh.Session,
    executor: Executor,
    topic: Topic,
    handler: Callable[[Any], None],
    events: Events,
    refusals: Refusals,
    publishers: Container[str] | None = None,
) -> Any:
    """Call ``handler(message)`` on the executor for every message; what does not decode is
    refused. While a tap listens, ``events`` has each that is taken and has a number. Returns what must be
    undeclared.

    ``publishers``: the names in which a message may come, where that is known.
    """
    codec = Codec(topic.type_name, topic.message)

    def receive(sample: zenoh.Sample) -> None:
        try:
            message = codec.decode(contents(sample.payload), sample.encoding)
        except PayloadError as error:
            refusals.refuse(topic.name, read_attachment(sample.attachment).node, error)
            return
        number, _, source = read_attachment(sample.attachment) if events.is_tapped else UNKNOWN
        if not source or (publishers is not None and source not in publishers):
            events.skip()
            handler(message)
            return
        stamp = sample.timestamp
        life = 0 if stamp is None else life_of(stamp.get_id())
        events.record(MESSAGE_TAKEN, events.moment(), (source, number, life), None)
        handler(message)
        events.flush_later()  # mostly all that comes of it is done by now

    offer = executor.inbox(topic.name, receive).offer
    callback: Any = zenoh.handlers.Callback(
        lambda sample: offer(sample, len(sample.payload)), indirect=False
    )
    if topic.transient_local:
        return ext.declare_advanced_subscriber(
            session,
            key_of(topic.name),
            callback,
            history=ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
        )
    return session.declare_subscriber(key_of(topic.name), callback)
