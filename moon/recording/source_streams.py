"""What is needed to write the observations of one place: their channel in the file, and how to encode them.

A place is a channel, a kind of event, a type, who publishes and who calls.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import msgspec

from m2c.language.datatypes import Structure
from moon.recording import format as layout
from moon.recording.cdr_writing import HEADER, InexactError, Write, as_typed, encoder
from moon.recording.definition_text import definition_text
from moon.recording.definitions import Definitions, UnknownTypeError
from moon.recording.format import Form
from moon.recording.mcap_writing import McapWriter
from moon.recording.numbers import Numbering, numbering_of
from moon.recording.offers import OFFERED, Offer, text_of
from transports.cdr import CdrError
from transports.interface import REQUESTS, Observation, ObservationKind
from transports.service_events import EVENT_SUFFIX, KIND_OF_EVENT, TYPE_SUFFIX

MAX_LANES = 20_000
"""Names come from the wire, and never end; what comes later is kept whole, on one channel."""

Encode = Callable[[Observation], bytearray]
"""The CDR of an observation; InexactError if that would not give it back."""

_EVENT_TYPE = {kind: number for number, kind in enumerate(KIND_OF_EVENT)}
_NONE = b"\0\0\0\0"
_ONE = b"\1\0\0\0"


class SourceStream:
    """One place in one file.

    Attributes:
        channel: its number in the file.
        encode: makes messages of it.
        structure: the type of its data.
        numbering: how its numbers are kept.
    """

    __slots__ = ("channel", "copies", "encode", "numbering", "structure")

    def __init__(
        self, channel: int, encode: Encode, structure: Structure, numbering: Numbering
    ) -> None:
        self.numbering = numbering
        self.channel = channel
        self.encode = encode
        self.structure = structure
        self.copies = -1
        """The number of the channel with what is not exact; -1 before there is one."""


class SourceStreams:
    """The streams of one file.

    Args:
        file: where they are declared.
        types: what is known of types, by all files of a recording.
        offers: what publishers of a topic are known to offer.
    """

    def __init__(self, file: McapWriter, types: Types, offers: Mapping[str, Offer]) -> None:
        self._offers = offers
        self._file = file
        self._types = types
        self._streams: dict[
            tuple[str, ObservationKind, str, int, str, int, str, Numbering], SourceStream | None
        ] = {}
        self._schemas: dict[str, int] = {}

    def stream(self, seen: Observation) -> SourceStream | None:
        """Where ``seen`` belongs; None if it can only be kept whole."""
        if seen.kind is ObservationKind.MESSAGE_TAKEN:
            return None  # ROS 2 has no such thing
        numbering = numbering_of(seen)
        if numbering is None:
            return None
        who = (seen.source, seen.life, seen.client, seen.client_life)
        place = (seen.channel, seen.kind, *who, seen.type_name, numbering)
        try:
            return self._streams[place]
        except KeyError:
            if len(self._streams) >= MAX_LANES or self._file.is_full:
                return None
            stream = self._streams[place] = self._open(seen, numbering)
            return stream

    def copy(self, seen: Observation, stream: SourceStream) -> tuple[int, bytearray] | None:
        """What other tools may be shown for ``seen``, which has no exact form; None: nothing."""
        try:
            near = msgspec.structs.replace(seen, data=as_typed(seen.data, stream.structure))
            data = stream.encode(near)
        except InexactError:
            return None
        if stream.copies < 0:
            stream.copies = self._declare(seen, Form.COPY, Numbering.NONE)
        return stream.copies, data

    def own(self, topic: str, structure: Structure, metadata: dict[str, str]) -> int:
        """A channel of the recorder's own; its number."""
        return self._file.channel(topic, self._schema(structure), metadata)

    def _open(self, seen: Observation, numbering: Numbering) -> SourceStream | None:
        if seen.kind is ObservationKind.MESSAGE and seen.channel.endswith(EVENT_SUFFIX):
            return None  # it would be read as a service's event
        found = self._types.of(seen)
        if found is None:
            return None
        structure, encode = found
        return SourceStream(
            self._declare(seen, Form.OBSERVATION, numbering), encode, structure, numbering
        )

    def _declare(self, seen: Observation, form: Form, numbering: Numbering) -> int:
        metadata = {
            layout.FORM: str(form),
            layout.SOURCE: seen.source,
            layout.NUMBERS: str(numbering),
        }
        if seen.life:
            metadata[layout.LIFE] = str(seen.life)
        if seen.kind is ObservationKind.MESSAGE:
            if (offer := self._offers.get(seen.channel)) is not None:
                metadata[OFFERED] = text_of(offer)
            return self.own(seen.channel, self._types.structure(seen.type_name), metadata)
        base = seen.type_name.rpartition("_")[0]
        metadata[layout.CLIENT] = seen.client
        if seen.client_life:
            metadata[layout.CLIENT_LIFE] = str(seen.client_life)
        structure = self._types.structure(base + TYPE_SUFFIX)
        return self.own(seen.channel + EVENT_SUFFIX, structure, metadata)

    def _schema(self, structure: Structure) -> int:
        number = self._schemas.get(structure.name)
        if number is None:
            text = definition_text(structure)
            number = self._schemas[structure.name] = self._file.schema(
                structure.name, "ros2msg", text
            )
        return number


class Types:
    """How the observations of each type are encoded.

    Args:
        definitions: the types.

    Attributes:
        unknown: the types whose messages are kept whole; "" for those that name none.
    """

    def __init__(self, definitions: Definitions) -> None:
        self.unknown: set[str] = set()
        self._definitions = definitions
        self._writers: dict[str, tuple[Structure, Write] | None] = {}

    def structure(self, type_name: str) -> Structure:
        """The type; UnknownTypeError if nothing defines it."""
        return self._definitions.structure(type_name)

    def of(self, seen: Observation) -> tuple[Structure, Encode] | None:
        """The type of ``seen``'s data, and what encodes observations from its place; None: nothing."""
        name = seen.type_name
        try:
            found = self._writers[name]
        except KeyError:
            found = self._prepare(name, seen.kind)
            if len(self._writers) < MAX_LANES:
                self._writers[name] = found
        if found is None:
            return None
        structure, write = found
        if seen.kind is ObservationKind.MESSAGE:
            return structure, lambda item: _message(item, write)
        return structure, _event_encoder(seen, write)

    def _prepare(self, name: str, kind: ObservationKind) -> tuple[Structure, Write] | None:
        try:
            if not name:
                raise UnknownTypeError("messages that do not name their type")
            if kind is not ObservationKind.MESSAGE:
                self.structure(name.rpartition("_")[0] + TYPE_SUFFIX)
            structure = self.structure(name)
            return structure, encoder(structure)
        except (UnknownTypeError, CdrError):
            if len(self.unknown) < MAX_LANES:
                self.unknown.add(name)
            return None


def _message(seen: Observation, write: Write) -> bytearray:
    out = bytearray(HEADER)
    write(seen.data, out)
    return out


def _event_encoder(first: Observation, write: Write) -> Encode:
    event_type = _EVENT_TYPE[first.kind]
    gid = layout.gid_of(first.client)
    before, after = (_ONE, _NONE) if first.kind in REQUESTS else (_NONE + _ONE, b"")
    nothing = _NONE + _NONE

    def encode(seen: Observation) -> bytearray:
        try:
            out = bytearray(layout.event_head(event_type, seen.stamp_ns, gid, seen.call))
        except layout.NumberError as error:
            raise InexactError from error
        if seen.data is None:
            out += nothing
            return out
        out += before
        write(seen.data, out)
        if after:
            out += b"\0" * (-len(out) % 4) + after
        return out

    return encode
