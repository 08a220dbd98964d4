"""The tap: receives everything by wildcard subscribers, and holds nobody up.

Zenoh writes what arrives into a ring of its own, without Python and without a lock that Python holds. The
ring is bounded in messages only, so one thread empties it at once into a queue that is bounded in bytes.
There messages wait for the executor. When the reader is slow the queue drops the oldest. Nodes never notice;
the gaps in the sequence numbers show how many messages of each node were missed, and the tap says what it
dropped.
"""

from __future__ import annotations

import functools
import threading
import time
from collections.abc import Callable, Collection, Container, Mapping, Sequence
from typing import Any, NamedTuple

import msgspec
import zenoh

from transports.channel_filter import channel_filter
from transports.fields_read import FieldsRead, Paths, of_event
from transports.gathering import Gathering
from transports.interface import (
    CLIENT_END,
    REQUESTS,
    Answer,
    BlindSpot,
    Closes,
    Observation,
    ObservationKind,
)
from transports.losses import Losses
from transports.payloads import SMALL_BYTES, PayloadError, decode_with, plain, shallow
from transports.refusals import Refusals, shown
from transports.service_events import (
    EVENT_SUFFIX,
    KIND_OF_EVENT,
    MESSAGE_TAKEN,
    TAKEN_SUFFIX,
    TYPE_SUFFIX,
    ServiceEvent,
)
from transports.zenoh import tokens
from transports.zenoh.answers import MARK, Questions
from transports.zenoh.claims import Claims
from transports.zenoh.idle import IdleTaps
from transports.zenoh.names import LINK_KEYS, NODE_KEYS, channel_of, node_of, subscriptions
from transports.zenoh.permissions import Permissions
from transports.zenoh.presence import MOST_TOKENS, Nodes, is_up, watch
from transports.zenoh.services import MOST_ERROR
from transports.zenoh.tokens import TokenError
from transports.zenoh.waiting import Arrived, Waiting, size_of
from transports.zenoh.wire import UNKNOWN, Sent, life_of, read_attachment, type_of
from transports.zenoh_link.contained import Runner

RING_CAPACITY = 65_536
"""Messages that Zenoh keeps until they are taken (more than a second at the fastest rates measured)."""

_BATCH = 512
_BATCH_BYTES = 1024 * 1024
"""At most this many messages, and about so many bytes, are taken, handled or dropped at once."""

MOST_CHANNELS = 10_000
"""Channels that a tap receives: a hundred times those of a large system. Their names come from the wire."""

MOST_CHANNEL_NAME = 1024
"""Characters of a channel's name: several times what ROS 2 allows; on Zenoh a name has up to 64 KB."""

_JOINING_S = 0.5
"""Publishers learn of a subscriber one by one, within ms; longer where processors are busy."""


_decode_event = msgspec.msgpack.Decoder(ServiceEvent).decode
_event_from = functools.partial(msgspec.convert, type=ServiceEvent)


class _Place(NamedTuple):
    """What comes on a key.

    Attributes:
        channel: whose it is.
        suffix: what it is of that, where it is an event.
        speakers: the names in which it may come; None: in any.
    """

    channel: str
    suffix: str
    speakers: Container[str] | None


class Listener(NamedTuple):
    """Who listens, and by what.

    Attributes:
        session: whose subscribers it has.
        executor: where observations are handed over.
        node: its name.
        permissions: what whose certificate allows, where certificates are in use.
        idle: waits for first messages, where they may never come; by default each tap does so itself.
    """

    session: zenoh.Session
    executor: Runner
    node: str
    permissions: Permissions | None = None
    idle: IdleTaps | None = None


class Tap(Closes):
    """A passive listener; see ``transports.interface.Tap``.

    Args:
        listener: who listens.
        globs: of channels; empty: all.
        handler: gets each observation.
        refusals: where what cannot be used is counted.
        namespace: whose channels and nodes they are, where the session has no namespace of its own.
        ring_capacity: messages that Zenoh keeps until they are taken; by default ``RING_CAPACITY``.
    """

    def __init__(
        self,
        listener: Listener,
        globs: Sequence[str],
        handler: Callable[[Observation], None],
        refusals: Refusals,
        namespace: str = "",
        ring_capacity: int | None = None,
    ) -> None:
        session, executor, node, permissions, idle = listener
        self._session = session
        self._permissions = permissions
        self._prefix = prefix = f"{namespace}/" if namespace else ""
        self._executor = executor
        self._node = node
        self._wants = channel_filter(globs)
        self._handler = handler
        self._refusals = refusals
        self._fields_read: FieldsRead = lambda channel: None
        self._losses = Losses()
        self._tokens_lock = threading.Lock()
        self._nodes = Nodes()
        self._linked_to: dict[tuple[str, str], tuple[str, ...]] = {}
        """By session and by who says so, the nodes that it is linked to."""
        self._claims = Claims(self._nodes.announced, self._linked_ids, self._tokens_lock)
        self._watches = [
            watch(session, f"{prefix}{keys}/**", self._take_token)
            for keys in (NODE_KEYS, LINK_KEYS)
        ]
        # opening a session waits for those who are there: who knows nobody is alone
        is_alone = not (session.info.peers_zid() or session.info.routers_zid())
        self._complete_at_s = time.monotonic() + (0.0 if is_alone else _JOINING_S)
        self._channels: dict[str, _Place | None] = {}
        self._waiting = Waiting()
        self._ending = threading.Event()
        keys = [prefix + key for key in subscriptions(globs)]
        self._questions = Questions(
            session,
            executor,
            keys,
            self._claims.is_right,
            lambda: self._waiting.gone,
            refusals,
            prefix,
        )
        capacity = RING_CAPACITY if ring_capacity is None else ring_capacity
        self._subscribers = [
            session.declare_subscriber(key, zenoh.handlers.RingChannel(capacity)) for key in keys
        ]
        self._threads: list[threading.Thread] = []
        self._idle = idle
        for subscriber in self._subscribers:
            if idle is None:
                self._begin(subscriber.handler)
            else:
                idle.add(subscriber.handler, functools.partial(self._begin, subscriber.handler))

    @property
    def is_complete(self) -> bool:
        """Whether those that were there have had the time to learn of it."""
        return time.monotonic() >= self._complete_at_s

    def ask(
        self, node: str, answered: Callable[[Answer | None], None], within_s: float = 1.0
    ) -> None:
        """See ``transports.interface.Tap``."""
        with self._tokens_lock:
            zids = [token.zid for token in self._nodes.announced.get(node, ())]
            zid = "" if len(zids) != 1 or self._nodes.contested.is_contested(node) else zids[0]
        self._questions.ask(node, zid, answered, within_s)

    def is_contested(self, name: str) -> bool:
        """See ``transports.interface.Tap``."""
        return self._nodes.contested.is_contested(name)

    def take_dropped(self) -> Collection[tuple[str, str]]:
        """See ``transports.interface.Tap``."""
        return self._waiting.take_dropped()

    def blind_spots(self) -> Mapping[BlindSpot, str]:
        """None: whatever a payload says is decoded, and models say which topics are not reliable."""
        return {}

    def read_only(self, fields: FieldsRead) -> None:
        """See ``transports.interface.ReadsParts``."""
        self._fields_read = fields

    def peers(self) -> Sequence[str]:
        """Names of the nodes this tap is linked to, directly or by a router."""
        linked, _ = self._links()
        return linked

    def problems(self) -> Sequence[str]:
        """What was missed, what could not be decoded, and from which nodes nothing can be received."""
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
        self._questions.close()
        if self._idle is not None:
            for subscriber in self._subscribers:
                self._idle.remove(subscriber.handler)
        for declared in (*self._subscribers, *self._watches):
            declared.undeclare()
        # one that came back from Zenoh while the interpreter ends would abort the process
        for thread in self._threads:
            thread.join()

    def _links(self) -> tuple[list[str], list[str]]:
        """``(linked, up but not linked)`` names of nodes."""
        info = self._session.info
        here = str(info.zid())
        linked_ids = {here, *self._linked_ids()}
        routed = bool(info.routers_zid())
        with self._tokens_lock:
            linked, unlinked = set(), set()
            for name, announced in self._nodes.announced.items():
                others = {token.zid for token in announced}
                if name == self._node:
                    others.discard(here)
                if others & linked_ids or (others and routed):
                    linked.add(name)
                elif others:
                    unlinked.add(name)
            for names in self._linked_to.values():
                unlinked.update(names)
            return sorted(linked), sorted(unlinked - linked - {self._node})

    def _linked_ids(self) -> set[str]:
        return {str(zid) for zid in self._session.info.peers_zid()}

    def _take_token(self, sample: zenoh.Sample) -> None:
        """On a thread of Zenoh's."""
        key = str(sample.key_expr).removeprefix(self._prefix)
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
        place = token.zid, token.by
        if up:
            allowed = self._permissions
            if allowed is not None and not allowed.nodes.issuperset(token.names):
                raise TokenError(f"{token.by} names a node that has no certificate")
            if len(self._linked_to) >= MOST_TOKENS and place not in self._linked_to:
                raise TokenError(f"more than {MOST_TOKENS} sessions say to whom they are linked")
            self._linked_to[place] = token.names
        elif self._linked_to.get(place) == token.names:  # a newer list may have come before
            del self._linked_to[place]

    def _begin(self, ring: Any, first: zenoh.Sample | None = None) -> None:
        """Listen to ``ring``, from which ``first`` was taken already."""
        thread = threading.Thread(
            target=self._listen, args=(ring, first), name="zenoh-tap", daemon=True
        )
        self._threads.append(thread)
        thread.start()

    def _listen(self, ring: Any, first: zenoh.Sample | None) -> None:
        receive, take = ring.recv, ring.try_recv
        gathering = Gathering()
        while True:
            try:
                sample, first = first or receive(), None
                if wait_s := gathering.wait_s():
                    self._ending.wait(wait_s)
                batch: list[Arrived] = []
                marks: list[bytes] = []
                size = 0
                while sample is not None:
                    arrived = self._read(sample, time.time_ns(), marks)
                    if arrived is not None:
                        batch.append(arrived)
                        size += size_of(arrived)
                    if len(batch) >= _BATCH or size >= _BATCH_BYTES:
                        self._offer(batch, marks)
                        batch, marks, size = [], [], 0
                    sample = take()
            except zenoh.ZError:  # the subscriber is undeclared: nothing more will come
                return
            if batch or marks:
                self._offer(batch, marks)

    def _offer(self, batch: list[Arrived], marks: list[bytes]) -> None:
        if self._waiting.offer(batch):
            self._executor.put((self._deliver, None))
        for token in marks:
            self._questions.note_mark(token, self._waiting.offered)

    def _read(self, sample: zenoh.Sample, received_ns: int, marks: list[bytes]) -> Arrived | None:
        """What of ``sample`` is needed; None if its channel is not tapped, or it goes to ``marks``."""
        key = str(sample.key_expr)
        try:
            place = self._channels[key]
        except KeyError:
            place = self._place_of(key)
        if place is None:
            if key.endswith(MARK) and sample.attachment is not None:
                marks.append(sample.attachment.to_bytes())
            return None
        sent = read_attachment(sample.attachment)
        stamp = sample.timestamp
        stamp_ns = received_ns if stamp is None else stamp.get_time_as_ntp64().as_nanos()
        session = None if stamp is None else stamp.get_id()
        life = 0
        if sent.node:
            speakers = place.speakers
            if speakers is not None and sent.node not in speakers:
                self._claims.note_misplaced(sent.node, place.channel)
                sent = UNKNOWN
            elif not self._claims.is_right(sent.node, session):
                sent = UNKNOWN
            elif session is not None:
                life = life_of(session)
        return Arrived(
            place.channel,
            place.suffix,
            sent,
            str(sample.encoding),
            sample.payload.to_bytes(),
            stamp_ns,
            received_ns,
            life,
        )

    def _place_of(self, key: str) -> _Place | None:
        """What comes on ``key``; None if it is not received."""
        own = key.removeprefix(self._prefix)
        base, _, owner = own.rpartition("/")
        suffix = next((s for s in (EVENT_SUFFIX, TAKEN_SUFFIX) if base.endswith(s)), "")
        if not suffix:
            base, owner = own, ""
            suffix = next((s for s in (EVENT_SUFFIX, TAKEN_SUFFIX) if own.endswith(s)), "")
        channel = channel_of(base.removesuffix(suffix))
        if key.endswith(MARK) or not self._wants(channel):
            return None
        if len(channel) > MOST_CHANNEL_NAME:
            why = f"a name of more than {MOST_CHANNEL_NAME} characters: not received"
            self._refusals.refuse(shown(channel), "", why)
            return None
        if len(self._channels) >= MOST_CHANNELS:
            self._refusals.refuse(channel, "", f"more than {MOST_CHANNELS} channels: not received")
            return None
        speakers = None if self._permissions is None else self._permissions.publishers(key)
        if owner and (speakers is None or node_of(owner) in speakers):
            speakers = (node_of(owner),)
        place = self._channels[key] = _Place(channel, suffix, speakers)
        return place

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
            self._questions.give()

    def _observe(self, arrived: Arrived) -> Observation | None:
        channel, suffix, sent, encoding, payload, stamp_ns, received_ns, life = arrived
        if sent.number >= 0:
            self._losses.number(channel + suffix, sent.node, sent.number, stamp_ns, life)
        type_name = type_of(encoding)
        read = self._fields_read(channel) if len(payload) > SMALL_BYTES else None
        try:
            if suffix == EVENT_SUFFIX:
                event = _event_of(payload, sent, range(len(KIND_OF_EVENT)), read)
                return _service_observation(received_ns, channel, type_name, event, sent, life)
            if suffix == TAKEN_SUFFIX:
                return _taken_observation(received_ns, channel, type_name, payload, sent, life)
            data = plain(payload, read)
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
            life=life,
        )


def _event_of(
    payload: bytes, sent: Sent, event_types: Collection[int], read: Paths | None = None
) -> ServiceEvent:
    event: ServiceEvent
    if read is None:
        event = decode_with(_decode_event, payload)
        shallow([event.request, event.response], len(payload))
    else:
        event = decode_with(_event_from, plain(payload, of_event(read)))
    if event.info.event_type not in event_types:
        raise PayloadError(f"unknown event type {event.info.event_type} - at `$.info.event_type`")
    if not sent.node:
        raise PayloadError("it does not say which node it is from, or says so wrongly")
    return event


def _taken_observation(
    received_ns: int, channel: str, type_name: str, payload: bytes, sent: Sent, life: int
) -> Observation:
    info = _event_of(payload, sent, (MESSAGE_TAKEN,)).info
    if info.sequence_number < 0 or not info.client:
        raise PayloadError("it does not say which message was taken - at `$.info`")
    return Observation(
        stamp_ns=info.stamp_ns,
        received_ns=received_ns,
        channel=channel,
        kind=ObservationKind.MESSAGE_TAKEN,
        type_name=type_name,
        data=None,
        source=sent.node,
        sequence=sent.number,
        order=sent.order,
        client=info.client,
        call=info.sequence_number,
        life=life,
        client_life=info.life,
    )


def _service_observation(
    received_ns: int, channel: str, type_name: str, event: ServiceEvent, sent: Sent, life: int
) -> Observation:
    info = event.info
    kind = KIND_OF_EVENT[info.event_type]
    is_request = kind in REQUESTS
    if kind in CLIENT_END and info.client != sent.node:
        raise PayloadError("it is a client's, of another's call - at `$.info.client`")
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
        error=event.error[:MOST_ERROR],
        life=life,
        client_life=info.life,
    )
