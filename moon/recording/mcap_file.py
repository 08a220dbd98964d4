"""MCAP files, read from front to back: https://mcap.dev/spec.

The mcap library's readers need the end of the file, or hand out records that are cut short as if they
were whole; a recording of a crash has no end. Here every record is checked to be all there, a chunk
that is damaged is left out and reported, and no more than one record is held.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from typing import IO

import lz4.frame
from msgspec.structs import astuple

from moon.recording.offers import OFFERED, note_offer
from moon.recording.stored import (
    MAX_BYTES,
    Allowance,
    StoredChannel,
    StoredMessage,
    TooLargeError,
    ZstdError,
    absolute,
    plural,
    unzstd,
)

MAGIC = b"\x89MCAP0\r\n"

_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 1, 2, 3, 4, 5, 6
_METADATA, _DATA_END = 0x0C, 0x0F
_READ = (_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _METADATA, _DATA_END)
"""Others (attachments, indexes) are passed over."""
_LAST_OPCODE = 0x0F
_PRIVATE_OPCODES = 0x80
"""From here on opcodes are applications' own (MCAP specification, "Records")."""

_frame = struct.Struct("<BQ").unpack
_frame_at = struct.Struct("<BQ").unpack_from
_message_at = struct.Struct("<HIQQ").unpack_from
_framed_message_at = struct.Struct("<BQHIQQ").unpack_from
_FRAME_BYTES = 9
_MESSAGE_BYTES = 22
_FRAMED_BYTES = _FRAME_BYTES + _MESSAGE_BYTES
_PIECE_BYTES = 1024 * 1024
_LEADING = 16
"""Records that are looked at for metadata before the first chunk."""


class _DamagedError(ValueError):
    """A record that is not what it should be; the text says how."""


class _Fields:
    """Reads the fields of a record, one after another."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.place = 0

    def take(self, count: int) -> bytes:
        end = self.place + count
        if end > len(self.data):
            raise _DamagedError("a field of it is longer than itself")
        taken = self.data[self.place : end]
        self.place = end
        return taken

    def number(self, size: int) -> int:
        return int.from_bytes(self.take(size), "little")

    def text(self) -> str:
        try:
            return self.take(self.number(4)).decode()
        except UnicodeDecodeError as error:
            raise _DamagedError("a string in it is no UTF-8") from error

    def texts(self) -> dict[str, str]:
        inner = _Fields(self.take(self.number(4)))
        found = {}
        while inner.place < len(inner.data):
            name = inner.text()
            found[name] = inner.text()
        return found


class McapFile:
    """One MCAP file; see ``stored.Storage``.

    Args:
        opened: the file, at its beginning.
        name: how it is called where something is wrong with it.
        size: of the file as it is stored, in bytes: it bounds how many messages are read.
    """

    def __init__(self, opened: IO[bytes], name: str, size: int = 0) -> None:
        self.faults: list[str] = []
        self.metadata: dict[str, Mapping[str, str]] = {}
        self.topics: dict[str, str] = {}
        self.offers: dict[str, set[str]] = {}
        self.complete = False
        """Whether the file was read to its very end."""
        self.is_of_two = False
        """Whether another file begins in it."""
        self.missing: list[tuple[int, int]] = []
        """Between which times of recording (ns) something was left out that is damaged."""
        self._newest_ns = 0
        """When the last chunk that could be read ends."""
        self._is_missing = False
        """Whether something was left out since."""
        self._all_read = False
        self._file = opened
        self._name = name
        self._allowance = Allowance(size)
        self._offset = 0
        self._schemas: dict[int, tuple[str, str, str]] = {}
        self._channels: dict[int, StoredChannel] = {}
        self._wanted: dict[int, StoredChannel] = {}
        self._unwanted: set[int] = set()

    def messages(self, wanted: Callable[[StoredChannel], bool]) -> Iterator[StoredMessage]:
        """The messages of the channels that are ``wanted``, in the order of the file."""
        magic = self._read(len(MAGIC))
        if magic != MAGIC:
            self._fault(0, "it is no MCAP file: it does not begin as one")
            return
        while not self.complete:
            offset = self._offset
            frame = self._read(_FRAME_BYTES)
            if len(frame) < _FRAME_BYTES:
                self._cut(offset if frame else self._offset)
                return
            if frame.startswith(MAGIC):
                self._second(offset)
                return
            opcode, length = _frame(frame)
            if not 0 < opcode <= _LAST_OPCODE and opcode < _PRIVATE_OPCODES:
                self._fault(offset, f"no record begins here (opcode {opcode})")
                return
            if opcode not in _READ or (self._all_read and opcode != _FOOTER):
                if not self._skip(length):
                    self._cut(offset)
                    return
                continue
            if length > MAX_BYTES:
                self._fault(offset, f"a record of {length} bytes; at most {MAX_BYTES} are read")
                return
            data = self._read(length)
            whole = len(data) == length
            try:
                self._allowance.use()
                if opcode == _CHUNK:
                    yield from self._chunk(offset, data, whole, wanted)
                elif whole:
                    yield from self._record(opcode, data, wanted)
            except _DamagedError as error:
                self._fault(offset, f"{error}; it is left out")
                self._is_missing = self._is_missing or opcode in (_CHUNK, _MESSAGE)
            except TooLargeError as too_many:  # a name of its own: mypyc gives a name one type
                self._fault(offset, str(too_many))
                return
            if not whole:
                self._cut(offset)
                return
        offset = self._offset + len(MAGIC)
        if self._read(2 * len(MAGIC)) == MAGIC + MAGIC:
            self._second(offset)

    def skim(self) -> None:
        """Read the metadata at the beginning, and no more."""
        self._read(len(MAGIC))
        for _ in range(_LEADING):
            frame = self._read(_FRAME_BYTES)
            opcode, length = _frame(frame) if len(frame) == _FRAME_BYTES else (0, 0)
            if opcode not in (_HEADER, _METADATA) or length > _PIECE_BYTES:
                return
            data = self._read(length)
            if opcode == _METADATA and len(data) == length:
                try:
                    self._metadata(data)
                except _DamagedError:
                    return

    def _read(self, count: int) -> bytes:
        data = self._file.read(count)
        self._offset += len(data)
        return data

    def _skip(self, count: int) -> bool:
        """Pass over ``count`` bytes; whether there were so many."""
        while count > 0:
            passed = len(self._read(min(count, _PIECE_BYTES)))
            if not passed:
                return False
            count -= passed
        return True

    def _fault(self, offset: int, what: str) -> None:
        self.faults.append(f"{self._name}: byte {offset}: {what}")

    def _second(self, offset: int) -> None:
        """Another file was written behind this one."""
        self.is_of_two = True
        self._fault(offset, "a second MCAP file begins here; it is not read")

    def _cut(self, offset: int) -> None:
        read = "all messages were read" if self._all_read else "what comes before was read"
        self._fault(offset, f"the file ends here, without its end: {read}")

    def _record(
        self, opcode: int, data: bytes, wanted: Callable[[StoredChannel], bool]
    ) -> Iterator[StoredMessage]:
        if opcode == _MESSAGE:
            found = self._message(data, wanted)
            if found is not None:
                yield found
        elif opcode == _SCHEMA:
            self._schema(data)
        elif opcode == _CHANNEL:
            self._channel(data)
        elif opcode == _METADATA:
            self._metadata(data)
        elif opcode == _DATA_END:
            self._all_read = True
        elif opcode == _FOOTER:
            self.complete = True

    def _metadata(self, data: bytes) -> None:
        fields = _Fields(data)
        name = fields.text()
        self.metadata[name] = fields.texts()

    def _schema(self, data: bytes) -> None:
        fields = _Fields(data)
        number, name, encoding = fields.number(2), fields.text(), fields.text()
        text = fields.take(fields.number(4)).decode(errors="replace")
        self._schemas[number] = (name, encoding, text)

    def _channel(self, data: bytes) -> None:
        fields = _Fields(data)
        number, schema = fields.number(2), fields.number(2)
        topic, encoding, metadata = absolute(fields.text()), fields.text(), fields.texts()
        name, schema_encoding, text = self._schemas.get(schema, ("", "", ""))
        self.topics[topic] = name
        note_offer(self.offers, topic, metadata.get(OFFERED, ""))
        made = StoredChannel(topic, name, encoding, schema_encoding, text, metadata)
        known = self._channels.get(number)
        if known is None or astuple(known) != astuple(made):
            self._channels[number] = made
            self._unwanted.discard(number)
            self._wanted.pop(number, None)

    def _message(
        self, data: bytes, wanted: Callable[[StoredChannel], bool]
    ) -> StoredMessage | None:
        if len(data) < _MESSAGE_BYTES:
            raise _DamagedError("a message that is too short")
        number, sequence, received_ns, published_ns = _message_at(data, 0)
        channel = self._wanted.get(number)
        if channel is None:
            if number in self._unwanted:
                return None
            channel = self._channels.get(number)
            if channel is None:
                raise _DamagedError(f"a message of channel {number}, which is not declared")
            if not wanted(channel):
                self._unwanted.add(number)
                return None
            self._wanted[number] = channel
        return StoredMessage(channel, received_ns, published_ns, sequence, data[_MESSAGE_BYTES:])

    def _chunk(
        self,
        offset: int,
        data: bytes,
        whole: bool,
        wanted: Callable[[StoredChannel], bool],
    ) -> Iterator[StoredMessage]:
        """The messages of a chunk; of one that is cut off, those that are all there."""
        fields = _Fields(data)
        begin_ns, end_ns = fields.number(8), fields.number(8)
        size, crc, compression = fields.number(8), fields.number(4), fields.text()
        packed = fields.number(8)
        if whole and packed != len(data) - fields.place:
            raise _DamagedError(f"a chunk of {packed} bytes in {len(data) - fields.place}")
        records = _decompressed(data[fields.place :], compression, size)
        if whole:
            if len(records) != size:
                raise _DamagedError(f"a chunk of {size} bytes has {len(records)}")
            if crc and zlib.crc32(records) != crc:
                raise _DamagedError("a chunk whose checksum is wrong")
        if self._is_missing:
            self.missing.append((min(self._newest_ns, begin_ns), begin_ns))
        self._is_missing, self._newest_ns = False, max(self._newest_ns, end_ns)
        place, end, left_out = 0, len(records), 0
        known, allowance = self._wanted, self._allowance
        while place + _FRAME_BYTES <= end:
            allowance.use()
            if place + _FRAMED_BYTES <= end:  # nearly all are messages of channels that are known
                opcode, length, number, sequence, received_ns, published_ns = _framed_message_at(
                    records, place
                )
                after = place + _FRAME_BYTES + length
                if opcode == _MESSAGE and length >= _MESSAGE_BYTES and after <= end:
                    channel = known.get(number)
                    if channel is not None:
                        begin, place = place + _FRAMED_BYTES, after
                        data = records[begin:after]
                        yield StoredMessage(channel, received_ns, published_ns, sequence, data)
                        continue
            opcode, length = _frame_at(records, place)
            place += _FRAME_BYTES
            if place + length > end:
                break
            record = records[place : place + length]
            place += length
            try:
                if opcode == _MESSAGE:
                    found = self._message(record, wanted)
                    if found is not None:
                        yield found
                elif opcode == _SCHEMA:
                    self._schema(record)
                elif opcode == _CHANNEL:
                    self._channel(record)
            except _DamagedError:
                left_out += 1
        if whole and (left_out or place != end):
            what = plural(left_out, "record") if left_out else "its end"
            self._fault(offset, f"a chunk in which {what} cannot be read")
            self.missing.append((begin_ns, end_ns))


def leading_metadata(opened: IO[bytes]) -> Mapping[str, Mapping[str, str]]:
    """The named maps at the beginning of an MCAP file, before anything else in it."""
    file = McapFile(opened, "")
    file.skim()
    return file.metadata


def _decompressed(data: bytes, compression: str, size: int) -> bytes:
    if size > MAX_BYTES:
        raise _DamagedError(f"a chunk of {size} bytes; at most {MAX_BYTES} are read")
    try:
        match compression:
            case "":
                return data
            case "zstd":
                return unzstd(data, size)
            case "lz4":
                made = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
                if len(made) > size:
                    raise TooLargeError(f"more than {size} bytes when decompressed")
                return bytes(made)
    except (ZstdError, RuntimeError, EOFError, TooLargeError) as error:
        raise _DamagedError(f"a chunk that cannot be decompressed ({error})") from error
    raise _DamagedError(f"a chunk compressed by {compression!r}, which is not known")
