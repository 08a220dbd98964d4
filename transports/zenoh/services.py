"""Services: a queryable at the server, a get at the client.

Any Zenoh tool can call a service: the request is the query's payload, the response the reply's.
A remote error is an error reply. The server drops the query after its answer, which closes the caller's
channel. If the channel closes without an answer, no node serves, or the server has ended.
"""

# zenoh's stubs leave the results of some methods open
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import contextlib
import itertools
import threading
import time
from collections.abc import Callable, Container
from queue import Empty
from typing import Any

import msgspec
import zenoh

from transports import calls
from transports import service_events as event
from transports.interface import CallOutcome, CallResult, Message, Service, TransportError
from transports.outbox import CALLER_S
from transports.payloads import PayloadError
from transports.refusals import Refusals
from transports.timers import Timer
from transports.work_queue import WorkQueue
from transports.zenoh.introspection import Events
from transports.zenoh.names import key_of
from transports.zenoh.orders import Moment
from transports.zenoh.wire import UNKNOWN, Codec, attachment, contents, life_of, read_attachment
from transports.zenoh_link.executor import Executor

MOST_WAITING = 10_000
MOST_WAITING_BYTES = 64 * 1024 * 1024
"""Requests of one service that wait for the executor: seconds of the fastest caller. Who asks beyond that is
answered at once, with an error."""

MOST_ERROR = 10_000
"""Characters that are kept of the error that another reports: it stands in events, logs and recordings."""

_GRACE_S = 1.0
"""Zenoh's own time limit comes this much after ours: it only frees what a lost call holds."""


class ServiceCodec(msgspec.Struct, frozen=True):
    """How the messages of one service are encoded."""

    request: Codec
    response: Codec


def codec_of(service: Service) -> ServiceCodec:
    """The codec of ``service``."""
    return ServiceCodec(
        Codec(calls.request_type(service), service.request),
        Codec(calls.response_type(service), service.response),
    )


class Request:
    """A request that this node serves."""

    __slots__ = ("_call", "_life", "_query", "_server", "client", "data")

    def __init__(
        self, server: Server, query: zenoh.Query, call: int, life: int, client: str, data: Any
    ) -> None:
        self._server = server
        self._query: zenoh.Query | None = query
        self._call = call
        self._life = life
        self.client = client
        self.data = data

    def respond(self, response: Message) -> None:
        """Answer; TransportError if it is answered already."""
        server = self._server
        payload = server.codec.response.encode(response)
        query = self._take()
        events = server.events
        moment = events.moment() if events.is_tapped else events.skip()
        try:
            query.reply(server.key, payload, encoding=server.codec.response.encoding)
            query.drop()
        except zenoh.ZError as error:
            events.forget(moment)
            raise TransportError(f"cannot answer {server.name}: {error}") from error
        if moment is not None:
            self._record(moment, payload, "")

    def fail(self, error: str) -> None:
        """End the call with a remote error; TransportError if it is answered already."""
        server = self._server
        query = self._take()
        events = server.events
        moment = events.moment() if events.is_tapped else events.skip()
        try:
            query.reply_err(error.encode(), encoding=zenoh.Encoding.TEXT_PLAIN)
            query.drop()
        except zenoh.ZError as cause:
            events.forget(moment)
            raise TransportError(f"cannot answer {server.name}: {cause}") from cause
        if moment is not None:
            self._record(moment, None, calls.end_of(calls.refused(error)))

    def _record(self, moment: Moment, payload: bytes | None, error: str) -> None:
        events = self._server.events
        call = self.client, self._call, self._life
        events.record(event.RESPONSE_SENT, moment, call, None, payload, error)
        events.flush_later()

    def _take(self) -> zenoh.Query:
        query = self._query
        if query is None:
            raise calls.answered_already(self._call, self.client, self._server.name)
        self._query = None
        if not self._server.closed(query):
            raise TransportError(f"cannot answer {self._server.name}: this node serves it no more")
        return query


_Arrived = tuple[zenoh.Query, int, zenoh.ZBytes | None, zenoh.ZBytes | None, zenoh.Encoding | None]
"""A request, its size in bytes, its payload, what is attached to it and the payload's encoding."""


class Server:
    """Serves one service."""

    def __init__(
        self,
        session: zenoh.Session,
        executor: Executor,
        service: Service,
        events: Events,
        handler: Callable[[Request], None],
        refusals: Refusals,
        callers: Container[str] | None = None,
    ) -> None:
        self.name = service.name
        self.key = key_of(service.name)
        self.codec = codec_of(service)
        self.events = events
        self._handler = handler
        self._refusals = refusals
        self._callers = callers
        """The names in which a request may come, where that is known; in another, nobody's."""
        self._put = executor.put
        self._lock = threading.Lock()
        self._waiting = self._waiting_bytes = 0
        self._open: dict[int, zenoh.Query] = {}
        """Requests that were not answered, by ``id()``."""
        callback: Any = zenoh.handlers.Callback(self._arrive, indirect=False)
        self.declared = session.declare_queryable(self.key, callback, complete=True)

    def _arrive(self, query: zenoh.Query) -> None:
        """On a thread of Zenoh's: have it received on the executor, if there is room.

        All is read here: once it is in ``_open``, whoever closes this node may drop it at any time, and a
        query that was dropped cannot be read.
        """
        payload, attached, encoding = query.payload, query.attachment, query.encoding
        size = 0 if payload is None else len(payload)
        with self._lock:
            has_room = not self._waiting or (
                self._waiting < MOST_WAITING and self._waiting_bytes + size <= MOST_WAITING_BYTES
            )
            if has_room:
                self._waiting += 1
                self._waiting_bytes += size
        if has_room:
            self._open[id(query)] = query
            self._put((self._receive, (query, size, payload, attached, encoding)))
            return
        why = "more requests wait than there is room for"
        client = read_attachment(attached).node
        self._refusals.refuse(self.name, client, why)
        with contextlib.suppress(zenoh.ZError):  # who asked is gone, or this session
            query.reply_err(f"{self.name}: {why}".encode(), encoding=zenoh.Encoding.TEXT_PLAIN)
        query.drop()

    def closed(self, query: zenoh.Query) -> bool:
        """``query`` is about to be answered, or was dropped: whether it still can be."""
        return self._open.pop(id(query), None) is not None

    def undeclare(self) -> None:
        """Serve no more. Who waits for an answer learns that none comes: the session may live on."""
        self.declared.undeclare()
        while self._open:
            self._open.popitem()[1].drop()

    def _receive(self, arrived: _Arrived) -> None:
        query, size, payload, attached, encoding = arrived
        with self._lock:
            self._waiting -= 1
            self._waiting_bytes -= size
        if id(query) not in self._open:
            return  # it was dropped as this node closed
        events = self.events
        call, life, client = read_attachment(attached)
        if self._callers is not None and client not in self._callers:
            call, life, client = UNKNOWN
        life = max(life, 0)
        request = contents(payload)
        try:
            data = self.codec.request.decode(request, encoding)
        except PayloadError as error:
            self._refusals.refuse(self.name, client, error)
            Request(self, query, call, life, client, None).fail(calls.bad_request(error))
            return
        is_tapped = events.is_tapped
        if is_tapped:
            moment = events.moment()
            events.record(event.REQUEST_RECEIVED, moment, (client, call, life), request)
        else:
            events.skip()
        self._handler(Request(self, query, call, life, client, data))
        if is_tapped:
            events.flush_later()  # mostly it is answered by now, and nobody waits


class _Call:
    """One call on its way: whichever of reply, end of replies and timer comes first ends it."""

    __slots__ = ("client", "done", "number", "timer")

    def __init__(self, client: Client, number: int, done: Callable[[CallResult], None]) -> None:
        self.client = client
        self.number = number
        self.done: Callable[[CallResult], None] | None = done
        self.timer: Timer | None = None

    def replied(self, reply: zenoh.Reply) -> None:
        if self.done is not None:
            self._end(*self.client.result_of(reply))

    def closed(self, _: object) -> None:
        if self.done is not None:
            self._end(self.client.unavailable, None)

    def timed_out(self) -> None:
        if self.done is not None:
            self._end(self.client.timeout, None)

    def _end(self, result: CallResult, payload: bytes | None) -> None:
        done, self.done = self.done, None
        if self.timer is not None:
            self.timer.cancel()
        is_tapped = self.client.note_end(self.number, result, payload)
        if done is not None:
            done(result)
        if is_tapped:
            self.client.events.flush_later()


class _First:
    """Hands on the first reply: whoever answers may go on for ever."""

    __slots__ = ("_put",)

    def __init__(self, put: Callable[[zenoh.Reply], None]) -> None:
        self._put: Callable[[zenoh.Reply], None] | None = put

    def __call__(self, reply: zenoh.Reply) -> None:
        put, self._put = self._put, None
        if put is not None:
            put(reply)


class Client:
    """Calls one service."""

    def __init__(
        self,
        session: zenoh.Session,
        executor: Executor,
        service: Service,
        events: Events,
        node: str,
        numbers: itertools.count[int],
        refusals: Refusals,
    ) -> None:
        self._session = session
        self._refusals = refusals
        self._executor = executor
        self._name = service.name
        self._key = session.declare_keyexpr(key_of(service.name))
        self._codec = codec_of(service)
        self.events = events
        self._node = node
        self._life = life_of(session.info.zid())
        self._node_bytes = node.encode()
        self._numbers = numbers
        self._waiting: set[WorkQueue[zenoh.Reply | None]] = set()
        self.unavailable = calls.unserved(service.name)
        self.timeout = calls.timed_out(service.name)

    def call(
        self, request: Message, done: Callable[[CallResult], None], timeout_s: float = 5.0
    ) -> None:
        """Send ``request``; ``done`` gets the result on the executor thread, exactly once."""
        payload = self._codec.request.encode(request)
        number = next(self._numbers)
        call = _Call(self, number, done)
        put, replied, closed = self._executor.put, call.replied, call.closed
        call.timer = self._executor.after(timeout_s, call.timed_out)
        first = _First(lambda reply: put((replied, reply)))
        self._send(
            number,
            payload,
            timeout_s,
            zenoh.handlers.Callback(first, lambda: put((closed, None)), indirect=False),
        )

    def call_and_wait(self, request: Message, timeout_s: float = 5.0) -> CallResult:
        """Send ``request`` and wait, on the calling thread, without the executor."""
        if self._executor.is_current():
            calls.refuse_to_wait(self._name)
        payload = self._codec.request.encode(request)
        number = next(self._numbers)
        replies: WorkQueue[zenoh.Reply | None] = WorkQueue()
        put = replies.put
        deadline = time.monotonic() + timeout_s
        self._waiting.add(replies)
        try:
            self._send(
                number,
                payload,
                timeout_s,
                zenoh.handlers.Callback(_First(put), lambda: put(None), indirect=False),
                CALLER_S,
            )
            reply = self._first(replies, deadline)
        except Empty:
            result, response = self.timeout, None
        else:
            result, response = (self.unavailable, None) if reply is None else self.result_of(reply)
        finally:
            self._waiting.discard(replies)
        if self.note_end(number, result, response):
            self.events.flush_later(CALLER_S)
        return result

    def close(self) -> None:
        """End calls that wait: the session is about to close."""
        for replies in tuple(self._waiting):
            replies.put(None)

    def _first(self, replies: WorkQueue[zenoh.Reply | None], deadline: float) -> zenoh.Reply | None:
        """The first reply, or None when there is none; Empty after ``deadline`` (monotonic)."""
        wait_s = max(deadline - time.monotonic(), 0.0)
        if self.events.is_tapped and wait_s > CALLER_S:
            try:
                return replies.get(CALLER_S)
            except Empty:  # a call that takes its time: say that it is under way
                self.events.flush()
                wait_s = max(deadline - time.monotonic(), 0.0)
        return replies.get(wait_s)

    def _send(
        self, number: int, payload: bytes, timeout_s: float, handler: Any, delay_s: float = 0.0
    ) -> None:
        events = self.events
        moment = events.moment() if events.is_tapped else events.skip()
        try:
            self._session.get(
                self._key,
                handler,
                timeout=timeout_s + _GRACE_S,
                payload=payload,
                encoding=self._codec.request.encoding,
                attachment=attachment(number, self._life, self._node_bytes),
                consolidation=zenoh.ConsolidationMode.NONE,
            )
        except zenoh.ZError as error:
            events.forget(moment)
            raise TransportError(f"cannot call {self._name}: {error}") from error
        if moment is not None:
            call = self._node, number, self._life
            events.record(event.REQUEST_SENT, moment, call, payload)
            events.flush_later(delay_s)

    def result_of(self, reply: zenoh.Reply) -> tuple[CallResult, bytes | None]:
        """What a reply means, and the encoded response for the service event."""
        sample = reply.ok
        if sample is None:
            error = reply.err
            sent = b"" if error is None else error.payload.to_bytes()[: 4 * MOST_ERROR]
            text = sent.decode(errors="replace")[:MOST_ERROR]
            return calls.refused(text), None
        payload = contents(sample.payload)
        try:
            response = self._codec.response.decode(payload, sample.encoding)
        except PayloadError as error:
            self._refusals.refuse(self._name, "its server", error)
            return calls.undecodable(self._name, error), None
        return CallResult(CallOutcome.RESPONSE, response), payload

    def note_end(self, number: int, result: CallResult, response: bytes | None) -> bool:
        """Record how call ``number`` ended, for those who listen; whether anybody does."""
        events = self.events
        if not events.is_tapped:
            events.skip()
            return False
        call, end = (self._node, number, self._life), calls.end_of(result)
        events.record(event.RESPONSE_RECEIVED, events.moment(), call, None, response, end)
        return True
