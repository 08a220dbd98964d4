"""What differs between transports is asked of them, and not decided by their names outside ``transports``."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from transports.descriptions import OWN

ROOT = Path(__file__).parents[2]


def decided_by_name(text: str) -> Iterator[int]:
    """The lines where a transport's name is compared, matched or looked up, also by a constant's name."""
    tree = ast.parse(text)
    constants = {
        target.id
        for node in ast.walk(tree)
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant)
        for target in node.targets
        if isinstance(target, ast.Name) and node.value.value in OWN
    }

    def is_name(node: ast.expr | None) -> bool:
        match node:
            case ast.Constant(value):
                return isinstance(value, str) and value in OWN
            case ast.Name(name):
                return name in constants
            case ast.Tuple(items) | ast.List(items) | ast.Set(items):
                return any(map(is_name, items))
            case ast.Dict(keys):
                return any(map(is_name, keys))
        return False

    def is_transport(node: ast.expr) -> bool:
        named = node.attr if isinstance(node, ast.Attribute) else getattr(node, "id", "")
        return named == "transport"

    for node in ast.walk(tree):
        match node:
            case ast.Compare(left, operators, others):
                equal = any(isinstance(operator, ast.Eq | ast.NotEq) for operator in operators)
                named = any(map(is_name, (left, *others)))
                if named or (equal and any(map(is_transport, (left, *others)))):
                    yield node.lineno
            case ast.Match(subject, cases):
                values = [value for case in cases for value in ast.walk(case.pattern)]
                if is_transport(subject) or any(map(is_name, values)):
                    yield node.lineno
            case ast.Dict(keys) if any(map(is_name, keys)):
                yield node.lineno
            case ast.Call(ast.Attribute(attr="startswith" | "endswith"), arguments):
                if any(map(is_name, arguments)):
                    yield node.lineno


@pytest.mark.parametrize(
    "text",
    [
        'transport == "ros2"',
        'if "zenoh" != run.transport: ...',
        'NAME = "simulated"\nrun.transport == NAME',
        "run.transport == OTHER",
        'transport in ("zenoh", "ros2")',
        'match transport:\n    case "zenoh": ...',
        '{"ros2": 1}.get(transport)',
        'transport.startswith("zenoh")',
    ],
)
def test_what_decides_by_a_name_is_found(text: str) -> None:
    assert list(decided_by_name(text))


@pytest.mark.parametrize(
    "text", ["transport in available()", "transport is None", 'connect("zenoh", node, {})']
)
def test_what_asks_is_let_be(text: str) -> None:
    assert not list(decided_by_name(text))


def test_nothing_outside_transports_is_decided_by_a_transports_name() -> None:
    files = [path for folder in ("m2c", "moon") for path in (ROOT / folder).rglob("*.py")]
    found = {
        f"{path.relative_to(ROOT)}:{line}"
        for path in files
        for line in decided_by_name(path.read_text(encoding="utf-8"))
    }
    assert found == set()
