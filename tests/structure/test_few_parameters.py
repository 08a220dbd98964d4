"""No function has more than seven parameters: what belongs together is one value."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
MOST = 7
PUBLIC = {"moon/api.py: __init__"}
"""A user writes these by name: all but the first few are keywords."""
VALUES = {"moon/oracle/state.py"}
"""Here constructors are those of values, one parameter a field; mypyc leaves out a class that says so."""

Function = ast.FunctionDef | ast.AsyncFunctionDef


def functions(path: Path) -> Iterator[Function]:
    """All of them that are written in a file."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, Function):
            yield node


def parameters(function: Function) -> list[str]:
    """Their names, without that of the object itself."""
    taken = function.args
    names = [item.arg for item in (*taken.posonlyargs, *taken.args, *taken.kwonlyargs)]
    return names[1:] if names[:1] in (["self"], ["cls"]) else names


def test_no_function_has_more_than_seven_parameters() -> None:
    found = {
        f"{path.relative_to(ROOT)}: {function.name}"
        for folder in ("m2c", "moon", "transports")
        for path in (ROOT / folder).rglob("*.py")
        for function in functions(path)
        if len(parameters(function)) > MOST
        and not (str(path.relative_to(ROOT)) in VALUES and function.name == "__init__")
    }
    assert found == PUBLIC
