"""Default values and constants of interface definitions, as text.

Grammar: https://docs.ros.org/en/jazzy/Concepts/Basic/About-Interfaces.html, "default values" and
"constants".
"""

from __future__ import annotations

import ast
import re

from m2c.language.datatypes import FLOATS, INTEGER_RANGES, Array, DataType, Primitive

Value = bool | int | float | str

_INTEGER = re.compile(
    r"[+-]?(0[xX][0-9a-fA-F]{1,16}|0[bB][01]{1,64}|0[oO][0-7]{1,22}|[0-9]{1,20})\Z"
)
_FLOAT = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,4})?\Z")
_QUOTED = re.compile(r"(\"([^\"\\]|\\.)*\"|'([^'\\]|\\.)*')\Z")
_ESCAPE = re.compile(r"\\(.)", re.DOTALL)
_ESCAPED = "\\'\"abfnrtvxuUN01234567\n"
_ITEM = re.compile(r"\s*(\"(?:[^\"\\]|\\.)*\"|'(?:[^'\\]|\\.)*'|[^,\"']+?)\s*(?:,|\Z)")


def parse_value(text: str, kind: DataType) -> Value | tuple[Value, ...] | None:
    """The value of type ``kind`` that ``text`` is; None if it is none.

    Numbers are range-checked, strings may stand with or without quotes, arrays are in brackets.
    """
    text = text.strip()
    if isinstance(kind, Primitive):
        if kind.name == "string" and not _is_text_of_idl(_without_quotes(text)):
            return None
        return _scalar(text, kind.name)
    if not isinstance(kind, Array) or not isinstance(kind.element, Primitive):
        return None
    if not (text.startswith("[") and text.endswith("]")):
        return None
    items: list[Value] = []
    inner = text[1:-1].rstrip()
    if _lacks_an_item(text[1:-1], kind.element.name == "string"):
        return None
    place = 0
    while place < len(inner):
        match = _ITEM.match(inner, place)
        value = _scalar(match[1], kind.element.name) if match is not None else None
        if match is None or value is None:
            return None
        items.append(value)
        place = match.end()
    if kind.length is not None and (
        len(items) > kind.length or (kind.fixed and len(items) != kind.length)
    ):
        return None
    return tuple(items)


def _lacks_an_item(inner: str, of_texts: bool) -> bool:
    """Whether nothing follows the last comma, or stands in brackets that are not empty.

    ROS 2 takes a comma right before the bracket in an array of strings, and in no other.
    """
    items = inner.rstrip()
    after_comma = items.endswith(",") and not (of_texts and items == inner)
    return bool(inner) and (not items or after_comma)


def _scalar(text: str, base: str) -> Value | None:
    if base == "string":
        return text_value(text)
    if base == "bool":
        return {"true": True, "false": False, "1": True, "0": False}.get(text.lower())
    if base in FLOATS:
        return float(text) if _FLOAT.match(text) else None
    if not _INTEGER.match(text):
        return None
    digits = text.lstrip("+-")
    value = int(digits, 10 if digits.isdigit() else 0) * (-1 if text.startswith("-") else 1)
    low, high = INTEGER_RANGES[base]
    return value if low <= value <= high else None


def text_value(text: str) -> str | None:
    """The string that ``text`` is, with or without quotes; None if its quotes or escapes are wrong."""
    if text[:1] not in ("'", '"'):
        return text
    if not _QUOTED.match(text):
        return None
    try:
        value = str(ast.literal_eval(_with_known_escapes(text)))
        value.encode()
    except (ValueError, SyntaxError):  # an escape that does not exist, or half a surrogate pair
        return None
    return value


def _with_known_escapes(text: str) -> str:
    """``text``, with two backslashes where one begins no escape: it stands for itself then."""
    return _ESCAPE.sub(lambda found: found[0] if found[1] in _ESCAPED else f"\\{found[0]}", text)


def _without_quotes(text: str) -> str:
    is_quoted = text[:1] in ("'", '"') and text.endswith(text[:1])
    return text[1:-1] if is_quoted else text


def _is_text_of_idl(text: str) -> bool:
    """Whether ROS 2 can write ``text`` into the one line of IDL that it makes of a default or constant.

    It replaces the escapes first (``rosidl_adapter.msg.string_to_idl_string_literal``). What ends the line,
    or escapes the quote at its end, cannot be read again.
    """
    try:
        line = _with_known_escapes(text).encode().decode("unicode_escape")
        line.encode("latin-1")
    except UnicodeError:
        return False
    trailing = len(line) - len(line.rstrip("\\"))
    return "\n" not in line and "\r" not in line and trailing % 2 == 0
