"""Messages both ways: ``msgspec.Struct`` on our side, rosidl's Python classes on rclpy's.

The C code of those classes checks nothing in a release build: an int where it expects a float reads
foreign memory, a bound is not kept, a string ends at its first NUL. So everything that leaves is
checked here, and what is wrong is said with its place in the message.
"""

from __future__ import annotations

import array
import functools
import typing
from collections.abc import Callable
from typing import Any

import msgspec
from rosidl_parser.definition import (
    AbstractNestedType,
    AbstractString,
    AbstractWString,
    Array,
    BasicType,
    BoundedSequence,
    NamespacedType,
)

from transports.interface import Message, TransportError
from transports.payloads import require_type
from transports.ros2.interfaces import ros_class

Convert = Callable[[Any], Any]

_INTEGERS = {
    f"{sign}int{bits}": (0, 2**bits - 1) if sign else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    for sign in ("", "u")
    for bits in (8, 16, 32, 64)
}
_ARRAY_CODES = {
    **{"int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I"},
    **{"int64": "q", "uint64": "Q", "float": "f", "double": "d"},
}
"""Codes of ``array.array`` for what rosidl keeps in one."""
_FLOAT32_MAX = 3.4028235677973366e38
"""What rounds to infinity as a float32: the largest one and half a step."""


class _WrongError(Exception):
    """A value that does not fit; ``path`` grows on the way out."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.path = ""


def type_name_of(namespaced: NamespacedType) -> str:
    """``pkg/msg/Name``."""
    return "/".join((*namespaced.namespaces, namespaced.name))


class Codec:
    """Converts the messages of one type both ways.

    Args:
        type_name: the ROS type.
        message: our class for it.

    Raises:
        TransportError: the type is not installed, or its fields are not those of ``message``.
    """

    __slots__ = ("_decode", "_encode", "_message", "ros", "type_name")

    def __init__(self, type_name: str, message: type[Message]) -> None:
        self.type_name = type_name
        self.ros = ros_class(type_name)
        self._message = message
        self._encode = _encoder(self.ros, message, type_name)
        self._decode = _decoder(self.ros, message)

    def encode(self, message: Message) -> Any:
        """A message of rclpy; TransportError if ``message`` is of another type or has a wrong value."""
        if message.__class__ is not self._message:
            require_type(message, self.type_name)
        try:
            return self._encode(message)
        except _WrongError as error:
            raise TransportError(f"{self.type_name}{error.path}: {error}") from error

    def decode(self, message: Any) -> Any:
        """Our message."""
        return self._decode(message)


def plain_of(message: Any) -> dict[str, Any]:
    """A message of rclpy as maps, lists and scalars."""
    return {name: convert(getattr(message, name)) for name, convert in _plain(message.__class__)}


@functools.lru_cache(maxsize=1024)
def _plain(ros: Any) -> tuple[tuple[str, Convert], ...]:
    return tuple((name, _value_reader(kind, plain_of)) for name, kind in _fields(ros))


def _fields(ros: Any) -> list[tuple[str, Any]]:
    return list(zip(ros.get_fields_and_field_types(), ros.SLOT_TYPES, strict=True))


def _attributes(message: type[Message]) -> dict[str, str]:
    """Our attribute for each field: another than its name where that is a word of Python."""
    return dict(zip(message.__struct_encode_fields__, message.__struct_fields__, strict=True))


# --- out ------------------------------------------------------------------------------------------


@functools.lru_cache(maxsize=1024)
def _encoder(ros: Any, message: type[Message], place: str) -> Convert:
    fields = _fields(ros)
    attributes = _attributes(message)
    ours = set(attributes)
    theirs = {name for name, _ in fields}
    if ours != theirs:
        raise TransportError(
            f"{place}: the model's fields are {_listed(ours)}, those of the ROS 2 package that is "
            f"installed {_listed(theirs)}; build it anew from the model's interfaces"
        )
    inner = typing.get_type_hints(message, include_extras=True)
    steps = tuple(
        (
            name,
            attributes[name],
            f"_{name}",
            _writer(kind, inner[attributes[name]], f"{place}.{name}"),
        )
        for name, kind in fields
    )
    new = ros.__new__

    def encode(value: Any) -> Any:
        made = new(ros)
        made._check_fields = False
        name = ""
        try:
            for name, attribute, slot, convert in steps:  # noqa: B007 - told when it fails
                setattr(made, slot, convert(getattr(value, attribute)))
        except _WrongError as error:
            error.path = f".{name}{error.path}"
            raise
        except AttributeError as error:
            wrong = _WrongError(f"expected a message, got {value!r}")
            raise wrong from error
        return made

    return encode


def _listed(names: set[str]) -> str:
    return ", ".join(sorted(names)) or "none"


def _struct_in(annotation: Any) -> Any:
    """The struct class inside ``list[X]``, ``Annotated[list[X], …]`` or ``X`` itself."""
    while (arguments := typing.get_args(annotation)) and not isinstance(annotation, type):
        annotation = arguments[0]
    if arguments := typing.get_args(annotation):
        return _struct_in(arguments[0])
    if isinstance(annotation, type) and issubclass(annotation, msgspec.Struct):
        return annotation
    return None


def _nested(kind: NamespacedType, annotation: Any, place: str) -> tuple[Any, type[Message]]:
    struct = _struct_in(annotation)
    if struct is None:
        raise TransportError(
            f"{place}: ROS 2 has {type_name_of(kind)} here, the model {annotation}"
        )
    return ros_class(type_name_of(kind)), struct


def _writer(kind: Any, annotation: Any, place: str) -> Convert:
    if isinstance(kind, AbstractNestedType):
        return _sequence_writer(kind, annotation, place)
    if isinstance(kind, NamespacedType):
        ros, struct = _nested(kind, annotation, place)
        return _encoder(ros, struct, place)
    return _scalar_writer(kind)


def _scalar_writer(kind: Any) -> Convert:
    if isinstance(kind, AbstractString | AbstractWString):
        limit = kind.maximum_size if kind.has_maximum_size() else None
        return _text_writer(limit, isinstance(kind, AbstractString))
    name = kind.typename
    if name in _INTEGERS:
        return _integer_writer(name)
    if name == "boolean":
        return _boolean
    if name == "octet":
        octet = _integer_writer("uint8")
        return lambda value: bytes((octet(value),))
    if name == "double":
        return _double
    if name == "float":
        return _single
    raise TransportError(f"fields of type {name} are not supported")


def _integer_writer(name: str) -> Convert:
    least, most = _INTEGERS[name]

    def integer(value: Any) -> int:
        number: int = value
        if type(value) is not int:
            if type(value) is not float or not value.is_integer():
                raise _WrongError(f"{value!r} is not an integer")
            number = int(value)
        if not least <= number <= most:
            raise _WrongError(f"{number} does not fit in {name}")
        return number

    return integer


def _boolean(value: Any) -> bool:
    if value is True or value is False:
        return bool(value)
    raise _WrongError(f"{value!r} is not a boolean")


def _double(value: Any) -> float:
    if type(value) is float:
        return value
    if type(value) is int:
        try:
            return float(value)
        except OverflowError:
            raise _WrongError("an integer too large for a double") from None
    raise _WrongError(f"{value!r} is not a number")


def _single(value: Any) -> float:
    number = _double(value)
    if _FLOAT32_MAX <= abs(number) < float("inf"):
        raise _WrongError(f"{value!r} does not fit in a float32")
    return number


def _text_writer(limit: int | None, ends_at_nul: bool) -> Convert:
    def text(value: Any) -> str:
        if not isinstance(value, str):
            raise _WrongError(f"{value!r} is not a string")
        if ends_at_nul and "\0" in value:
            raise _WrongError("a string of ROS 2 cannot hold the character NUL")
        try:
            length = len(value.encode()) if ends_at_nul else len(value.encode("utf-16-le")) // 2
        except UnicodeEncodeError:
            raise _WrongError(f"{value!r} is not Unicode text") from None
        if limit is not None and length > limit:
            raise _WrongError(f"a string of length {length}; at most {limit} fits")
        return value

    return text


def _sequence_writer(kind: Any, annotation: Any, place: str) -> Convert:
    element = kind.value_type
    least, most = 0, None
    if isinstance(kind, Array):
        least = most = kind.size
    elif isinstance(kind, BoundedSequence):
        most = kind.maximum_size
    code = _ARRAY_CODES.get(element.typename) if isinstance(element, BasicType) else None
    convert = _writer(element, annotation, place)
    exact = isinstance(kind, Array)

    def check(value: Any) -> None:
        if not isinstance(value, list | tuple | bytes | bytearray):
            raise _WrongError(f"{value!r} is not a list")
        if len(value) < least or (most is not None and len(value) > most):
            wanted = f"{least}" if exact else f"at most {most}"
            raise _WrongError(f"{len(value)} elements; expected {wanted}")

    def items(value: Any) -> list[Any]:
        check(value)
        made = []
        try:
            for item in value:
                made.append(convert(item))
        except _WrongError as error:
            error.path = f"[{len(made)}]{error.path}"
            raise
        return made

    if code is None:
        return items

    def packed(value: Any) -> Any:
        check(value)
        # bytes would be taken for the memory of other types, a float32 for one that fits
        one_by_one = code == "f" or (code != "B" and isinstance(value, bytes | bytearray))
        try:
            made = array.array(code, items(value) if one_by_one else value)
        except (TypeError, OverflowError):
            made = array.array(code, items(value))  # which says what is wrong, and where
        return _as_numpy(made) if exact else made

    return packed


def _as_numpy(values: array.array[Any]) -> Any:
    import numpy  # rosidl keeps arrays of fixed size in it

    return numpy.frombuffer(values, dtype=_NUMPY_TYPES[values.typecode])


_NUMPY_TYPES = {
    **{"b": "int8", "B": "uint8", "h": "int16", "H": "uint16", "i": "int32", "I": "uint32"},
    **{"q": "int64", "Q": "uint64", "f": "float32", "d": "float64"},
}


# --- in -------------------------------------------------------------------------------------------


@functools.lru_cache(maxsize=1024)
def _decoder(ros: Any, message: type[Message]) -> Convert:
    hints = typing.get_type_hints(message, include_extras=True)
    attributes = _attributes(message)
    steps = []
    for name, kind in _fields(ros):
        attribute = attributes[name]
        element = kind.value_type if isinstance(kind, AbstractNestedType) else kind
        nested: Convert = plain_of
        if isinstance(element, NamespacedType):
            inner, struct = _nested(element, hints[attribute], name)
            nested = _decoder(inner, struct)
        steps.append((attribute, name, _value_reader(kind, nested)))
    order = {attribute: index for index, attribute in enumerate(message.__struct_fields__)}
    steps.sort(key=lambda step: order[step[0]])
    getters = tuple((name, convert) for _, name, convert in steps)
    if message.__match_args__ != message.__struct_fields__:  # some are keyword-only
        names = message.__struct_fields__
        return lambda value: message(
            **{
                attribute: convert(getattr(value, name))
                for attribute, (name, convert) in zip(names, getters, strict=True)
            }
        )
    return lambda value: message(*[convert(getattr(value, name)) for name, convert in getters])


def _value_reader(kind: Any, nested: Convert) -> Convert:
    """What a field of rclpy's message means; ``nested`` reads a message in it."""
    if not isinstance(kind, AbstractNestedType):
        if isinstance(kind, NamespacedType):
            return nested
        return _octet if isinstance(kind, BasicType) and kind.typename == "octet" else _same
    element = kind.value_type
    if isinstance(element, NamespacedType):
        return lambda values: [nested(value) for value in values]
    if isinstance(element, BasicType):
        if element.typename in _ARRAY_CODES:
            return lambda values: values.tolist()
        if element.typename == "octet":
            return lambda values: [value[0] for value in values]
    return list


def _same(value: Any) -> Any:
    return value


def _octet(value: bytes) -> int:
    return value[0]
