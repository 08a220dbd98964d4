"""What the variables of a machine begin with where the launcher of its node says so: ROS 2's parameters."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

from m2c.language.conversion import to_float32
from m2c.language.datatypes import FLOATS, INTEGER_RANGES
from m2c.runtime.binding import HasParameters
from transports.interface import Transport, TransportError

Machine = TypeVar("Machine")

_TYPE = re.compile(r"(\w+)(?:\[(<=)?(\d*)\])?")


def begun(
    machine: Callable[..., Machine], variables: Mapping[str, tuple[str, str]], transport: Transport
) -> Callable[..., Machine]:
    """The class ``machine``, whose variables begin with what the launcher has set, if it has.

    What other variables are computed from then is that value, as if the model said it.

    Args:
        machine: a generated class of machines.
        variables: its variables by name: what the class calls each, and its type as a model writes it.
        transport: the node's.

    Raises:
        TransportError: a value is not of its variable's type.
    """
    if not isinstance(transport, HasParameters):
        return machine
    values: dict[str, Any] = {}
    for name, (attribute, kind) in variables.items():
        value = transport.given(name, f"what the variable {name} of the model begins with: {kind}")
        if value is None:
            continue
        converted = _converted(value, kind)
        if converted is None:
            raise TransportError(f"the parameter {name} is {value!r}: expected {kind}")
        values[attribute] = converted
    return _beginning_with(machine, values) if values else machine


def _beginning_with(machine: Any, values: Mapping[str, Any]) -> Callable[..., Any]:
    """``machine`` with constants of these values, and variables that have them when it is made."""
    slots = set(machine.__slots__)
    constants = {name: value for name, value in values.items() if name not in slots}
    fixed = type(machine.__name__, (machine,), {"__slots__": (), **constants})

    def made(*arguments: Any, **named: Any) -> Any:
        pending = {name: value for name, value in values.items() if name in slots}

        def assign(self: object, name: str, value: object) -> None:
            object.__setattr__(self, name, pending.pop(name, value))  # the first is the model's

        beginning = type(machine.__name__, (fixed,), {"__slots__": (), "__setattr__": assign})
        instance = beginning(*arguments, **named)
        instance.__class__ = fixed
        return instance

    return made


def _converted(value: Any, kind: str) -> Any:
    """``value`` as one of type ``kind``; None if it is none."""
    match = _TYPE.fullmatch(kind)
    assert match is not None, kind
    element = match[1]
    if "[" not in kind:
        return _scalar(value, element)
    if isinstance(value, str | bytes) or not isinstance(value, Iterable):
        return None
    items = [_scalar(item, element) for item in value]
    most = int(match[3]) if match[3] else math.inf
    fits = len(items) == most if match[3] and not match[2] else len(items) <= most
    return items if fits and None not in items else None


def _scalar(value: Any, kind: str) -> Any:
    if kind == "bool":
        return value if isinstance(value, bool) else None
    if kind == "string":
        return value if isinstance(value, str) else None
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    if kind in FLOATS:
        return to_float32(value) if kind == "float32" else float(value)
    low, high = INTEGER_RANGES[kind]
    return value if isinstance(value, int) and low <= value <= high else None
