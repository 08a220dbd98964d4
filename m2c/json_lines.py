"""JSON for pipes, an object a line, that a terminal may show as well."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import msgspec

from m2c.json_format import VERSION, VERSION_KEY

_HEAD = f'{{"{VERSION_KEY}":{VERSION}'.encode()


def is_versioned(line: str) -> bool:
    """Whether ``line`` begins as one of :func:`versioned_line`."""
    return line.startswith(_HEAD.decode())


def versioned_line(value: Any, encode: Callable[[Any], bytes] = msgspec.json.encode) -> bytes:
    """``value``, which is an object in JSON, as a line that says of which version its format is.

    Args:
        value: see :func:`as_line`.
        encode: see :func:`as_line`.
    """
    rest = as_line(value, encode)[1:]
    return _HEAD + (rest if rest == b"}" else b"," + rest)


def as_line(value: Any, encode: Callable[[Any], bytes] = msgspec.json.encode) -> bytes:
    """``value`` as one line of JSON (RFC 8259), without its end.

    JSON itself escapes only what is below U+0020. Here every character that cannot be printed is an
    escape (RFC 8259 section 7), which every reader takes for the same text.

    Args:
        value: what ``encode`` takes.
        encode: of an encoder that knows more types than msgspec's.
    """
    try:
        line = encode(value)
    except UnicodeEncodeError:  # lone surrogates: of a file's name that is no UTF-8 (PEP 383)
        return json.dumps(msgspec.to_builtins(value), separators=(",", ":")).encode()
    if line.isascii() and b"\x7f" not in line:
        return line
    return "".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in line.decode()).encode()
