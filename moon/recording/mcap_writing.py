"""Writing MCAP (https://mcap.dev/spec): whole chunks, handed to the file as they fill or grow old.

Records are those of the mcap library, except messages and their index: its writer takes ten times as long
for each, at 50,000 messages a second a tap's whole time. Chunks are compressed and
written on a thread of their own, so that whoever listens waits for no disk. What was handed to the
system survives the end of the process, even by SIGKILL: every record is one ``write(2)``.
"""

from __future__ import annotations

import queue
import struct
import sys
import threading
import zlib
from collections.abc import Callable, Mapping
from enum import StrEnum
from io import FileIO

import lz4.frame
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from moon.recording.mcap_file import MAGIC

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

CHUNK_BYTES = 1024 * 1024
"""A chunk is written when it has so many; what a reader must hold at once."""
_WAITING_CHUNKS = 64
"""Chunks that wait for the disk; then the recorder waits too, and the tap's ring takes up the slack."""
ZSTD_LEVEL = 1
"""The quickest: a recorder must not fall behind."""
MAX_CHANNELS = 60_000
"""A file has room for 65 535."""

_message = struct.Struct("<BQHIQQ").pack
_MESSAGE = int(Opcode.MESSAGE)
_MESSAGE_BYTES = 22
_FRAME_BYTES = 9


class Compression(StrEnum):
    """How chunks are compressed."""

    NONE = "none"
    ZSTD = "zstd"
    LZ4 = "lz4"


_COMPRESS: Mapping[Compression, Callable[[bytes], bytes]] = {
    Compression.NONE: bytes,
    Compression.ZSTD: lambda data: zstd.compress(data, level=ZSTD_LEVEL),
    Compression.LZ4: lz4.frame.compress,
}


class _OpenChunk:
    """A chunk that is being filled."""

    __slots__ = ("data", "index")

    def __init__(self) -> None:
        self.data = bytearray()
        self.index: dict[int, list[int]] = {}
        """Of each channel: log time and offset of each message, in turn."""


class McapWriter:
    """Writes one file.

    Args:
        file: where to; opened for writing, unbuffered. It is closed by ``close``.
        compression: of the chunks.
        library: the name of the writing program.
        metadata: named maps that describe the whole file.

    Raises:
        OSError: the file cannot be written.
    """

    def __init__(
        self,
        file: FileIO,
        compression: Compression,
        library: str,
        metadata: Mapping[str, Mapping[str, str]] | None = None,
    ) -> None:
        self._file = file
        self._compression = compression
        self._offset = 0
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._counts: dict[int, int] = {}
        self._first_ns = self._last_ns = 0
        self._chunks: list[bytes] = []
        """The index of each, as it is written at the end."""
        self._metadata: list[MetadataIndex] = []
        self._open = _OpenChunk()
        self._handed = self._taken = 0
        """Bytes of messages: handed to the writing thread, and written by it."""
        self._failure: OSError | None = None
        self._write(MAGIC)
        self._write(_record(Header("ros2", library)))
        for name, values in (metadata or {}).items():
            data = _record(Metadata(name, dict(values)))
            self._metadata.append(MetadataIndex(self._offset, len(data), name))
            self._write(data)
        self._waiting: queue.Queue[_OpenChunk | None] = queue.Queue(_WAITING_CHUNKS)
        self._thread = threading.Thread(target=self._work, name="mcap-writer", daemon=True)
        self._thread.start()

    @property
    def bytes_written(self) -> int:
        """The length of the file by now."""
        return self._offset

    @property
    def bytes_handed(self) -> int:
        """How long the file will be, at most about, when what waits for the disk is written."""
        return self._offset + self._handed - self._taken

    def schema(self, name: str, encoding: str, text: str) -> int:
        """Declare a type; its number."""
        made = Schema(len(self._schemas) + 1, text.encode(), encoding, name)
        self._schemas.append(made)
        self._open.data += _record(made)
        return made.id

    def channel(self, topic: str, schema: int, metadata: Mapping[str, str]) -> int:
        """Declare a channel of CDR messages; its number."""
        made = Channel(len(self._channels) + 1, topic, "cdr", dict(metadata), schema)
        self._channels.append(made)
        self._counts[made.id] = 0
        self._open.data += _record(made)
        return made.id

    @property
    def messages(self) -> int:
        """How many are written."""
        return sum(self._counts.values())

    @property
    def span_ns(self) -> tuple[int, int]:
        """The log times of the first and the last message, of what is written."""
        return self._first_ns, self._last_ns

    def topics(self) -> dict[tuple[str, str], int]:
        """How many messages are written of each topic and type."""
        found: dict[tuple[str, str], int] = {}
        for channel in self._channels:
            place = (channel.topic, self._schemas[channel.schema_id - 1].name)
            found[place] = found.get(place, 0) + self._counts[channel.id]
        return found

    @property
    def is_full(self) -> bool:
        """Whether no more channels can be declared."""
        return len(self._channels) >= MAX_CHANNELS

    def add(
        self, channel: int, log_ns: int, publish_ns: int, sequence: int, data: bytes | bytearray
    ) -> None:
        """Add a message.

        Args:
            channel: its channel's number.
            log_ns: when it was recorded.
            publish_ns: when it was published.
            sequence: its number, 0 to 2³²-1.
            data: its bytes.

        Raises:
            OSError: an earlier chunk could not be written.
            struct.error: a number is too large for its field; nothing is added then.
        """
        chunk = self._open
        buffer = chunk.data
        place = len(buffer)
        buffer += _message(
            _MESSAGE, _MESSAGE_BYTES + len(data), channel, sequence, log_ns, publish_ns
        )
        buffer += data
        try:
            chunk.index[channel] += (log_ns, place)
        except KeyError:
            chunk.index[channel] = [log_ns, place]
        if place >= CHUNK_BYTES:
            self.flush()

    def flush(self) -> None:
        """Hand what is open to the file.

        Raises:
            OSError: an earlier chunk could not be written.
        """
        if self._failure is not None:
            raise self._failure
        if self._open.index:
            self._handed += len(self._open.data)
            self._waiting.put(self._open)
            self._open = _OpenChunk()

    def close(self) -> None:
        """Write what is left, and the summary; idempotent.

        Raises:
            OSError: something could not be written; the file is closed all the same.
        """
        if self._file.closed:
            return
        try:
            if self._failure is None:
                self.flush()
            self._waiting.put(None)
            self._thread.join()
            if self._failure is not None:
                raise self._failure
            if self._open.data:  # declared, and never used
                self._write(bytes(self._open.data))
            self._write(_record(DataEnd(0)))
            self._write(self._summary())
        finally:
            self._file.close()

    # --- on the writing thread ---------------------------------------------------------------------

    def _work(self) -> None:
        while (chunk := self._waiting.get()) is not None:
            if self._failure is not None:
                continue
            try:
                self._write_chunk(chunk)
            except OSError as error:
                self._failure = error
            self._taken += len(chunk.data)

    def _write_chunk(self, chunk: _OpenChunk) -> None:
        raw = bytes(chunk.data)
        first_ns = min(min(entries[::2]) for entries in chunk.index.values())
        last_ns = max(max(entries[::2]) for entries in chunk.index.values())
        data = _COMPRESS[self._compression](raw)
        name = "" if self._compression is Compression.NONE else str(self._compression)
        record = _record(
            Chunk(
                compression=name,
                data=data,
                message_end_time=last_ns,
                message_start_time=first_ns,
                uncompressed_crc=zlib.crc32(raw),
                uncompressed_size=len(raw),
            )
        )
        start, index_start = self._offset, self._offset + len(record)
        offsets: dict[int, int] = {}
        indexes = bytearray()
        for channel, entries in chunk.index.items():
            offsets[channel] = index_start + len(indexes)
            count = len(entries)
            indexes += struct.pack(
                f"<BQHI{count}Q", Opcode.MESSAGE_INDEX, 6 + 8 * count, channel, 8 * count, *entries
            )
            self._counts[channel] += count // 2
        self._write(record + indexes)
        self._first_ns = min(self._first_ns, first_ns) if self._chunks else first_ns
        self._last_ns = max(self._last_ns, last_ns)
        index = ChunkIndex(
            chunk_length=len(record),
            chunk_start_offset=start,
            compression=name,
            compressed_size=len(data),
            message_end_time=last_ns,
            message_index_length=len(indexes),
            message_index_offsets=offsets,
            message_start_time=first_ns,
            uncompressed_size=len(raw),
        )
        self._chunks.append(_record(index))

    def _write(self, data: bytes | bytearray) -> None:
        view = memoryview(data)
        while view:
            written = self._file.write(view)
            self._offset += written
            view = view[written:]

    # --- at the end --------------------------------------------------------------------------------

    def _summary(self) -> bytes:
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=dict(self._counts),
            chunk_count=len(self._chunks),
            message_count=self.messages,
            message_end_time=self._last_ns,
            message_start_time=self._first_ns,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )
        groups = (
            (Opcode.SCHEMA, [_record(schema) for schema in self._schemas]),
            (Opcode.CHANNEL, [_record(channel) for channel in self._channels]),
            (Opcode.STATISTICS, [_record(statistics)]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.METADATA_INDEX, [_record(index) for index in self._metadata]),
        )
        start = self._offset
        summary, offsets = bytearray(), bytearray()
        for opcode, records in groups:
            data = b"".join(records)
            if data:
                offsets += _record(SummaryOffset(opcode, start + len(summary), len(data)))
            summary += data
        offsets_start = start + len(summary)
        summary += offsets
        summary += struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offsets_start)
        footer = _record(Footer(start, offsets_start, zlib.crc32(summary)))
        return bytes(summary[: -_FRAME_BYTES - 16]) + footer + MAGIC


def _record(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    # the library declares no type for what `end` returns: the bytes of the record
    made: bytes = builder.end()  # type: ignore[no-untyped-call]
    return made
