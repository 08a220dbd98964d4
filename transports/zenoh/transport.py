"""One node's connection to Zenoh: the transport interface, made of the parts beside this file.

The nodes of one process may share what costs: the session, and what leaves it together (``Shared``).
"""

# zenoh's stubs leave the results of some methods open
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import contextlib
import itertools
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import zenoh

from transports.interface import (
    Observation,
    Service,
    Topic,
    TransportError,
)
from transports.on_executor import OnExecutor
from transports.refusals import Refusals
from transports.service_events import TAKEN_SUFFIX
from transports.zenoh import answers, presence, tokens, topics
from transports.zenoh.idle import IdleTaps
from transports.zenoh.introspection import Events
from transports.zenoh.names import key_of
from transports.zenoh.namespaces import NamespaceWatch, Within
from transports.zenoh.orders import Orders
from transports.zenoh.permissions import Permissions, permissions_for
from transports.zenoh.services import Client, Request, Server
from transports.zenoh.shared import Shared
from transports.zenoh.tap import Listener, Tap
from transports.zenoh_link.executor import Executor
from transports.zenoh_link.log import LOG
from transports.zenoh_link.session import open_session


def connect(node: str, options: Mapping[str, str]) -> ZenohTransport:
    """Open ``node``'s connection; for ``options`` see ``transports.zenoh_link.session``.

    Raises:
        TransportError: an option is unknown or wrong, or an endpoint cannot be reached.
    """
    if not node:
        raise TransportError("a node needs a name")
    since_ns = time.time_ns()  # before: whoever listens by then is linked when the session is open
    asked = {"identity": node, **options}
    return ZenohTransport(node, open_session(asked), since_ns, permissions=permissions_for(asked))


class ZenohTransport(OnExecutor):
    """A node on Zenoh; see ``transports.interface.Transport`` for every method."""

    _executor: Executor
    reports_takes: bool = True

    def __init__(
        self,
        node: str,
        session: zenoh.Session,
        since_ns: int = 0,
        shared: Shared | None = None,
        permissions: Permissions | None = None,
    ) -> None:
        super().__init__(node, Executor())
        self._since_ns = since_ns
        self._known: dict[str, tokens.NodeToken] = {}
        self._node_bytes = node.encode()
        self._session = session
        self._permissions = permissions
        self._refusals = Refusals(LOG)
        self._owns_session = shared is None
        self._shared = shared or Shared(session, self._executor, self._refusals)
        self._calls = itertools.count(1)
        self._orders = Orders(session.new_timestamp)
        self._sequences: dict[str, topics.Sequence] = {}
        self._events: dict[str, Events] = {}
        self._event_numbers: dict[str, itertools.count[int]] = {}
        self._servers: set[str] = set()
        self._clients: list[Client] = []
        self._taps: list[Tap] = []
        self._namespaces: dict[Within, None] = {}
        self._idle = IdleTaps()
        self._declared: list[Any] = []
        self._answering: Any = None
        self._shared.enter(node)
        self._close_at_exit()

    @contextlib.contextmanager
    def _declaring(self) -> Iterator[None]:
        """TransportError instead of what Zenoh says to a node that is closed, or closes on another thread."""
        self._require_open()
        try:
            yield
        except zenoh.ZError:
            self._require_open()
            raise

    def now_ns(self) -> int:
        """The system's clock, ns since the epoch."""
        return time.time_ns()

    def publisher(self, topic: Topic) -> topics.Publisher:
        """Declare a publisher."""
        sequence = self._sequences.setdefault(topic.name, topics.Sequence())
        with self._declaring():
            publisher = topics.Publisher(
                self._session, topic, self._node_bytes, sequence, self._orders
            )
        self._declared.append(publisher.declared)
        return publisher

    def subscribe(self, topic: Topic, handler: Callable[[Any], None]) -> None:
        """Call ``handler(message)`` for every message."""
        allowed = self._permissions
        with self._declaring():
            subscription = topics.subscribe(
                self._session,
                self._executor,
                topic,
                handler,
                self._events_of(topic),
                self._refusals,
                None if allowed is None else allowed.publishers(key_of(topic.name)),
            )
        self._declared.append(subscription)

    def serve(self, service: Service, handler: Callable[[Request], None]) -> None:
        """Serve ``service``; a second server of it, here or in another node, is reported."""
        if service.name in self._servers:
            raise TransportError(f"{service.name} is served by {self._node} already")
        self._servers.add(service.name)
        allowed = self._permissions
        with self._declaring():
            server = Server(
                self._session,
                self._executor,
                service,
                self._events_of(service, is_server=True),
                handler,
                self._refusals,
                None if allowed is None else allowed.callers(key_of(service.name)),
            )
            token = presence.ServerToken(
                self._session, self._executor, self._node, service.name, self._refusals
            )
        self._declared += [server, token]

    def client(self, service: Service) -> Client:
        """A client of ``service``."""
        with self._declaring():
            client = Client(
                self._session,
                self._executor,
                service,
                self._events_of(service),
                self._node,
                self._calls,
                self._refusals,
            )
        self._clients.append(client)
        return client

    def wait_for_nodes(self, names: Sequence[str], timeout_s: float) -> Sequence[str]:
        """Wait until all ``names`` are up; returns those still missing at the end."""
        with self._declaring():
            return presence.wait_for_nodes(self._session, names, timeout_s, self._refusals)

    def watch_nodes(self, handler: Callable[[str, bool], None]) -> None:
        """``handler(name, up)`` whenever a node announces itself or goes away."""
        with self._declaring():
            watch = presence.watch_nodes(
                self._session, self._executor, self._known, handler, self._refusals
            )
        self._declared.append(watch)

    def up_since(self, name: str) -> int:
        """When ``name``, which is being watched, began to connect (ns); 0 if not known."""
        token = self._known.get(name)
        return 0 if token is None else token.since_ns

    def clock_of(self, name: str) -> str:
        """See ``TellsClocks.clock_of``."""
        return presence.clock_of(self._known, name)

    def announce(self) -> None:
        """Say that this node has declared everything and is ready."""
        if self._answering is not None:
            return
        with self._declaring():
            self._answering = answers.answer(
                self._session, self._node, self._orders, self._shared.outbox.flush
            )
            self._shared.announcements.add(self._node, self._since_ns)

    def tick_complete(self) -> None:
        """Have all nodes report to their taps what they keep for them, those of this process last."""
        self._shared.tick_complete()

    def tap(self, channels: Sequence[str], handler: Callable[[Observation], None]) -> Tap:
        """Receive everything on channels that match one of the globs (empty: all), passively."""
        listener = Listener(self._session, self._executor, self._node, self._permissions)
        with self._declaring():
            tap = Tap(listener, channels, handler, self._refusals)
        self._taps.append(tap)
        return tap

    def _beside(self, node: str) -> ZenohTransport:
        return ZenohTransport(node, self._session, time.time_ns(), self._shared, self._permissions)

    def watch_namespaces(self, pattern: str, handler: Callable[[str, bool], None]) -> None:
        """See ``transports.interface.Namespaces``."""
        with self._declaring():
            watch = NamespaceWatch(
                self._session, self._executor, pattern, handler, self._refusals, self._idle
            )
        self._declared.append(watch)

    def within(self, namespace: str, failed: Callable[[Exception], None]) -> Within:
        """See ``transports.interface.Namespaces``."""
        listener = Listener(
            self._session, self._executor, self._node, self._permissions, self._idle
        )
        opened = Within(listener, self._executor, namespace, failed, self._namespaces.pop)
        self._namespaces[opened] = None
        return opened

    def _release(self) -> None:
        for client in self._clients:
            client.close()
        for tap in self._taps:
            tap.close()
        for within in tuple(self._namespaces):
            within.close()
        self._idle.close()
        if self._answering is not None:
            self._shared.announcements.remove(self._node)
            self._answering.undeclare()  # what is done from now on is not reported
        self._shared.outbox.flush()
        if self._owns_session:
            self._shared.close()
        for declared in (*self._declared, *self._events.values()):
            # "Already borrowed": another thread publishes with it just now; it goes with the session
            with contextlib.suppress(RuntimeError):
                declared.undeclare()
        self._shared.leave(self._node)
        if self._owns_session:
            self._session.close()

    def _events_of(self, channel: Service | Topic, is_server: bool = False) -> Events:
        counted = channel.name + ("" if isinstance(channel, Service) else TAKEN_SUFFIX)
        place = counted + ("" if is_server else f" {self._node}")
        events = self._events.get(place)
        if events is None:
            self._shared.listen_for_rounds()
            events = self._events[place] = Events(
                self._session,
                self._shared.outbox,
                channel,
                self._node,
                is_server,
                self._orders,
                self._event_numbers.setdefault(counted, itertools.count()),
            )
        return events
