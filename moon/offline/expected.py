"""How much there will be to read in a recording, for a progress bar: what the end of an MCAP file says."""

from __future__ import annotations

import struct
from pathlib import Path

_FOOTER = struct.Struct("<BQQQI8s")
_FOOTER_OPCODE, _STATISTICS_OPCODE = 2, 11
_END = b"\x89MCAP0\r\n"
_MOST_BYTES = 64 * 1024 * 1024
"""A longer summary is not read for this."""


def expected_entries(path: Path) -> int | None:
    """The number of messages at ``path`` (a file, or a folder of them); None if it does not say."""
    try:
        files = sorted(path.glob("*.mcap")) if path.is_dir() else [path]
        counts = [_messages_in(file) for file in files]
    except OSError:
        return None
    return None if not counts or None in counts else sum(count or 0 for count in counts)


def _messages_in(path: Path) -> int | None:
    with path.open("rb") as file:
        size = file.seek(0, 2)
        if size < _FOOTER.size:
            return None
        file.seek(size - _FOOTER.size)
        opcode, _, start, _, _, end = _FOOTER.unpack(file.read(_FOOTER.size))
        length = size - _FOOTER.size - start
        if opcode != _FOOTER_OPCODE or end != _END or not start or not 0 < length <= _MOST_BYTES:
            return None
        file.seek(start)
        summary = file.read(length)
    place = 0
    while place + 17 <= len(summary):
        opcode, length, count = struct.unpack_from("<BQQ", summary, place)
        if opcode == _STATISTICS_OPCODE:
            return int(count)
        place += 9 + length
    return None
