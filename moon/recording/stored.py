"""What a file holds before anything is made of it: messages as bytes, on channels with a type."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Protocol

import msgspec

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MAX_BYTES = 256 * 1024 * 1024
"""The largest message, chunk or record that is read: an uncompressed 8k image has 100 MB."""

MESSAGES_AT_FIRST = 100_000
"""So many messages are read of any file, and one more for each byte that it has on the disk: a recording of
nothing but the smallest ones has 26 bytes for each, compressed. More are a bomb."""

_PIECE_BYTES = 64 * 1024
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
LZ4_MAGIC = b"\x04\x22\x4d\x18"
"""How a file or message begins that is an LZ4 frame."""
ZstdError = zstd.ZstdError


class StoredChannel(msgspec.Struct, frozen=True, eq=False):
    """A topic as a file declares it; each is equal to itself only, and quick to look up.

    Attributes:
        topic: its name.
        type_name: of its messages.
        encoding: of their bytes: ``cdr``…
        schema_encoding: ``ros2msg``, ``ros2idl``… or empty.
        schema: the type's definition, in that encoding.
        metadata: what else the writer recorded of it.
    """

    topic: str
    type_name: str
    encoding: str
    schema_encoding: str = ""
    schema: str = ""
    metadata: Mapping[str, str] = {}


class StoredMessage(msgspec.Struct, frozen=True, gc=False):
    """One message.

    Attributes:
        channel: where it was published.
        received_ns: when the recorder had it.
        published_ns: when it was published; 0 where the file does not say.
        sequence: the number that the recorder gave it.
        data: its bytes.
    """

    channel: StoredChannel
    received_ns: int
    published_ns: int
    sequence: int
    data: bytes


class Storage(Protocol):
    """A file of stored messages.

    Attributes:
        faults: what could not be read so far, one sentence each, with its place.
        metadata: named maps that the writer left in the file, as far as it was read.
        topics: those that it declares, as far as it was read, and the type of each.
        offers: what was offered on each, as it is written there (``offers.offer_of``).
        is_of_two: whether another file begins in it, as far as it was read.
        missing: between which times of recording (ns) something was left out that is damaged, as far as it
            was read.
    """

    faults: list[str]
    metadata: dict[str, Mapping[str, str]]
    topics: dict[str, str]
    offers: dict[str, set[str]]
    is_of_two: bool
    missing: list[tuple[int, int]]

    def messages(self, wanted: Callable[[StoredChannel], bool]) -> Iterator[StoredMessage]:
        """The messages of the channels that are ``wanted``, in order; once."""
        ...


class TooLargeError(ValueError):
    """Compressed data that would be larger than the limit."""


class Allowance:
    """How many messages a file may hold, by its size.

    Args:
        size: of the file, in bytes, as it is stored.
    """

    __slots__ = ("_left", "_most", "_size")

    def __init__(self, size: int) -> None:
        self._size = size
        self._left = self._most = MESSAGES_AT_FIRST + size

    def use(self, count: int = 1) -> None:
        """So many were found; TooLargeError if that is too many in all."""
        self._left -= count
        if self._left < 0:
            raise TooLargeError(
                f"more than {self._most} messages in {self._size} bytes: what comes before was read"
            )


class Unpacked(io.RawIOBase):
    """The decompressed contents of a file, as far as they can be had.

    Attributes:
        fault: why they end before their end; empty if they do not.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.fault = ""
        self._file = path.open("rb")
        self._decompressor = zstd.ZstdDecompressor()

    def readable(self) -> bool:
        """It is."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Fill ``buffer``; 0 at the end, or where the file is damaged."""
        while not self.fault:
            if self._decompressor.eof:
                rest = self._decompressor.unused_data or self._file.read(_PIECE_BYTES)
                if not rest:
                    return 0
                self._decompressor = zstd.ZstdDecompressor()
            elif self._decompressor.needs_input:
                rest = self._file.read(_PIECE_BYTES)
                if not rest:
                    self.fault = "the compressed file ends before its end"
                    return 0
            else:
                rest = b""
            try:
                made = self._decompressor.decompress(rest, len(buffer))
            except ZstdError as error:
                self.fault = f"its compression is damaged: {error}"
                return 0
            if made:
                buffer[: len(made)] = made
                return len(made)
        return 0

    def close(self) -> None:
        """Close the file; idempotent."""
        self._file.close()
        super().close()


def unzstd(data: bytes, limit: int = MAX_BYTES) -> bytes:
    """``data`` decompressed, all its frames; what is cut off at the end is left out.

    Raises:
        TooLargeError: it is longer than ``limit``; no more than that is ever held.
        ZstdError: it is no zstd data.
    """
    made = bytearray()
    while data:
        decompressor = zstd.ZstdDecompressor()
        made += decompressor.decompress(data, limit + 1 - len(made))
        if len(made) > limit:
            raise TooLargeError(f"more than {limit} bytes when decompressed")
        if not decompressor.eof:
            break
        data = decompressor.unused_data
    return bytes(made)


def absolute(topic: str) -> str:
    """``topic`` with the ``/`` before it that tools other than ROS 2's leave out."""
    return topic if topic.startswith("/") else f"/{topic}"


def plural(count: int, noun: str, several: str = "") -> str:
    """``1 message``, ``2 messages``; ``several``: where more is than another ``s``."""
    return f"{count} {noun if count == 1 else several or noun + 's'}"
