"""Writing recordings: entries as they come, into one file or into files of a limited size."""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Mapping
from io import FileIO
from pathlib import Path

import msgspec

from m2c.language.datatypes import Structure
from moon.recording import format as layout
from moon.recording.cdr_writing import HEADER, InexactError, Write, encoder
from moon.recording.definitions import Definitions
from moon.recording.entries import Entry, Event, Pulse, ReportedVerdict
from moon.recording.format import Form, NumberError
from moon.recording.mcap_writing import Compression, McapWriter
from moon.recording.numbers import Numbering, Numbers
from moon.recording.offers import Offer
from moon.recording.source_streams import SourceStream, SourceStreams, Types
from moon.recording.whole import pack_whole
from moon.sinks.topic import message_of
from transports.interface import Closes, Observation
from transports.ros_forms import OWN_PACKAGES

FLUSH_S = 0.5
"""How often what was recorded is handed to the file: no more than this is lost with the process."""
LIBRARY = "m2c-moon"

_NS = 10**9
_MAX_NS = 2**63 - 1

_write_string = encoder(layout.STRING_TYPE)
_write_int64 = encoder(layout.INT64_TYPE)
_write_verdict = encoder(layout.VERDICT_TYPE)
_length = struct.Struct("<I").pack


class Split(msgspec.Struct, frozen=True):
    """When a recording goes on in a new file.

    Attributes:
        size: after so many bytes; 0: never.
        seconds: after so long; 0: never.
    """

    size: int = 0
    seconds: float = 0.0


class RecordingWriter(Closes):
    """Writes one recording.

    Args:
        path: the file; with ``split``, the folder of the files.
        definitions: the types of what is recorded; what has no type there is kept whole.
        compression: of the files.
        split: when to begin a new file.
        offers: what publishers of a topic are known to offer.

    Attributes:
        observations: how many were written.
        whole: how many of them had no exact form in ROS 2.

    Raises:
        FileExistsError: there is something at ``path`` already.
        OSError: it cannot be written.
    """

    def __init__(
        self,
        path: Path,
        definitions: Definitions,
        compression: Compression = Compression.ZSTD,
        split: Split | None = None,
        offers: Mapping[str, Offer] | None = None,
    ) -> None:
        self._offers = offers or {}
        self.path = path
        self.observations = 0
        self.whole = 0
        self._compression = compression
        self._split = split
        self._types = Types(definitions)
        self._files: list[_FileFacts] = []
        self._closed_bytes = 0
        self._topics: dict[tuple[str, str], int] = {}
        if split is not None:
            path.mkdir()
        self._begin()

    def add(self, entry: Entry) -> None:
        """Write one entry.

        Raises:
            OSError: the file cannot be written.
        """
        if self._split is not None and self._is_over(entry.received_ns):
            self._file.close()
            self._list_files()
            self._closed_bytes += self._file.bytes_written
            self._begin()
        if type(entry) is Observation:
            self._add_observation(entry)
        else:
            self._add_other(entry, _fitting(entry.received_ns))

    def _add_other(self, entry: Entry, now_ns: int) -> None:
        match entry:
            case Observation():
                self._add_observation(entry)
            case Pulse():
                data = _encoded(_write_int64, {"data": entry.monotonic_ns})
                self._file.add(self._pulses(entry), now_ns, now_ns, 0, data)
            case ReportedVerdict():
                self._add_verdict(entry, now_ns)
            case _:
                self._add_event(entry, now_ns)

    def flush(self) -> None:
        """Hand what was recorded to the system; OSError if it could not be written."""
        self._file.flush()

    def close(self) -> None:
        """Write what is left; idempotent. OSError if it could not be written."""
        try:
            self._file.close()
        finally:
            if self._split is not None:
                self._list_files()

    @property
    def bytes_written(self) -> int:
        """The size of what is in files by now."""
        return self._closed_bytes + self._file.bytes_written

    def unknown_types(self) -> list[str]:
        """Of which types nothing is known, one sentence each: other tools cannot read those."""
        return [
            f"messages of type {name or '(none)'} can be read from the recording by moon only: "
            f"{'it is not defined' if name else 'they do not name it'} (--interfaces FOLDER)"
            for name in sorted(self._types.unknown)
            if not name.startswith(OWN_PACKAGES)
        ]

    # --- files -------------------------------------------------------------------------------------

    def _begin(self) -> None:
        path = self.path
        if self._split is not None:
            path = path / f"{path.name}_{len(self._files)}.mcap"
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
        file = FileIO(os.open(path, flags, 0o644), "wb")
        metadata = {layout.FORMAT_NAME: {"version": layout.FORMAT_VERSION}}
        self._file = McapWriter(file, self._compression, LIBRARY, metadata)
        self._streams = SourceStreams(self._file, self._types, self._offers)
        self._numbers = Numbers()
        self._own: dict[str, int] = {}
        self._began_ns: int | None = None
        self._files.append(_FileFacts(path.name))

    def _is_over(self, now_ns: int) -> bool:
        assert self._split is not None
        if self._began_ns is None or now_ns < self._began_ns:  # the clock may be set back
            self._began_ns = now_ns
        if self._split.seconds and now_ns - self._began_ns >= self._split.seconds * _NS:
            return True
        return bool(self._split.size) and self._file.bytes_handed >= self._split.size

    def _list_files(self) -> None:
        """What rosbag2 keeps beside the files of a folder, so that its tools open it."""
        current = self._files[-1]
        current.messages = self._file.messages
        current.first_ns, current.last_ns = self._file.span_ns
        for topic, count in self._file.topics().items():
            self._topics[topic] = self._topics.get(topic, 0) + count
        text = _bag_metadata(self._files, self._topics)
        draft = self.path / "metadata.yaml.tmp"
        draft.write_text(text)
        draft.replace(self.path / "metadata.yaml")

    # --- entries -----------------------------------------------------------------------------------

    def _add_observation(self, seen: Observation) -> None:
        self.observations += 1
        stream = None if seen.error else self._streams.stream(seen)
        if stream is not None:
            try:
                self._add_exact(seen, stream)
            except (InexactError, NumberError):
                pass
            else:
                return
        self._add_whole(seen)
        copy = self._streams.copy(seen, stream) if stream is not None else None
        if copy is not None:
            channel, data = copy
            self._file.add(channel, _fitting(seen.received_ns), _fitting(seen.stamp_ns), 0, data)

    def _add_exact(self, seen: Observation, stream: SourceStream) -> None:
        data = stream.encode(seen)
        number = seen.sequence + 1
        if stream.numbering is Numbering.BOTH:
            number = self._numbers.pack(seen)  # -1 fits nowhere
        self._file.add(stream.channel, seen.received_ns, seen.stamp_ns, number, data)

    def _add_whole(self, seen: Observation) -> None:
        self.whole += 1
        self._numbers.note(seen)
        channel = self._channel(
            Form.PACKED, layout.PACKED_TOPIC, layout.PACKED_TYPE, {layout.FORM: Form.PACKED}
        )
        packed = pack_whole(seen)
        data = HEADER + _length(len(packed)) + packed
        self._file.add(channel, _fitting(seen.received_ns), _fitting(seen.stamp_ns), 0, data)

    def _add_event(self, event: Event, now_ns: int) -> None:
        channel = self._channel(
            Form.EVENT, layout.EVENT_TOPIC, layout.STRING_TYPE, {layout.FORM: Form.EVENT}
        )
        data = _encoded(_write_string, {"data": msgspec.json.encode(event).decode()})
        self._file.add(channel, now_ns, now_ns, 0, data)

    def _add_verdict(self, reported: ReportedVerdict, now_ns: int) -> None:
        kind = reported.verdict.kind
        channel = self._channel(
            f"{Form.VERDICT} {kind}",
            layout.VERDICT_TOPIC,
            layout.VERDICT_TYPE,
            {layout.FORM: Form.VERDICT, layout.KIND: kind},
        )
        data = _encoded(_write_verdict, msgspec.to_builtins(message_of(reported.verdict)))
        self._file.add(channel, now_ns, now_ns, 0, data)

    def _pulses(self, pulse: Pulse) -> int:
        return self._channel(
            str(pulse.turn),
            layout.PULSE_TOPIC,
            layout.INT64_TYPE,
            {layout.FORM: Form.PULSE, layout.TURN: str(pulse.turn)},
        )

    def _channel(self, key: str, topic: str, structure: Structure, metadata: dict[str, str]) -> int:
        number = self._own.get(key)
        if number is None:
            number = self._own[key] = self._streams.own(topic, structure, metadata)
        return number


class _FileFacts(msgspec.Struct):
    """One file of a folder, for its metadata."""

    name: str
    messages: int = 0
    first_ns: int = 0
    last_ns: int = 0


def _fitting(instant_ns: int) -> int:
    """``instant_ns``, or the nearest that a file has room for."""
    return min(max(instant_ns, 0), _MAX_NS)


def _encoded(write: Write, value: object) -> bytes:
    out = bytearray(HEADER)
    write(value, out)
    return bytes(out)


def _bag_metadata(files: list[_FileFacts], topics: dict[tuple[str, str], int]) -> str:
    """rosbag2's ``metadata.yaml`` (its version 5), as YAML's subset that JSON is."""
    whole = [item for item in files if item.messages]
    first = min((item.first_ns for item in whole), default=0)
    last = max((item.last_ns for item in whole), default=0)

    def span(start_ns: int, end_ns: int) -> dict[str, object]:
        return {
            "starting_time": {"nanoseconds_since_epoch": start_ns},
            "duration": {"nanoseconds": end_ns - start_ns},
        }

    information = {
        "version": 5,
        "storage_identifier": "mcap",
        "relative_file_paths": [item.name for item in files],
        **span(first, last),
        "message_count": sum(item.messages for item in files),
        "compression_format": "",
        "compression_mode": "",
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic,
                    "type": type_name,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": "",
                },
                "message_count": count,
            }
            for (topic, type_name), count in sorted(topics.items())
        ],
        "files": [
            {
                "path": item.name,
                **span(item.first_ns, item.last_ns),
                "message_count": item.messages,
            }
            for item in files
        ],
    }
    return json.dumps({"rosbag2_bagfile_information": information}, indent=2) + "\n"
