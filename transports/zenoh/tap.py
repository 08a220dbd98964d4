"""The tap: hears everything by wildcard subscribers, and holds nobody up.

Zenoh writes what arrives into a ring of its own (no Python, no lock that Python holds), from which
one thread takes batches for the executor. When the reader is slow, the ring overwrites
its oldest entries: nodes never notice, and the gaps in the sequence numbers tell how many were
missed.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from queue import Empty, SimpleQueue
from typing import Any

import msgspec
import zenoh

from transports.channel_filter import channel_filter
from transports.gathering import Gathering
from transports.interface import Observation, ObservationKind
from transports.losses import Losses
from transports.payloads import PayloadError, decode_with
from transports.service_events import EVENT_SUFFIX, KIND_OF_EVENT, TYPE_SUFFIX, ServiceEvent
from transports.zenoh.executor import Executor
from transports.zenoh.names import (
    LINK_KEYS,
    NODE_KEYS,
    channel_of,
    node_of,
    subscriptions,
)
from transports.zenoh.presence import Nodes, read_token, watch
from transports.zenoh.wire import MEDIA_TYPE, UNSPECIFIED, Sent, read_attachment

RING_CAPACITY = 65_536
"""Messages kept for a slow reader (more than a second at the fastest rates measured)."""

_BATCH = 512
"""At most this many messages are handed to the executor at once."""

_AHEAD = 2
"""Batches taken ahead of the reader; all else waits in the ring, where it can be dropped."""

_JOINING_S = 0.5
"""Publishers hear of a subscriber one by one, within ms; longer where processors are busy."""

_decode_event = msgspec.msgpack.Decoder(ServiceEvent).decode
_decode_any = msgspec.msgpack.Decoder().decode


class Tap:
    """A passive listener; see ``transports.interface.Tap``."""

    def __init__(
        self,
        session: zenoh.Session,
        executor: Executor,
        globs: Sequence[str],
        handler: Callable[[Observation], None],
    ) -> None:
        self._session = session
        self._executor = executor
        self._wants = channel_filter(globs)
        self._handler = handler
        self._losses = Losses()
        self._tokens: SimpleQueue[zenoh.Sample] = SimpleQueue()
        self._tokens_lock = threading.Lock()
        self._nodes = Nodes()
        self._heard_by: dict[str, list[str]] = {}
        self._watches = [
            watch(session, f"{prefix}/**", self._tokens.put) for prefix in (NODE_KEYS, LINK_KEYS)
        ]
        # opening a session waits for those who are there: who knows nobody is alone
        is_alone = not (session.info.peers_zid() or session.info.routers_zid())
        self._complete_at_s = time.monotonic() + (0.0 if is_alone else _JOINING_S)
        self._free = threading.Semaphore(_AHEAD)
        self._ending = threading.Event()
        self._subscribers = [
            session.declare_subscriber(key, zenoh.handlers.RingChannel(RING_CAPACITY))
            for key in subscriptions(globs)
        ]
        self._threads = [
            threading.Thread(
                target=self._listen, args=(subscriber.handler,), name="zenoh-tap", daemon=True
            )
            for subscriber in self._subscribers
        ]
        for thread in self._threads:
            thread.start()

    @property
    def is_complete(self) -> bool:
        """Whether those that were there have had the time to hear of it."""
        return time.monotonic() >= self._complete_at_s

    def peers(self) -> Sequence[str]:
        """Names of the nodes this tap is linked to, directly or by a router."""
        linked, _ = self._links()
        return linked

    def problems(self) -> Sequence[str]:
        """What was missed, what could not be decoded, and which nodes cannot be heard."""
        _, unlinked = self._links()
        return [
            *self._losses.sentences(),
            *(f"{name} is up, but not linked to this tap: it is not heard" for name in unlinked),
        ]

    def close(self) -> None:
        """Stop listening; idempotent."""
        if self._ending.is_set():
            return
        self._ending.set()
        for declared in (*self._subscribers, *self._watches):
            declared.undeclare()
        self._free.release()
        # one that came back from Zenoh while the interpreter ends would abort the process
        for thread in self._threads:
            thread.join()

    def _links(self) -> tuple[list[str], list[str]]:
        """``(linked, up but not linked)`` names of nodes."""
        with self._tokens_lock:
            while True:
                try:
                    sample = self._tokens.get_nowait()
                except Empty:
                    break
                self._take_token(sample)
            info = self._session.info
            here = {str(info.zid())}
            linked_ids = {str(zid) for zid in info.peers_zid()}
            routed = bool(info.routers_zid())
            linked, unlinked = set(), set()
            for name, ids in self._nodes.sessions.items():
                others = ids - here
                if others & linked_ids or (others and routed):
                    linked.add(name)
                elif others:
                    unlinked.add(name)
            for names in self._heard_by.values():
                unlinked.update(names)
            own = {name for name, ids in self._nodes.sessions.items() if ids & here}
            return sorted(linked), sorted(unlinked - linked - own)

    def _take_token(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        if key.startswith(NODE_KEYS):
            self._nodes.update(read_token(NODE_KEYS, sample))
            return
        token = read_token(LINK_KEYS, sample)
        names = [node_of(chunk) for chunk in token.rest[0].split(",") if chunk != "-"]
        if token.up:
            self._heard_by[token.zid] = names
        elif self._heard_by.get(token.zid) == names:  # a newer list may have come before
            del self._heard_by[token.zid]

    def _listen(self, ring: Any) -> None:
        receive, take = ring.recv, ring.try_recv
        gathering = Gathering()
        while True:
            self._free.acquire()
            if self._ending.is_set():
                self._free.release()
                return
            try:
                sample = receive()
                if wait_s := gathering.wait_s():
                    self._ending.wait(wait_s)
                batch = []
                while sample is not None:
                    batch.append((sample, time.time_ns()))
                    sample = take() if len(batch) < _BATCH else None
            except zenoh.ZError:  # the subscriber is undeclared: nothing more will come
                self._free.release()
                return
            self._executor.put((self._deliver, batch))

    def _deliver(self, batch: list[tuple[zenoh.Sample, int]]) -> None:
        handler, is_ending = self._handler, self._ending.is_set
        try:
            for sample, received_ns in batch:
                if is_ending():
                    return
                # here, and each only when it is handled: whoever decodes holds up everybody's Python
                if (observation := self._observe(sample, received_ns)) is not None:
                    handler(observation)
        finally:
            self._free.release()

    def _observe(self, sample: zenoh.Sample, received_ns: int) -> Observation | None:
        key = str(sample.key_expr)
        is_event = key.endswith(EVENT_SUFFIX)
        channel = channel_of(key.removesuffix(EVENT_SUFFIX) if is_event else key)
        if not self._wants(channel):
            return None
        sent = read_attachment(sample.attachment)
        source = sent.node
        if sent.number >= 0:
            self._losses.number(channel, source, sent.number)
        type_name = _type_of(str(sample.encoding))
        payload = sample.payload.to_bytes()
        try:
            if is_event:
                return _service_observation(received_ns, channel, type_name, payload, sent)
            data = decode_with(_decode_any, payload)
        except PayloadError as error:
            self._losses.undecodable(channel, source, error)
            return None
        stamp = sample.timestamp
        return Observation(
            stamp_ns=received_ns if stamp is None else stamp.get_time_as_ntp64().as_nanos(),
            received_ns=received_ns,
            channel=channel,
            kind=ObservationKind.MESSAGE,
            type_name=type_name,
            data=data,
            source=source,
            sequence=sent.number,
            order=sent.order,
        )


def _type_of(encoding: str) -> str:
    if encoding == UNSPECIFIED:
        return ""
    return encoding.removeprefix(MEDIA_TYPE + ";")


def _service_observation(
    received_ns: int, channel: str, type_name: str, payload: bytes, sent: Sent
) -> Observation:
    event: ServiceEvent = decode_with(_decode_event, payload)
    info = event.info
    if not 0 <= info.event_type < len(KIND_OF_EVENT):
        raise PayloadError(f"unknown event type {info.event_type} - at `$.info.event_type`")
    kind = KIND_OF_EVENT[info.event_type]
    is_request = kind in (ObservationKind.REQUEST_SENT, ObservationKind.REQUEST_RECEIVED)
    return Observation(
        stamp_ns=info.stamp_ns,
        received_ns=received_ns,
        channel=channel,
        kind=kind,
        type_name=type_name.removesuffix(TYPE_SUFFIX) + ("_Request" if is_request else "_Response"),
        data=event.request if is_request else event.response,
        source=sent.node,
        sequence=sent.number,
        order=sent.order,
        client=info.client,
        call=info.sequence_number,
        error=event.error,
    )
