"""What a file holds before anything is made of it: messages as bytes, on channels with a type."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import IO, Protocol, cast

import msgspec

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MAX_BYTES = 256 * 1024 * 1024
"""The largest message, chunk or record that is read: an uncompressed 8k image has 100 MB."""

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
ZstdError = zstd.ZstdError


class StoredChannel(msgspec.Struct, frozen=True, eq=False):
    """A topic as a file declares it; each is equal to itself only, and quick to look up.

    Attributes:
        topic: its name.
        type_name: of its messages.
        encoding: of their bytes: ``cdr``…
        schema_encoding: ``ros2msg``, ``ros2idl``… or empty.
        schema: the type's definition, in that encoding.
        metadata: what else the writer said of it.
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
    """

    faults: list[str]
    metadata: dict[str, Mapping[str, str]]

    def messages(self, wanted: Callable[[StoredChannel], bool]) -> Iterator[StoredMessage]:
        """The messages of the channels that are ``wanted``, in order; once."""
        ...


class TooLargeError(ValueError):
    """Compressed data that would be larger than the limit."""


def open_zstd(path: Path) -> IO[bytes]:
    """The decompressed contents of a file, read as they are asked for."""
    return cast("IO[bytes]", zstd.open(path, "rb"))


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


def plural(count: int, noun: str) -> str:
    """``1 message``, ``2 messages``."""
    return f"{count} {noun}{'s' * (count != 1)}"
