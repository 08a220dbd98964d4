"""The types that data in a model can have: ROS 2 primitives, arrays and message structures."""

from __future__ import annotations

import msgspec

INTEGER_RANGES: dict[str, tuple[int, int]] = {
    "byte": (0, 2**8 - 1),
    "char": (0, 2**8 - 1),
    **{f"int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)},
    **{f"uint{bits}": (0, 2**bits - 1) for bits in (8, 16, 32, 64)},
}
"""Inclusive ranges of the integer primitives (ROS 2 interface definition, "field types")."""

FLOATS = frozenset({"float32", "float64"})


class Primitive(msgspec.Struct, frozen=True, tag="primitive"):
    """A scalar type, by its ROS name.

    ``bool``, ``string``, ``float32``/``float64``, an integer of :data:`INTEGER_RANGES`, or
    ``number`` (an ECMAScript number of unknown width: untyped data of plain SCXML),
    ``null`` (``null`` and ``undefined``) and ``any`` (nothing is known statically).
    """

    name: str


class Array(msgspec.Struct, frozen=True, tag="array"):
    """``element[]``, ``element[<=length]`` (bounded) or ``element[length]`` (fixed).

    Of several dimensions the outermost is written first: ``T[][5]`` is ``Array(Array(T, 5, True))``.
    """

    element: DataType
    length: int | None = None
    fixed: bool = False


class Structure(msgspec.Struct, frozen=True, tag="structure"):
    """A message type such as ``geometry_msgs/msg/Pose``, or a structure that a system declares.

    ``fields`` are in definition order. ``defaults`` holds the fields' declared default values,
    ``constants`` the named constants.
    An anonymous object (an untyped ``{a: 1}``) has an empty name.
    """

    name: str
    fields: tuple[tuple[str, DataType], ...]
    defaults: tuple[
        tuple[str, bool | int | float | str | tuple[bool | int | float | str, ...]], ...
    ] = ()
    constants: tuple[tuple[str, str, bool | int | float | str], ...] = ()

    def field(self, name: str) -> DataType | None:
        """The type of field ``name``, or None if there is no such field."""
        return next((kind for key, kind in self.fields if key == name), None)


DataType = Primitive | Array | Structure


def part(kind: DataType, name: str) -> DataType | None:
    """The type of ``x.name`` where ``x`` is of type ``kind``; None if it has no such part.

    A field of a structure; of an array of structures the column of that field: ``dim.label`` are the labels
    of all that is in ``dim``.
    """
    if isinstance(kind, Structure):
        return kind.field(name)
    if isinstance(kind, Array) and isinstance(kind.element, Structure) and kind.element.name:
        found = kind.element.field(name)
        return None if found is None else Array(found, kind.length, kind.fixed)
    return None


def only_array(kind: DataType) -> str | None:
    """The field of a structure that has no other and is an array: ``x.length`` is that array's length."""
    if isinstance(kind, Structure) and kind.name and len(kind.fields) == 1:
        name, inner = kind.fields[0]
        return name if isinstance(inner, Array) else None
    return None


BOOL = Primitive("bool")
STRING = Primitive("string")
INT32 = Primitive("int32")
INT64 = Primitive("int64")
FLOAT64 = Primitive("float64")
NUMBER = Primitive("number")
NULL = Primitive("null")
ANY = Primitive("any")


def is_integer(kind: DataType) -> bool:
    """Whether ``kind`` is one of the integer primitives."""
    return isinstance(kind, Primitive) and kind.name in INTEGER_RANGES


def is_number(kind: DataType) -> bool:
    """Whether ``kind`` is numeric: integer, float or ``number``."""
    return isinstance(kind, Primitive) and (
        kind.name in INTEGER_RANGES or kind.name in FLOATS or kind.name == "number"
    )


def is_scalar(kind: DataType) -> bool:
    """Whether ``kind`` is a number's, a string's or a bool's: ECMAScript makes each of them the others."""
    return is_number(kind) or kind in (STRING, BOOL)


def describe(kind: DataType) -> str:
    """``kind`` as a person writes it: ``int32``, ``string[<=3]``, ``geometry_msgs/msg/Pose``."""
    dimensions = ""
    while isinstance(kind, Array):
        length = "" if kind.length is None else f"{'' if kind.fixed else '<='}{kind.length}"
        dimensions += f"[{length}]"
        kind = kind.element
    return f"{kind.name or 'object'}{dimensions}"
