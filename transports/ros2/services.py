"""Services: requests and responses taken from rcl as they come, so that an answer can wait.

Both ends publish service events with contents, as service introspection does.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any, NamedTuple

from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

from transports import calls
from transports import service_events as event
from transports.interface import CallOutcome, CallResult, Message, Service, TransportError
from transports.refusals import Refusals
from transports.ros2 import endpoints, native, qos
from transports.ros2.call_errors import CallErrors
from transports.ros2.executor import Executor
from transports.ros2.graph import Graph
from transports.ros2.interfaces import ros_class
from transports.ros2.introspection import FLUSH_DELAY_S, ServiceEvents
from transports.ros2.messages import Codec
from transports.ros2.requests import RequestId, Requests
from transports.ros_forms import CallError
from transports.timers import Timer

LOOK_S = 4.0
"""How long a node looks for servers from its first call on; after that, a call is unavailable at once.

Two participants that missed each other's first announcements meet by Fast DDS's next one, 3 s later.
"""


class Look:
    """How long the clients of a node look for their servers."""

    def __init__(self) -> None:
        self._until_s: float | None = None

    def left_s(self) -> float:
        """What is left of it, in seconds; it begins when this is asked first."""
        now_s = time.monotonic()
        if self._until_s is None:
            self._until_s = now_s + LOOK_S
        return max(self._until_s - now_s, 0.0)


class OfNode(NamedTuple):
    """What the servers and clients of a node have in common.

    Attributes:
        node: the ``rclpy.node.Node``.
        executor: where their handlers run.
        graph: who is connected.
        errors: where it is told how calls ended without a response.
        look: how long clients look for their servers.
        refusals: where what cannot be decoded is counted.
    """

    node: Any
    executor: Executor
    graph: Graph
    errors: CallErrors
    look: Look
    refusals: Refusals


class Server:
    """Serves one service, called ``name`` on ROS 2."""

    def __init__(
        self,
        of_node: OfNode,
        events: ServiceEvents,
        name: str,
        service: Service,
        handler: Callable[[Request], None],
    ) -> None:
        node, executor = of_node.node, of_node.executor
        self._refusals = of_node.refusals
        self.name = name
        self.type_name = service.type_name
        self.node = node.get_name()
        self.graph = of_node.graph
        self.errors = of_node.errors
        self.events = events
        self.response = Codec(calls.response_type(service), service.response)
        self._request = Codec(calls.request_type(service), service.request)
        self._handler = handler
        profile = qos.profile(reliable=True, transient_local=False, depth=qos.DEPTH)
        try:
            self.declared = node.create_service(
                ros_class(service.type_name), name, _never, qos_profile=profile
            )
        except (_rclpy.RCLError, ValueError) as error:
            text = " ".join(str(error).split())
            raise TransportError(f"cannot serve {name} ({service.type_name}): {text}") from error
        self.requests = Requests(self.declared.handle, self._request.ros, self.response.ros)
        executor.handle(self.declared, self._take)

    def _take(self) -> bool:
        try:
            taken = self.requests.take()
        except TransportError as error:
            self._refusals.refuse(self.name, "", error)
            return True
        if taken is None:
            return False
        (request_id, request), events = taken, self.events
        if stamp_ns := events.stamp():
            gid, call = request_id.gid, request_id.call
            events.record(event.REQUEST_RECEIVED, stamp_ns, gid, call, request)
        self._handler(Request(self, request_id, self._request.decode(request)))
        if stamp_ns:
            events.flush_later()  # mostly it is answered by now, and nobody waits
        return True


def _never(request: Any, response: Any) -> Any:
    raise AssertionError("requests are taken by this transport's own executor")


class Request:
    """A request that this node serves."""

    __slots__ = ("_id", "_open", "_server", "data")

    def __init__(self, server: Server, request_id: RequestId, data: Any) -> None:
        self._server = server
        self._id = request_id
        self._open = True
        self.data = data

    @property
    def client(self) -> str:
        """Who asks (node name); empty if the graph does not show it yet."""
        return self._server.graph.client_of(self._server.name, self._id.gid)

    def respond(self, response: Message) -> None:
        """Answer; TransportError if it is answered already."""
        server, request_id = self._server, self._id
        encoded = server.response.encode(response)
        self._take()
        stamp_ns = server.events.stamp()
        try:
            server.requests.answer(request_id, encoded)
        except (TransportError, _rclpy.InvalidHandle) as error:
            raise TransportError(f"cannot answer {server.name}: {error}") from error
        if stamp_ns:
            gid, call = request_id.gid, request_id.call
            server.events.record(event.RESPONSE_SENT, stamp_ns, gid, call, encoded)
            server.events.flush_later()

    def fail(self, error: str) -> None:
        """End the call with a remote error; TransportError if it is answered already."""
        server = self._server
        self._take()
        server.errors.publish(
            CallError(
                service=server.name,
                type_name=server.type_name,
                by_server=True,
                client=self.client,
                gid=self._id.gid.hex(),
                call=self._id.call,
                error=calls.end_of(calls.refused(error)),
                node=server.node,
                stamp_ns=time.time_ns(),
            )
        )

    def _take(self) -> None:
        if not self._open:
            raise calls.answered_already(self._id.call, self.client, self._server.name)
        self._open = False


class _Call:
    """One call on its way; whoever takes it from its client's table ends it."""

    __slots__ = ("done", "number", "request", "servers", "stamp_ns", "timer")

    def __init__(self, request: Any, done: Callable[[CallResult], None], stamp_ns: int) -> None:
        self.request = request
        self.done = done
        self.stamp_ns = stamp_ns
        """When its node made it, which may be before there is a server to send it to; 0 if nobody listens."""
        self.number = 0
        self.servers: frozenset[bytes] = frozenset()
        """Those that were there as it was sent."""
        self.timer: Timer | None = None


class Client:
    """Calls one service. One per service and node: calls are numbered by it."""

    def __init__(self, of_node: OfNode, events: ServiceEvents, name: str, service: Service) -> None:
        node, executor, errors = of_node.node, of_node.executor, of_node.errors
        self._refusals = of_node.refusals
        self._node = node
        self._executor = executor
        self._errors = errors
        self._events = events
        self.name = name
        self.type_name = service.type_name
        self._request = Codec(calls.request_type(service), service.request)
        self._response = Codec(calls.response_type(service), service.response)
        profile = qos.profile(reliable=True, transient_local=False, depth=qos.DEPTH)
        try:
            self.declared = node.create_client(
                ros_class(service.type_name), name, qos_profile=profile
            )
        except (_rclpy.RCLError, ValueError) as error:
            text = " ".join(str(error).split())
            raise TransportError(f"cannot call {name} ({service.type_name}): {text}") from error
        self._handle = self.declared.handle
        self._gid = native.gid_of_client(self._handle)
        self._known_as = {gid.hex() for gid in endpoints.of_client(node, self._handle, name)}
        self._look = of_node.look
        self._had_server = False
        self._servers: frozenset[bytes] | None = None
        """Who serves; None: it is to be asked, as the graph has changed."""
        self._lock = threading.Lock()
        self._sent: dict[int, _Call] = {}
        self._held: list[_Call] = []
        self._closed = False
        errors.listen(name, self._failed)
        executor.handle(self.declared, self._take)

    # The interface.

    def call(
        self, request: Message, done: Callable[[CallResult], None], timeout_s: float = 5.0
    ) -> None:
        """Send ``request``; ``done`` gets the result on the executor thread, exactly once."""
        if self._closed:
            raise TransportError(f"cannot call {self.name}: this node is closed")
        call = _Call(self._request.encode(request), done, self._events.stamp())
        call.timer = self._executor.after_real(timeout_s, lambda: self._timed_out(call))
        if not self._start(call):
            self._executor.post(lambda: self._end_unserved(call))

    def call_and_wait(self, request: Message, timeout_s: float = 5.0) -> CallResult:
        """Send ``request`` and wait, on a thread that is not the executor's."""
        if self._executor.is_current():
            calls.refuse_to_wait(self.name)
        deadline = time.monotonic() + timeout_s
        ended = threading.Event()
        results: list[CallResult] = []

        def done(result: CallResult) -> None:
            results.append(result)
            ended.set()

        call = _Call(self._request.encode(request), done, self._events.stamp())
        if not self._start(call):
            self._end_unserved(call)
        if timeout_s > FLUSH_DELAY_S and not ended.wait(FLUSH_DELAY_S):
            self._events.flush()  # a call that takes its time: say that it is under way
        if not ended.wait(max(deadline - time.monotonic(), 0.0)):
            self._timed_out(call)
            ended.wait()  # if not by this, then by what was ending it at the same moment
        return results[0]

    # What happens to calls.

    def _start(self, call: _Call) -> bool:
        """Send ``call``, or hold it until a server is there; False if it is to be ended."""
        with self._lock:
            if self._closed:
                return False
            if self._has_server():
                self._send(call)
                return True
            if (left_s := self._left_to_look_s()) or self._node.count_services(self.name):
                self._held.append(call)
                self._executor.after_real(left_s, self.graph_changed)
                return True
            self._send_to_nobody(call)
        return False

    def _has_server(self) -> bool:
        is_there = bool(self._handle.service_server_is_available())
        self._had_server |= is_there
        return is_there

    def _left_to_look_s(self) -> float:
        return 0.0 if self._had_server else self._look.left_s()

    def _send(self, call: _Call) -> None:
        try:
            call.number = self._handle.send_request(call.request)
        except (_rclpy.RCLError, _rclpy.InvalidHandle) as error:
            raise TransportError(f"cannot call {self.name}: {error}") from error
        self._sent[call.number] = call
        if self._servers is None:
            self._servers = endpoints.of_servers(self._node, self.name)
        call.servers = self._servers
        if call.stamp_ns:
            self._events.record(
                event.REQUEST_SENT, call.stamp_ns, self._gid, call.number, call.request
            )
            self._events.flush_later()

    def _send_to_nobody(self, call: _Call) -> None:
        """So a tap learns of a call that nobody serves."""
        self._send(call)
        del self._sent[call.number]

    def _take(self) -> bool:
        with self._lock:
            try:
                header, response = self._handle.take_response(self._response.ros)
            except _rclpy.RCLError as error:
                self._refusals.refuse(self.name, "its server", error)
                return True
            if header is None:
                return False
            number = header.request_id.sequence_number
            call = self._sent.pop(number, None)
        if stamp_ns := self._events.stamp():
            self._events.record(event.RESPONSE_RECEIVED, stamp_ns, self._gid, number, response)
        if call is not None:
            self._end(call, CallResult(CallOutcome.RESPONSE, self._response.decode(response)))
        if stamp_ns:
            self._events.flush_later()
        return True

    def _failed(self, error: CallError) -> None:
        """A server says that it failed a call, perhaps one of this client."""
        if error.gid not in self._known_as:
            return
        with self._lock:
            call = self._sent.pop(error.call, None)
        if call is not None:
            self._end(call, calls.refused(calls.reason_of(error.error)))

    def _timed_out(self, call: _Call) -> None:
        with self._lock:
            if call in self._held:
                self._held.remove(call)
                was_held = True
            elif self._sent.pop(call.number, None) is call:
                was_held = False
            else:
                return
        if was_held:
            self._give_up(call)
            return
        self._end(call, calls.timed_out(self.name))

    def _give_up(self, call: _Call) -> None:
        """Nobody serves, after all."""
        with self._lock:
            if not self._closed:
                self._send_to_nobody(call)
        self._end_unserved(call)

    def _end_unserved(self, call: _Call) -> None:
        self._end(call, calls.unserved(self.name))

    def graph_changed(self) -> None:
        """On the executor: a server may have come or gone."""
        self._servers = None
        if self._closed or not (self._held or self._sent):
            return
        while self._take():  # its last answers, before it is given up
            pass
        lost: list[_Call] = []
        given_up: list[_Call] = []
        with self._lock:
            if self._has_server():
                lost = self._take_lost()
                for call in self._held:
                    self._send(call)
                self._held.clear()
            else:
                lost = list(self._sent.values())
                self._sent.clear()
                if not (self._left_to_look_s() or self._node.count_services(self.name)):
                    given_up = list(self._held)
                    self._held.clear()
        for call in given_up:
            self._give_up(call)
        for call in lost:
            self._end(call, calls.abandoned(self.name))

    def _take_lost(self) -> list[_Call]:
        """The calls whose servers have gone, though others serve now, as after a kill and a restart."""
        self._servers = endpoints.of_servers(self._node, self.name)
        lost = []
        for call in list(self._sent.values()):
            if call.servers and call.servers.isdisjoint(self._servers):
                lost.append(self._sent.pop(call.number))
            elif not call.servers:  # it was sent before its server was in the graph
                call.servers = self._servers
        return lost

    def _end(self, call: _Call, result: CallResult) -> None:
        if call.timer is not None:
            call.timer.cancel()
        if result.outcome is not CallOutcome.RESPONSE and not self._closed:
            self._errors.publish(
                CallError(
                    service=self.name,
                    type_name=self.type_name,
                    by_server=False,
                    client=self._node.get_name(),
                    gid=self._gid.hex(),
                    call=call.number,
                    error=calls.end_of(result),
                    node=self._node.get_name(),
                    stamp_ns=time.time_ns(),
                )
            )
        call.done(result)

    def close(self) -> None:
        """End the calls that threads wait for: the node is about to close."""
        with self._lock:
            self._closed = True
            waiting = [call for call in (*self._sent.values(), *self._held) if call.timer is None]
            self._sent.clear()
            self._held.clear()
        for call in waiting:
            call.done(calls.closed(self.name))
