"""Values as people read them: ``status: FAILURE (1), is_ok: true, name: 'dock'``.

Whoever shows a message or a variable to a person does it by this module; what programs read stays as it is.

A number is called by a constant of its message's definition where no doubt is possible. The constants called
``<FIELD>_…`` belong to that field. The others belong to the only field that has their type. Nothing is
said where two of them have the value, nor of a constant that stands alone: that is a limit or a default.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from m2c.language.datatypes import Array, DataType, Primitive, Structure, is_integer
from m2c.language.text import single_quoted
from m2c.model.interfaces import InterfaceLibrary
from m2c.printable import printable
from transports.actions.parts import hex_of

IN_A_LINE = 60
"""Characters of a value that are seen at a glance."""
MAX_DATA = 160
"""Characters of a value that are shown."""
MAX_DEPTH = 12
"""Levels of a value that are shown: nobody reads more, and somebody may send thousands."""
_MOST_WHOLE = 1e16
"""Below it a double holds every whole number."""
_SECTIONS = {
    "_SendGoal_Request": "_Goal",
    "_GetResult_Response": "_Result",
    "_FeedbackMessage": "_Feedback",
}
"""The types of an action's messages, and the part of its definition that people write."""


class Word(str):
    """A text that is no value but a word about one: it is shown without quotes."""

    __slots__ = ()


class Wording:
    """What the fields of messages are called.

    Args:
        library: the definitions; None: numbers stay numbers.
    """

    def __init__(self, library: InterfaceLibrary | None = None) -> None:
        self._library = library
        self._kinds: dict[str, Structure | None] = {}

    def kind(self, type_name: str) -> Structure | None:
        """The definition of ``type_name``, as an observation has it; None if it is not known."""
        if self._library is None:
            return None
        if type_name not in self._kinds:
            self._kinds[type_name] = self._library.structure(_section(type_name))
        return self._kinds[type_name]

    def message(self, data: Any, type_name: str) -> str:
        """``data`` of that type in short: ``status: FAILURE (1), is_ok: true``."""
        return compact(data, self.kind(type_name))


def _section(type_name: str) -> str:
    for ending, section in _SECTIONS.items():
        if type_name.endswith(ending):
            return type_name.removesuffix(ending) + section
    return type_name


def compact(data: Any, kind: DataType | None = None) -> str:
    """A message in one short piece of text: ``status: 0, is_ok: true``.

    Args:
        data: maps, lists and scalars.
        kind: its type, if it is known: then numbers have their names.
    """
    structure = kind if isinstance(kind, Structure) else None
    shortly = _fields(data, 0, structure, False) if isinstance(data, dict) else None
    return _cut(_value(data, 0, kind, False) if shortly is None else shortly)


def value_text(value: Any, kind: DataType | None = None) -> str:
    """A value in short, a message with its braces: ``{status: FAILURE (1)}``, ``0.1``, ``'dock'``.

    Numbers have all their digits: two that differ are not shown alike.
    """
    return _cut(_value(value, 0, kind, True))


def field_text(
    value: Any, kind: DataType | None, holder: Structure | None = None, name: str = ""
) -> str:
    """The value of one field as :func:`value_text` shows it within its message.

    Args:
        value: of the field, or of an element of it.
        kind: its type, if it is known.
        holder: the structure that the field is in, if that is known: its constants name numbers.
        name: of the field.
    """
    names = None if holder is None else constant_names(holder).get(name)
    if names is None:
        return value_text(value, kind)
    return _cut(_named(value, 0, names, True))


def is_short(text: str) -> bool:
    """Whether ``text``, of a value, is seen at a glance: with its channel on two lines of 80 columns.

    What matters of a longer one stands before it.
    """
    return len(text) <= IN_A_LINE


def _cut(pieces: Iterator[str]) -> str:
    text = ""
    for piece in pieces:  # a long message (an image) is not written out to be cut off
        text += piece
        if len(text) > MAX_DATA:
            return text[: MAX_DATA - 1] + "…"
    return text


def _fields(
    fields: dict[Any, Any], depth: int, kind: Structure | None, exact: bool
) -> Iterator[str]:
    names = constant_names(kind) if kind is not None else {}
    for place, (key, value) in enumerate(fields.items()):
        yield f"{', ' if place else ''}{printable(str(key))}: "
        named = names.get(key)
        if named is None:
            inner = kind.field(key) if kind is not None and isinstance(key, str) else None
            yield from _value(value, depth, inner, exact)
        else:
            yield from _named(value, depth, named, exact)


def _named(value: Any, depth: int, names: Mapping[int, str], exact: bool) -> Iterator[str]:
    """A number, or an array of numbers, of a field whose values have names."""
    if isinstance(value, list):
        for place, inner in enumerate(value):
            yield ", " if place else "["
            yield from _named(inner, depth + 1, names, exact)
        yield "]" if value else "[]"
        return
    whole = isinstance(value, int) or (isinstance(value, float) and value.is_integer())
    name = names.get(int(value)) if whole and not isinstance(value, bool) else None
    if name is not None:
        yield f"{name} ({int(value)})"
    else:
        yield from _value(value, depth, None, exact)


def _value(value: Any, depth: int, kind: DataType | None, exact: bool) -> Iterator[str]:
    if depth > MAX_DEPTH:
        yield "…"
        return
    match value:
        case None:
            yield "null"
        case bool():
            yield "true" if value else "false"
        case {"uuid": [*_]} if len(value) == 1:
            yield _short_id(value)
        case dict():
            yield "{"
            yield from _fields(
                value, depth + 1, kind if isinstance(kind, Structure) else None, exact
            )
            yield "}"
        case list():
            element = kind.element if isinstance(kind, Array) else None
            for place, inner in enumerate(value):
                yield ", " if place else "["
                yield from _value(inner, depth + 1, element, exact)
            yield "]" if value else "[]"
        case float():
            yield _number(value, exact)
        case Word():
            yield printable(value[: MAX_DATA + 1])
        case str():
            yield printable(single_quoted(value[: MAX_DATA + 1]))
        case bytes():
            yield f"{len(value)} bytes"
        case _:
            yield printable(str(value))


def _number(value: float, exact: bool) -> str:
    if not math.isfinite(value):
        return "NaN" if math.isnan(value) else "-Infinity" if value < 0 else "Infinity"
    return number_text(value, exact)


def number_text(value: float, exact: bool = True) -> str:
    """A finite number: a whole one with all its digits, ``-2147483648``; others in short, ``0.1``.

    Args:
        value: the number.
        exact: all digits that tell it from others, where six do not.
    """
    if value.is_integer() and 0 < abs(value) < _MOST_WHOLE:
        return str(int(value))
    short = f"{value:g}"
    return short if not exact or float(short) == value else repr(value)


def _short_id(value: dict[str, Any]) -> str:
    try:
        return goal_id(value)
    except TypeError:  # something else that is called uuid
        return printable(str(value["uuid"]))


def goal_id(wire: Any) -> str:
    """The first eight hex digits of a ``unique_identifier_msgs/msg/UUID``: enough to tell apart.

    Raises:
        KeyError, TypeError: ``wire`` is no UUID.
    """
    return hex_of(wire["uuid"][:4])


_NAMES: dict[str, tuple[Structure, dict[str, dict[int, str]]]] = {}
"""Of the definition that was asked for last, by its name."""


def constant_names(kind: Structure) -> dict[str, dict[int, str]]:
    """For each integer field of ``kind`` whose values have names: the names, by value."""
    known = _NAMES.get(kind.name)
    if known is None or known[0] is not kind:
        known = _NAMES[kind.name] = (kind, _constant_names(kind))
    return known[1]


def _constant_names(kind: Structure) -> dict[str, dict[int, str]]:
    fields = {name: base for name, field in kind.fields if (base := _base(field))}
    groups: dict[str, list[tuple[str, int]]] = {name: [] for name in fields}
    left: dict[str, list[tuple[str, int]]] = {}
    for name, base, value in kind.constants:
        if isinstance(value, bool) or not isinstance(value, int):
            continue
        prefixed = [field for field in fields if name.startswith(f"{field.upper()}_")]
        owner = max(prefixed, key=len, default="")
        if not owner:
            left.setdefault(base, []).append((name, value))
        elif fields[owner] == base:
            groups[owner].append((name, value))
    for base, constants in left.items():
        of_type = [field for field, other in fields.items() if other == base]
        if len(of_type) == 1 and not groups[of_type[0]]:
            groups[of_type[0]] = constants
    return {field: named for field, found in groups.items() if (named := _by_value(found))}


def _base(kind: DataType) -> str:
    """The integer type of a field, or of the elements of one; "" if it has none."""
    element = kind.element if isinstance(kind, Array) else kind
    return element.name if isinstance(element, Primitive) and is_integer(element) else ""


def _by_value(constants: list[tuple[str, int]]) -> dict[int, str]:
    values = [value for _, value in constants]
    if len(constants) < 2:
        return {}
    return {value: name for name, value in constants if values.count(value) == 1}
