"""Services in a simulated world: a call is two messages under way, and four observations."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable, Iterable
from typing import Any, Protocol

from transports import calls
from transports.interface import (
    CallOutcome,
    CallResult,
    Message,
    ObservationKind,
    Service,
    TransportError,
)
from transports.payloads import PayloadError, TypedCodec
from transports.simulated.conditions import Conditions, Introspection
from transports.simulated.network import Link
from transports.simulated.parts import Node
from transports.simulated.routes import Routes
from transports.simulated.waiting import Completion

_NOBODY_NS = 1_000_000
"""So long after a call its client knows that nobody serves it (ns): who asks again at once lets time pass."""


class Services:
    """Who serves what in one world."""

    def __init__(self) -> None:
        self._servers: dict[str, list[Server]] = {}
        self._clients: dict[str, list[Client]] = {}

    def clients(self, channel: str) -> list[Client]:
        """Who may call ``channel``."""
        return self._clients.setdefault(channel, [])

    def without_introspection(self, conditions: Conditions) -> set[tuple[str, str]]:
        """Services, each with a node that shows no call; there is a server of that kind, and a client."""

        def silent(channel: str, ends: Iterable[Server | Client]) -> set[tuple[str, str]]:
            return {
                (channel, end.node_name)
                for end in ends
                if conditions.introspection_of(end.node_name, channel) is Introspection.OFF
            }

        found: set[tuple[str, str]] = set()
        for channel, servers in self._servers.items():
            serve, call = silent(channel, servers), silent(channel, self._clients.get(channel, ()))
            found |= serve | call if serve and call else set()
        return found

    def servers(self, channel: str) -> list[Server]:
        """Who serves ``channel``; a call reaches the first."""
        return self._servers.setdefault(channel, [])


class Calling(Node, Protocol):
    """A node with services."""

    routes: Routes
    services: Services


class Call:
    """One call under way; the first thing that ends it counts."""

    __slots__ = ("client", "done", "number", "payload")

    def __init__(
        self,
        client: Client,
        number: int,
        payload: bytes,
        done: Callable[[CallResult], None],
    ) -> None:
        self.client = client
        self.number = number
        self.payload = payload
        self.done: Callable[[CallResult], None] | None = done


class Request:
    """A request that a node serves."""

    __slots__ = ("_answered", "_call", "_server", "client", "data")

    def __init__(self, server: Server, call: Call, data: Any) -> None:
        self._server = server
        self._call = call
        self._answered = False
        self.client = call.client.node_name
        self.data = data

    def respond(self, response: Message) -> None:
        """Answer; TransportError if it is answered already."""
        payload = self._server.response.encode(response)
        self._take()
        self._server.answer(self._call, payload, "")

    def fail(self, error: str) -> None:
        """End the call with a remote error; TransportError if it is answered already."""
        self._take()
        self._server.answer(self._call, None, error)

    def _take(self) -> None:
        if self._answered:
            raise calls.answered_already(self._call.number, self.client, self._server.name)
        self._answered = True


class Server:
    """Serves one service."""

    def __init__(self, node: Calling, service: Service, handler: Callable[[Request], None]) -> None:
        self.node = node
        self._world, self._routes = node.world, node.routes
        self.node_name = node.node
        self.name = service.name
        self.service = service
        self.response = TypedCodec(calls.response_type(service), service.response)
        self._request = TypedCodec(calls.request_type(service), service.request)
        self._handler = handler
        self._open: dict[Call, None] = {}
        self._back: dict[str, Link] = {}
        """To each client that was answered."""

    def arrive(self, call: Call) -> None:
        """A request is here."""
        if not self.node.alive:
            call.client.lose(call, self.node_name)
            return
        self._open[call] = None
        self.node.work(self._handle, call)

    def _handle(self, call: Call) -> None:
        try:
            self._request.require(call.client.request_type)
            data = self._request.decode_bytes(call.payload)
        except PayloadError as error:
            self.node.refusals.refuse(self.name, call.client.node_name, error)
            self.answer(call, None, calls.bad_request(error))
            return
        self._routes.service_event(
            self.node_name,
            self.service,
            ObservationKind.REQUEST_RECEIVED,
            call.payload,
            call.client.node,
            call.number,
        )
        self._handler(Request(self, call, data))

    def answer(self, call: Call, payload: bytes | None, error: str) -> None:
        """Let the end of ``call`` be under way to its client."""
        self._open.pop(call, None)
        self._routes.service_event(
            self.node_name,
            self.service,
            ObservationKind.RESPONSE_SENT,
            payload,
            call.client.node,
            call.number,
            error="" if payload is not None else calls.end_of(calls.refused(error)),
        )
        client = call.client
        link = self._back.get(client.node_name)
        if link is None:
            link = self._back[client.node_name] = self._world.network.link(
                self.node_name, self.name, client.node_name
            )
        self._world.send(link, client.receive, (call, payload, error))

    def vanish(self) -> None:
        """The node is gone: callers whose requests wait here get an error."""
        for call in tuple(self._open):
            call.client.lose(call, self.node_name)
        self._open.clear()


class Client:
    """Calls one service."""

    def __init__(self, node: Calling, service: Service, numbers: itertools.count[int]) -> None:
        self.node = node
        self._world, self._routes = node.world, node.routes
        self._servers = node.services.servers(service.name)
        self._clients = node.services.clients(service.name)
        self._clients.append(self)
        self.node_name = node.node
        self.service = service
        self.request_type = calls.request_type(service)
        self._request = TypedCodec(self.request_type, service.request)
        self._response = TypedCodec(calls.response_type(service), service.response)
        self._numbers = numbers
        self._found: dict[Server, int] = {}
        self._links: dict[Server, Link] = {}
        self._deadlines: deque[tuple[int, int, Call]] = deque()
        """When calls time out, the first one first, and their places among the world's events. Of those that
        come after the first the world knows nothing: nearly all calls have ended by then."""
        self._waiting: dict[Completion, None] = {}
        self._unavailable = calls.unserved(service.name)

    def call(
        self, request: Message, done: Callable[[CallResult], None], timeout_s: float = 5.0
    ) -> None:
        """Send ``request``; ``done`` gets the result as work of this node, exactly once."""
        payload = self._request.encode(request)
        name = self.service.name
        if not self.node.alive:
            raise TransportError(f"cannot call {name}: {self.node_name} is closed")
        call = Call(self, next(self._numbers), payload, done)
        self._routes.service_event(
            self.node_name,
            self.service,
            ObservationKind.REQUEST_SENT,
            payload,
            self.node,
            call.number,
        )
        self._end_in_time(call, timeout_s)
        self._send_once_found(call)

    def _send_once_found(self, call: Call) -> None:
        """Send ``call`` to who serves by the time that this client has found it."""
        servers = self._servers
        if not servers:
            self._world.schedule(_NOBODY_NS, self._end_unavailable, call)
            return
        wait_ns = self._found_ns(servers[0]) - self._world.now_ns
        if wait_ns > 0:
            self._world.schedule(wait_ns, self._send_once_found, call)
        else:
            self._send(servers[0], call)

    def _send(self, server: Server, call: Call) -> None:
        if self.node.alive:
            link = self._links.get(server)
            if link is None:
                link = self._links[server] = self._world.network.link(
                    self.node_name, self.service.name, server.node_name
                )
            self._world.send(link, server.arrive, call)

    def _found_ns(self, server: Server) -> int:
        """When this client has found ``server``."""
        network = self._world.network
        if network.finds_at_once:
            return 0
        found_ns = self._found.get(server)
        if found_ns is None:
            since_ns = max(self.node.connected_ns, server.node.connected_ns)
            found_ns = self._found[server] = since_ns + network.discovery_ns()
        return found_ns

    def call_and_wait(self, request: Message, timeout_s: float = 5.0) -> CallResult:
        """Send ``request`` and run the world until the call has ended."""
        if self._world.running is not None:
            calls.refuse_to_wait(self.service.name)
        waiting = Completion(self._world)
        self._waiting[waiting] = None
        self.call(request, waiting.set, timeout_s)
        # the call's own timer ends it at its time; the margin lets that come first
        result = waiting.wait(timeout_s + 1.0)
        self._waiting.pop(waiting, None)
        return self._unavailable if result is None else result

    def close(self) -> None:
        """End calls that wait: the node is gone."""
        self._clients.remove(self)
        for waiting in self._waiting:
            waiting.set(self._unavailable)

    def lose(self, call: Call, server: str) -> None:
        """The server of ``call`` is gone; that takes as long to receive as an answer."""
        world = self._world
        link = world.network.link(server, f"{self.service.name}/_lost", self.node_name)
        world.send(link, self._end_unavailable, call)

    def receive(self, answer: tuple[Call, bytes | None, str]) -> None:
        """An answer is here."""
        self.node.work(self._take_answer, answer)

    def _take_answer(self, answer: tuple[Call, bytes | None, str]) -> None:
        call, payload, error = answer
        if payload is None:
            self._end(call, calls.refused(error), None)
            return
        try:
            response = self._response.decode_bytes(payload)
        except PayloadError as bad:
            self.node.refusals.refuse(self.service.name, "its server", bad)
            self._end(call, calls.undecodable(self.service.name, bad), None)
            return
        self._end(call, CallResult(CallOutcome.RESPONSE, response), payload)

    def _end_in_time(self, call: Call, timeout_s: float) -> None:
        """Let ``call`` end ``timeout_s`` from now, if it has not by then."""
        world, deadlines = self._world, self._deadlines
        due_ns = world.now_ns + max(0, round(timeout_s * 1e9))
        order = world.next_order()
        if not deadlines:
            world.schedule_at(due_ns, order, self._first_due, None)
        elif due_ns < deadlines[-1][0]:  # sooner than one before it: it does not queue up
            world.schedule_at(due_ns, order, self._time_out, call)
            return
        deadlines.append((due_ns, order, call))

    def _first_due(self, _: object) -> None:
        """The first deadline is over; the next one of a call that goes on is the world's now."""
        deadlines = self._deadlines
        call = deadlines.popleft()[2]
        while deadlines and deadlines[0][2].done is None:
            deadlines.popleft()
        if deadlines:
            due_ns, order, _call = deadlines[0]
            self._world.schedule_at(due_ns, order, self._first_due, None)
        self._time_out(call)

    def _time_out(self, call: Call) -> None:
        if call.done is not None:
            result = calls.timed_out(self.service.name)
            self.node.work(lambda _: self._end(call, result, None), None)

    def _end_unavailable(self, call: Call) -> None:
        self.node.work(lambda _: self._end(call, self._unavailable, None), None)

    def _end(self, call: Call, result: CallResult, payload: bytes | None) -> None:
        done, call.done = call.done, None
        if done is None:
            return
        self._routes.service_event(
            self.node_name,
            self.service,
            ObservationKind.RESPONSE_RECEIVED,
            payload,
            self.node,
            call.number,
            error="" if payload is not None else calls.end_of(result),
        )
        done(result)
