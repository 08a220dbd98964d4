"""Structural equality of machines, whatever file and line their parts stand at."""

from __future__ import annotations

from typing import Any

import msgspec

from m2c.diagnostics import Position
from m2c.language.expressions import EventData
from m2c.model.machine import Machine


class Shapes:
    """Shapes of machines that share most of their parts: what is shared is looked at once."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[object, Any]] = {}

    def of(self, machine: Machine) -> Any:
        """A hashable value, equal for machines that differ in positions only."""
        return self._struct(machine)

    def _struct(self, value: msgspec.Struct) -> Any:
        known = self._known.get(id(value))
        if known is not None:
            return known[1]
        kind = type(value)
        if isinstance(value, EventData):
            shape: Any = (kind, value.part)
        else:
            fields = (getattr(value, name) for name in kind.__struct_fields__)
            shape = (kind, *(self._value(field) for field in fields))
        hashed = _Hashed(shape)
        self._known[id(value)] = (value, hashed)  # the value is kept: its id stays its own
        return hashed

    def _value(self, value: Any) -> Any:
        match value:
            case Position():
                return None
            case msgspec.Struct():
                return self._struct(value)
            case tuple():
                return tuple(self._value(item) for item in value)
            case _:
                return (type(value), repr(value))  # 1 is not 1.0 nor true, NaN is itself


class _Hashed:
    """A tuple whose hash is computed once."""

    __slots__ = ("_hash", "_value")

    def __init__(self, value: tuple[Any, ...]) -> None:
        self._value = value
        self._hash = hash(value)

    def __hash__(self) -> int:
        return self._hash

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, _Hashed):
            return NotImplemented
        return self is other or (self._hash == other._hash and self._value == other._value)
