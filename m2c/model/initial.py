"""The values that a machine's variables begin with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from m2c.language.datatypes import Array
from m2c.language.evaluate import evaluate
from m2c.language.expressions import (
    ArrayLiteral,
)
from m2c.language.values import convert, zero
from m2c.model.machine import Data


def initial_value(data: Data, values: Mapping[str, Any], lenient: bool = False) -> Any:
    """What ``data`` begins with, as plain data.

    Args:
        data: a variable whose initial value is settled.
        values: of the variables before it.
        lenient: whether strings, numbers and bools become one another.

    Raises:
        ExecutionError: it cannot be evaluated, or does not fit the variable's type.
    """
    is_empty = isinstance(data.initial, ArrayLiteral) and not data.initial.elements
    if is_empty and isinstance(data.type, Array):
        return zero(data.type)
    return convert(evaluate(data.initial, values, {}), data.type, lenient)
