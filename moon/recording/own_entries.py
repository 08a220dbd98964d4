"""From the messages of our own recordings to the entries that were written: :mod:`moon.recording.format`."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from typing import Any

import msgspec

from m2c.language.datatypes import Array, Structure
from moon.recording import format as layout
from moon.recording.cdr import Decoder, part_reader
from moon.recording.cdr_writing import HEADER
from moon.recording.entries import Entry, Event, Pulse, ReportedVerdict, Turn
from moon.recording.format import Form
from moon.recording.numbers import Numbering, Numbers
from moon.recording.stored import StoredChannel, StoredMessage
from moon.recording.whole import unpack_whole
from moon.verdict import Cause, Difference, Evidence, Explanation, Outcome, Verdict
from transports.cdr import CdrError
from transports.fields_read import inside
from transports.interface import Observation, ObservationKind
from transports.service_events import EVENT_SUFFIX, KIND_OF_EVENT, RESPONSE_SENT, TYPE_SUFFIX

Read = Callable[[StoredMessage], Entry]
"""The entry in a message; CdrError or msgspec.DecodeError if there is none."""

ReadNumbers = Callable[[int], tuple[int, int]]
"""From the number in an MCAP record to an observation's sequence and order."""

_decode_string = Decoder(layout.STRING_TYPE)
_int64_at = struct.Struct("<q").unpack_from
_INT64_AT = 4
_count_at = struct.Struct("<I").unpack_from
_decode_verdict = Decoder(layout.VERDICT_TYPE)
_decode_earlier_verdict = Decoder(layout.EARLIER_VERDICT_TYPE)
_PACKED_AT = 8
_decode_event = msgspec.json.Decoder(Event).decode


def reader_of(
    channel: StoredChannel, decode: Callable[[], Decoder], numbers: Numbers
) -> Read | None:
    """What reads the messages of ``channel``; None if they are copies, for other tools.

    Args:
        channel: of our own (``format.form_of`` its metadata is not None).
        decode: makes the decoder of the channel's type, if it is needed.
        numbers: of the recording.

    Raises:
        CdrError: the channel is not what it says it is.
    """
    metadata = channel.metadata
    match layout.form_of(metadata):
        case Form.OBSERVATION:
            source = metadata.get(layout.SOURCE, "")
            if not channel.topic.endswith(EVENT_SUFFIX):
                number = _number_reader(metadata, source, channel.topic, True, numbers)
                return _message_reader(channel, decode(), source, number)
            service = channel.topic.removesuffix(EVENT_SUFFIX)
            number = _number_reader(metadata, source, service, False, numbers)
            client = metadata.get(layout.CLIENT, "")
            return _event_reader(channel, decode(), source, client, number)
        case Form.PACKED:
            return lambda message: _read_packed(message, numbers)
        case Form.EVENT:
            return lambda message: _decode_event(_decode_string(message.data)["data"])
        case Form.PULSE:
            return _pulse_reader(metadata.get(layout.TURN, ""))
        case Form.VERDICT:
            kind = metadata.get(layout.KIND, "model")
            has_cause = decode().structure.field("cause") is not None
            read = _decode_verdict if has_cause else _decode_earlier_verdict
            return lambda message: _verdict(message, read(message.data), kind)
        case _:
            return None


def _number_reader(
    metadata: Mapping[str, str], source: str, channel: str, is_message: bool, numbers: Numbers
) -> ReadNumbers:
    match metadata.get(layout.NUMBERS):
        case Numbering.BOTH:
            return numbers.unpacker(source, channel, is_message)
        case Numbering.SEQUENCE:
            return lambda number: (number - 1, -1)
        case _:
            return lambda number: (-1, -1)


def _message_reader(
    channel: StoredChannel, decode: Decoder, source: str, number: ReadNumbers
) -> Read:
    topic, type_name, kind = channel.topic, channel.type_name, ObservationKind.MESSAGE
    life, _ = layout.lives_of(channel.metadata)

    def read(message: StoredMessage) -> Observation:
        sequence, order = number(message.sequence)
        return Observation(
            stamp_ns=message.published_ns,
            received_ns=message.received_ns,
            channel=topic,
            kind=kind,
            type_name=type_name,
            data=decode(message.data),
            source=source,
            sequence=sequence,
            order=order,
            life=life,
        )

    return read


def _event_reader(
    channel: StoredChannel, decode: Decoder, source: str, client: str, number: ReadNumbers
) -> Read:
    service = channel.topic.removesuffix(EVENT_SUFFIX)
    base = channel.type_name.removesuffix(TYPE_SUFFIX)
    request, response = f"{base}_Request", f"{base}_Response"
    take = _event_taker(decode)
    life, client_life = layout.lives_of(channel.metadata)

    def read(message: StoredMessage) -> Observation:
        try:
            event_type, call, data = take(message.data)
        except struct.error as error:
            raise CdrError("the event ends too early") from error
        sequence, order = number(message.sequence)
        return Observation(
            stamp_ns=message.published_ns,
            received_ns=message.received_ns,
            channel=service,
            kind=KIND_OF_EVENT[event_type],
            type_name=request if event_type < RESPONSE_SENT else response,
            data=data,
            source=source,
            sequence=sequence,
            order=order,
            client=client,
            call=call,
            life=life,
            client_life=client_life,
        )

    return read


def _event_taker(decode: Decoder) -> Callable[[bytes], tuple[int, int, Any]]:
    """What takes the type of event, the number of the call and the contents out of an event.

    An event's information always has the same places; what of it is in the channel's metadata is not
    read a second time.
    """
    structure, read = decode.structure, decode.read
    kinds = dict(structure.fields)
    asked, answered = kinds.get("request"), kinds.get("response")
    if (
        [name for name, _ in structure.fields] != ["info", "request", "response"]
        or not isinstance(asked, Array)
        or not isinstance(answered, Array)
        or not isinstance(asked.element, Structure)
        or not isinstance(answered.element, Structure)
    ):
        raise CdrError(f"{structure.name} is not the type of a service's events")
    read_request = part_reader(asked.element, read=inside(read, "request"))
    read_response = part_reader(answered.element, read=inside(read, "response"))

    def take(data: bytes) -> tuple[int, int, Any]:
        event_type, call, requests = layout.read_event_head(data)
        if event_type >= len(KIND_OF_EVENT):
            raise CdrError(f"unknown event type {event_type} - at `$.info.event_type`")
        payload = data[len(HEADER) :]
        if requests:
            return event_type, call, read_request(payload, layout.EVENT_HEAD_BYTES)[0]
        (responses,) = _count_at(payload, layout.EVENT_HEAD_BYTES)
        if not responses:
            return event_type, call, None
        return event_type, call, read_response(payload, layout.EVENT_HEAD_BYTES + 4)[0]

    return take


def _read_packed(message: StoredMessage, numbers: Numbers) -> Observation:
    # one sequence of bytes, after the header and its length
    seen = unpack_whole(memoryview(message.data)[_PACKED_AT:])
    numbers.note(seen)
    return seen


def _pulse_reader(name: str) -> Read:
    try:
        turn = Turn(name)
    except ValueError as error:
        raise CdrError(f"unknown turn {name!r}") from error

    def read(message: StoredMessage) -> Pulse:
        try:  # the number alone, after the header; a recording of a monitor is half pulses
            (monotonic_ns,) = _int64_at(message.data, _INT64_AT)
        except struct.error as error:
            raise CdrError("it is no turn: it ends too early") from error
        return Pulse(message.received_ns, turn, monotonic_ns)

    return read


def _verdict(message: StoredMessage, data: dict[str, Any], kind: str) -> ReportedVerdict:
    why = None
    if data["expected"] or data["observed"] or data["evidence"]:
        why = Explanation(
            tuple(data["expected"]),
            data["observed"],
            tuple(data["states"]),
            tuple(Evidence(item["stamp_ns"], item["text"]) for item in data["evidence"]),
            tuple(data["places"]),
            data.get("channel", ""),
            tuple(
                Difference(item["path"], item["expected"], item["observed"])
                for item in data.get("differences", ())
            ),
        )
    try:
        outcome = Outcome(data["outcome"])
        cause = Cause(data["cause"]) if data.get("cause") else None
    except ValueError as error:
        raise CdrError(f"unknown outcome {data['outcome']!r} or cause") from error
    verdict = Verdict(
        data["machine"],
        data["node"],
        outcome,
        data["stamp_ns"],
        data["reason"],
        why,
        kind,
        cause=cause,
    )
    return ReportedVerdict(message.received_ns, verdict)
