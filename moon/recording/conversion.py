"""From stored messages to observations: what a tap would have received, as far as the file tells.

A bag has no names of nodes and no numbers of publications. Clients of services are distinguished by the
GIDs in their events, and called ``client-1``, ``client-2``… in the order of their first call.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec
from msgspec.structs import replace

from moon.recording import own_entries
from moon.recording.cdr import Decoder
from moon.recording.contents import MADE_UP
from moon.recording.definitions import Definitions, UnknownTypeError
from moon.recording.entries import Entry
from moon.recording.format import form_of
from moon.recording.numbers import Numbers
from moon.recording.stored import (
    LZ4_MAGIC,
    MAX_BYTES,
    ZSTD_MAGIC,
    StoredChannel,
    StoredMessage,
    TooLargeError,
    ZstdError,
    unzstd,
)
from transports import ros_forms
from transports.cdr import CdrError
from transports.fields_read import FieldsRead, of_event
from transports.interface import CLIENT_END, Observation
from transports.losses import Losses
from transports.payloads import PayloadError
from transports.service_events import EVENT_SUFFIX, KIND_OF_EVENT, TYPE_SUFFIX

_PREFIX_BYTES = 12
"""Of a GID, so much names the participant (RTPS 2.5, 9.3.1): a client's writer and reader share it."""

_UNDECODABLE = (
    *(CdrError, PayloadError, TooLargeError, ZstdError),
    *(msgspec.DecodeError, RecursionError, UnicodeDecodeError),
)

MAX_MISSED = 10_000
"""So many messages in a row that could not be decoded are known by their time."""

_Convert = Callable[[StoredMessage], Entry | None]


class Conversion:
    """Makes observations of the stored messages of one recording.

    Args:
        definitions: the types of its messages.

    Attributes:
        fields_read: which fields of them are read; to be set before the first is converted.
        unread: why the messages of a topic are not read, by topic.
        hollow: services whose events have no contents.
        left_out: how many messages could not be decoded.
        missed: those of them that nobody has taken yet, without their bytes.
    """

    def __init__(self, definitions: Definitions) -> None:
        self.fields_read: FieldsRead = _all_fields
        self.unread: dict[str, str] = {}
        self.hollow: set[str] = set()
        self.left_out = 0
        self.missed: list[StoredMessage] = []
        self._definitions = definitions
        self._losses = Losses()
        self._numbers = Numbers()
        self._made: dict[StoredChannel, _Convert | None] = {}
        self._clients: dict[bytes, str] = {}

    def __call__(self, message: StoredMessage) -> Entry | None:
        """What the message is; None if it cannot be read (``undecodable`` tells)."""
        channel = message.channel
        try:
            convert = self._made[channel]
        except KeyError:
            convert = self._made[channel] = self._prepare(channel)
        if convert is None:
            return None
        try:
            return convert(message)
        except _UNDECODABLE as error:
            self._losses.undecodable(channel.topic, "", error)
            self.left_out += 1
            if len(self.missed) < MAX_MISSED:
                self.missed.append(replace(message, data=b""))
            return None

    def undecodable(self) -> list[str]:
        """What could not be decoded, a sentence for each topic."""
        return [
            sentence.replace(" from unknown", "", 1) for sentence in self._losses.sentences()
        ] + [f"{topic} is not read: {why}" for topic, why in sorted(self.unread.items())]

    def _prepare(self, channel: StoredChannel) -> _Convert | None:
        topic, type_name = channel.topic, channel.type_name
        if form_of(channel.metadata) is not None:
            return self._prepare_own(channel)
        if channel.encoding != "cdr":
            self.unread[topic] = f"its messages are not CDR, but {channel.encoding!r}"
            return None
        try:
            decode = self._decoder(channel)
        except (UnknownTypeError, CdrError) as error:
            self.unread[topic] = str(error)
            return None
        if topic.endswith(EVENT_SUFFIX) and type_name.endswith(TYPE_SUFFIX):
            return lambda message: self._event(message, decode)
        if topic.endswith(ros_forms.CALL_ERRORS) and type_name == ros_forms.STRING:
            return lambda message: _call_error(message, decode)
        return lambda message: _message(message, decode)

    def _prepare_own(self, channel: StoredChannel) -> _Convert | None:
        try:
            return own_entries.reader_of(channel, lambda: self._decoder(channel), self._numbers)
        except (UnknownTypeError, CdrError) as error:
            self.unread[channel.topic] = str(error)
            return None

    def _decoder(self, channel: StoredChannel) -> Decoder:
        type_name, topic = channel.type_name, channel.topic
        self._definitions.add(type_name, channel.schema_encoding, channel.schema)
        read = self.fields_read(topic.removesuffix(EVENT_SUFFIX))
        if topic.endswith(EVENT_SUFFIX):
            read = of_event(read)
        return Decoder(self._definitions.structure(type_name), read)

    def _event(self, message: StoredMessage, decode: Decoder) -> Observation | None:
        service = message.channel.topic.removesuffix(EVENT_SUFFIX)
        event = decode(_bytes_of(message))
        try:
            info = event["info"]
            kind = info["event_type"]
            if not 0 <= kind < len(KIND_OF_EVENT):
                raise CdrError(f"unknown event type {kind} - at `$.info.event_type`")
            contents = event["request"] if ros_forms.is_request(kind) else event["response"]
            stamp_ns = info["stamp"]["sec"] * 10**9 + info["stamp"]["nanosec"]
            call, gid = info["sequence_number"], bytes(info["client_gid"])
        except (KeyError, TypeError, ValueError) as error:
            if isinstance(error, CdrError):
                raise
            raise CdrError(f"it is no service event: no {error}") from error
        if not contents:
            self.hollow.add(service)
        client = self._client(gid)
        # other middlewares may know a client by other names at its own end
        is_client_end = KIND_OF_EVENT[kind] in CLIENT_END
        called = ros_forms.CallEvent(
            event_type=kind,
            stamp_ns=stamp_ns,
            call=call,
            client=client,
            client_life=0 if is_client_end else ros_forms.life_of(gid),
            contents=contents[0] if contents else None,
        )
        received = ros_forms.Received(message.received_ns, client if is_client_end else "")
        return ros_forms.of_event(service, message.channel.type_name, called, received)

    def _client(self, gid: bytes) -> str:
        participant = gid[:_PREFIX_BYTES]
        return self._clients.setdefault(participant, f"{MADE_UP}{len(self._clients) + 1}")


def _all_fields(_: str) -> None:
    return None


def _message(message: StoredMessage, decode: Decoder) -> Observation:
    channel = message.channel
    return ros_forms.of_message(
        channel.topic,
        channel.type_name,
        decode(_bytes_of(message)),
        message.published_ns or message.received_ns,
        ros_forms.Received(message.received_ns),
    )


def _call_error(message: StoredMessage, decode: Decoder) -> Observation:
    text: Any = decode(_bytes_of(message))["data"]
    error = ros_forms.read_call_error(text)
    ended = ros_forms.of_call_error(error, error.service, message.received_ns)
    return ended if error.by_server else replace(ended, client_life=0)


def _bytes_of(message: StoredMessage) -> bytes:
    data = message.data
    if data.startswith(LZ4_MAGIC):
        raise CdrError("it is compressed by lz4, message by message; only zstd is read so")
    return unzstd(data, MAX_BYTES) if data.startswith(ZSTD_MAGIC) else data
