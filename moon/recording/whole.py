"""Observations kept whole: MessagePack, and integers of any size, which it does not have."""

from __future__ import annotations

from typing import Any

import msgspec

from transports.interface import Observation

_LARGE = 1
"""The code of the extension type of an integer of more than 64 bits, as decimal digits."""
_MAX_DIGITS = 4_300
"""Python reads no integer of more (``sys.int_info.default_max_str_digits``): it takes quadratic time."""
_RANGE = range(-(2**63), 2**64)


def pack_whole(seen: Observation) -> bytes:
    """``seen`` as bytes."""
    try:
        return msgspec.msgpack.encode(seen)
    except OverflowError:
        return msgspec.msgpack.encode(msgspec.structs.replace(seen, data=_packable(seen.data)))


def _packable(value: Any) -> Any:
    match value:
        case int() if value not in _RANGE:
            return msgspec.msgpack.Ext(_LARGE, str(value).encode())
        case dict():
            return {key: _packable(item) for key, item in value.items()}
        case list():
            return [_packable(item) for item in value]
        case _:
            return value


def _extension(code: int, data: memoryview) -> Any:
    text = bytes(data)
    digits = text.removeprefix(b"-")
    if code == _LARGE and len(digits) <= _MAX_DIGITS and digits.isdigit():
        return int(text)
    return msgspec.msgpack.Ext(code, text)


unpack_whole = msgspec.msgpack.Decoder(Observation, ext_hook=_extension).decode
"""The observation in bytes; msgspec.DecodeError if there is none."""
