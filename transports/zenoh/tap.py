"""The tap: hears everything by wildcard subscribers, and holds nobody up.

Zenoh writes what arrives into a ring of its own (no Python, no lock that Python holds), from which one
thread takes it at once, as what is kept there is bounded by its number only. It waits for the executor in a
queue that is bounded in bytes. When the reader is slow the oldest goes: nodes never notice, the gaps in the
sequence numbers tell how many were missed of each, and the tap says what it dropped.
"""

from __future__ import annotations

import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Collection, Sequence
from typing import Any, NamedTuple

import msgspec
import zenoh

from transports.channel_filter import channel_filter
from transports.gathering import Gathering
from transports.interface import Observation, ObservationKind
from transports.losses import Losses
from transports.payloads import PayloadError, decode_with, plain, shallow
from transports.refusals import Refusals, shown
from transports.service_events import EVENT_SUFFIX, KIND_OF_EVENT, TYPE_SUFFIX, ServiceEvent
from transports.zenoh import tokens
from transports.zenoh.claims import Claims
from transports.zenoh.executor import Executor
from transports.zenoh.names import LINK_KEYS, NODE_KEYS, channel_of, subscriptions
from transports.zenoh.presence import MOST_TOKENS, Nodes, is_up, watch
from transports.zenoh.tokens import TokenError
from transports.zenoh.wire import UNKNOWN, Sent, read_attachment, type_of

RING_CAPACITY = 65_536
"""Messages that Zenoh keeps until they are taken (more than a second at the fastest rates measured)."""

MOST_WAITING_BYTES = 64 * 1024 * 1024
"""What waits for a slow reader, as much as in a node's own subscription (``executor.INBOX_BYTES``)."""
_OVERHEAD_BYTES = 512
"""What a message takes beside its payload, in Python: so at most twice ``RING_CAPACITY`` wait."""

_BATCH = 512
_BATCH_BYTES = 1024 * 1024
"""At most this many messages, and about so many bytes, are taken, handled or dropped at once."""

MOST_CHANNELS = 10_000
"""Channels that a tap hears: a hundred times those of a large system. Their names come from the wire."""

_JOINING_S = 0.5
"""Publishers hear of a subscriber one by one, within ms; longer where processors are busy."""

_decode_event = msgspec.msgpack.Decoder(ServiceEvent).decode


class _Arrived(NamedTuple):
    """A message as it came, none of it Zenoh's any more (which would keep the 64 KB that it came in)."""

    channel: str
    is_event: bool
    sent: Sent
    encoding: str
    payload: bytes
    stamp_ns: int
    received_ns: int


class _Waiting:
    """Batches of messages that wait for the executor, bounded in bytes; from any thread.

    When there is no room the oldest go. But one channel has half of the room at most, and what comes on it
    beyond that is dropped: a flood on it costs what is on it, and not what the others have said.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._batches: deque[list[_Arrived]] = deque()
        self._bytes: Counter[str] = Counter()
        """What waits, by channel; only those of which something does."""
        self._total = 0
        self._is_taking = False
        self._dropped: Counter[str] = Counter()
        self._dropped_bytes = 0
        self._to_tell: set[tuple[str, str]] = set()

    def offer(self, batch: list[_Arrived]) -> bool:
        """Keep ``batch``; whether somebody must be told to take it."""
        kept: list[_Arrived] = []
        with self._lock:
            for arrived in batch:
                size = _size_of(arrived)
                if self._bytes[arrived.channel] + size > MOST_WAITING_BYTES // 2 and self._total:
                    self._count(arrived, size)
                    continue
                while self._batches and self._total + size > MOST_WAITING_BYTES:
                    for oldest in self._batches.popleft():
                        self._count(oldest, self._release(oldest))
                self._bytes[arrived.channel] += size
                self._total += size
                kept.append(arrived)
            if not kept:
                return False
            self._batches.append(kept)
            is_new, self._is_taking = not self._is_taking, True
            return is_new

    def take(self) -> tuple[list[_Arrived], bool]:
        """The oldest batch, and whether there are more."""
        with self._lock:
            batch = self._batches.popleft()
            for arrived in batch:
                self._release(arrived)
            self._is_taking = bool(self._batches)
            return batch, self._is_taking

    def _release(self, arrived: _Arrived) -> int:
        size = _size_of(arrived)
        self._total -= size
        left = self._bytes[arrived.channel] - size
        if left:
            self._bytes[arrived.channel] = left
        else:
            del self._bytes[arrived.channel]
        return size

    def _count(self, arrived: _Arrived, size: int) -> None:
        self._dropped[arrived.channel] += 1
        self._dropped_bytes += size
        self._to_tell.add((arrived.channel, arrived.sent.node))

    def take_dropped(self) -> Collection[tuple[str, str]]:
        """Channel and source of what was dropped since this was last asked."""
        if not self._to_tell:
            return ()
        with self._lock:
            dropped, self._to_tell = self._to_tell, set()
        return dropped

    def sentences(self) -> list[str]:
        """What was dropped."""
        with self._lock:
            if not self._dropped:
                return []
            channel, most = self._dropped.most_common(1)[0]
            total = sum(self._dropped.values())
            return [
                f"dropped {total} message{'s' * (total != 1)} ({self._dropped_bytes / 1e6:.1f} MB): they "
                f"come faster than they are handled, {most} of them on {shown(channel)}"
            ]


def _size_of(arrived: _Arrived) -> int:
    return len(arrived.payload) + _OVERHEAD_BYTES


class Tap:
    """A passive listener; see ``transports.interface.Tap``."""

    def __init__(
        self,
        session: zenoh.Session,
        executor: Executor,
        globs: Sequence[str],
        handler: Callable[[Observation], None],
        refusals: Refusals,
    ) -> None:
        self._session = session
        self._executor = executor
        self._wants = channel_filter(globs)
        self._handler = handler
        self._refusals = refusals
        self._losses = Losses()
        self._tokens_lock = threading.Lock()
        self._nodes = Nodes()
        self._heard_by: dict[str, tuple[str, ...]] = {}
        self._claims = Claims(self._nodes.announced, self._linked_ids, self._tokens_lock)
        self._watches = [
            watch(session, f"{prefix}/**", self._take_token) for prefix in (NODE_KEYS, LINK_KEYS)
        ]
        # opening a session waits for those who are there: who knows nobody is alone
        is_alone = not (session.info.peers_zid() or session.info.routers_zid())
        self._complete_at_s = time.monotonic() + (0.0 if is_alone else _JOINING_S)
        self._channels: dict[str, tuple[str, bool] | None] = {}
        self._waiting = _Waiting()
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

    def is_contested(self, name: str) -> bool:
        """See ``transports.interface.Tap``."""
        return self._nodes.is_contested(name)

    def take_dropped(self) -> Collection[tuple[str, str]]:
        """See ``transports.interface.Tap``."""
        return self._waiting.take_dropped()

    def peers(self) -> Sequence[str]:
        """Names of the nodes this tap is linked to, directly or by a router."""
        linked, _ = self._links()
        return linked

    def problems(self) -> Sequence[str]:
        """What was missed, what could not be decoded, and which nodes cannot be heard."""
        _, unlinked = self._links()
        with self._tokens_lock:
            claims = self._claims.sentences()
        return [
            *self._losses.sentences(),
            *self._waiting.sentences(),
            *claims,
            *(
                f"{name} is up, but not linked to this tap: its messages are not received"
                for name in unlinked
            ),
        ]

    def close(self) -> None:
        """Stop listening; idempotent."""
        if self._ending.is_set():
            return
        self._ending.set()
        for declared in (*self._subscribers, *self._watches):
            declared.undeclare()
        # one that came back from Zenoh while the interpreter ends would abort the process
        for thread in self._threads:
            thread.join()

    def _links(self) -> tuple[list[str], list[str]]:
        """``(linked, up but not linked)`` names of nodes."""
        info = self._session.info
        here = {str(info.zid())}
        linked_ids = self._linked_ids()
        routed = bool(info.routers_zid())
        with self._tokens_lock:
            linked, unlinked, own = set(), set(), set()
            for name, announced in self._nodes.announced.items():
                ids = {token.zid for token in announced}
                others = ids - here
                if others & linked_ids or (others and routed):
                    linked.add(name)
                elif others:
                    unlinked.add(name)
                if ids & here:
                    own.add(name)
            for names in self._heard_by.values():
                unlinked.update(names)
            return sorted(linked), sorted(unlinked - linked - own)

    def _linked_ids(self) -> set[str]:
        return {str(zid) for zid in self._session.info.peers_zid()}

    def _take_token(self, sample: zenoh.Sample) -> None:
        """On a thread of Zenoh's."""
        key = str(sample.key_expr)
        with self._tokens_lock:
            try:
                if key.startswith(NODE_KEYS):
                    self._nodes.update(tokens.read_node(key), is_up(sample))
                else:
                    self._take_links(tokens.read_links(key), is_up(sample))
            except TokenError as error:
                self._refusals.refuse(
                    NODE_KEYS if key.startswith(NODE_KEYS) else LINK_KEYS, "", error
                )

    def _take_links(self, token: tokens.LinkToken, up: bool) -> None:
        if up:
            if len(self._heard_by) >= MOST_TOKENS and token.zid not in self._heard_by:
                raise TokenError(f"more than {MOST_TOKENS} sessions say whom they hear")
            self._heard_by[token.zid] = token.names
        elif self._heard_by.get(token.zid) == token.names:  # a newer list may have come before
            del self._heard_by[token.zid]

    def _listen(self, ring: Any) -> None:
        receive, take = ring.recv, ring.try_recv
        gathering = Gathering()
        while True:
            try:
                sample = receive()
                if wait_s := gathering.wait_s():
                    self._ending.wait(wait_s)
                batch: list[_Arrived] = []
                size = 0
                while sample is not None:
                    arrived = self._read(sample, time.time_ns())
                    if arrived is not None:
                        batch.append(arrived)
                        size += _size_of(arrived)
                    if len(batch) >= _BATCH or size >= _BATCH_BYTES:
                        self._offer(batch)
                        batch, size = [], 0
                    sample = take()
            except zenoh.ZError:  # the subscriber is undeclared: nothing more will come
                return
            if batch:
                self._offer(batch)

    def _offer(self, batch: list[_Arrived]) -> None:
        if self._waiting.offer(batch):
            self._executor.put((self._deliver, None))

    def _read(self, sample: zenoh.Sample, received_ns: int) -> _Arrived | None:
        """What of ``sample`` is needed; None if it is on no channel that is heard."""
        key = str(sample.key_expr)
        try:
            place = self._channels[key]
        except KeyError:
            place = self._place_of(key)
        if place is None:
            return None
        sent = read_attachment(sample.attachment)
        stamp = sample.timestamp
        stamp_ns = received_ns if stamp is None else stamp.get_time_as_ntp64().as_nanos()
        session = None if stamp is None else stamp.get_id()
        if sent.node and not self._claims.is_right(sent.node, session):
            sent = UNKNOWN
        return _Arrived(
            *place, sent, str(sample.encoding), sample.payload.to_bytes(), stamp_ns, received_ns
        )

    def _place_of(self, key: str) -> tuple[str, bool] | None:
        """The channel, and whether it is of a service's events; None if it is not heard."""
        is_event = key.endswith(EVENT_SUFFIX)
        channel = channel_of(key.removesuffix(EVENT_SUFFIX) if is_event else key)
        if not self._wants(channel):
            return None
        if len(self._channels) >= MOST_CHANNELS:
            self._refusals.refuse(channel, "", f"more than {MOST_CHANNELS} channels: not received")
            return None
        self._channels[key] = channel, is_event
        return channel, is_event

    def _deliver(self, _: object) -> None:
        if self._ending.is_set():
            return
        batch, is_more = self._waiting.take()
        handler, is_ending = self._handler, self._ending.is_set
        try:
            for arrived in batch:
                if is_ending():
                    return
                # here, and each only when it is handled: whoever decodes holds up everybody's Python
                if (observation := self._observe(arrived)) is not None:
                    handler(observation)
        finally:
            if is_more:
                self._executor.put((self._deliver, None))

    def _observe(self, arrived: _Arrived) -> Observation | None:
        channel, is_event, sent, encoding, payload, stamp_ns, received_ns = arrived
        if sent.number >= 0:
            self._losses.number(channel, sent.node, sent.number, stamp_ns)
        type_name = type_of(encoding)
        try:
            if is_event:
                return _service_observation(received_ns, channel, type_name, payload, sent)
            data = plain(payload)
        except PayloadError as error:
            self._losses.undecodable(channel, sent.node, error)
            return None
        return Observation(
            stamp_ns=stamp_ns,
            received_ns=received_ns,
            channel=channel,
            kind=ObservationKind.MESSAGE,
            type_name=type_name,
            data=data,
            source=sent.node,
            sequence=sent.number,
            order=sent.order,
        )


def _service_observation(
    received_ns: int, channel: str, type_name: str, payload: bytes, sent: Sent
) -> Observation:
    event: ServiceEvent = decode_with(_decode_event, payload)
    shallow([event.request, event.response], len(payload))
    info = event.info
    if not 0 <= info.event_type < len(KIND_OF_EVENT):
        raise PayloadError(f"unknown event type {info.event_type} - at `$.info.event_type`")
    if not sent.node:
        raise PayloadError("it does not say which node it is from, or says so wrongly")
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
