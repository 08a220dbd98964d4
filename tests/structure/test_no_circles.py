"""No file of the project needs, by way of others, itself: each can be read with those below it alone."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).parents[2]
FACES = {"m2c", "transports"}
"""What users import is loaded from below when it is used first."""


def modules() -> dict[str, Path]:
    """All files of the three packages, by the name by which they are imported."""
    found = {}
    for folder in ("m2c", "moon", "transports"):
        for path in (ROOT / folder).rglob("*.py"):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imported(path: Path, known: Mapping[str, Path]) -> Iterator[str]:
    """What a file imports anywhere in it, also for types alone."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            for name in node.names:
                inner = f"{node.module}.{name.name}"
                yield inner if inner in known else node.module
        elif isinstance(node, ast.Import):
            yield from (name.name for name in node.names)


def circles(uses: Mapping[str, set[str]]) -> set[str]:
    """The modules that need themselves."""
    left = {name: set(others) for name, others in uses.items()}
    while free := {name for name, others in left.items() if not others & left.keys()}:
        for name in free:
            del left[name]
    users = {name: {one for one in left if name in left[one]} for name in left}
    while free := {name for name, others in users.items() if not others & users.keys()}:
        for name in free:
            del users[name]
    return set(users)


def test_a_circle_is_found_without_who_uses_it_or_is_used_by_it() -> None:
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"b", "d"}, "d": set()}) == {"b", "c"}


def test_no_files_need_each_other() -> None:
    known = modules()
    uses = {
        name: (set(imported(path, known)) & known.keys()) - {name}
        for name, path in known.items()
        if name not in FACES
    }
    assert circles(uses) == set()
