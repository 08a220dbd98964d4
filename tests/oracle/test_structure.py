"""The oracle's search is put together from objects: what its package says of it is so."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

import moon.oracle

PACKAGE = Path(moon.oracle.__file__).parent
SEARCH = re.findall(r"``(\w+)``(?=[,:])", moon.oracle.__doc__ or "")
FOREIGN = {"Exception", "IntEnum", "msgspec.Struct"}


def test_the_package_names_the_modules_of_the_search() -> None:
    assert {"program", "state", "successors", "search", "explain"} <= set(SEARCH)


@pytest.mark.parametrize("name", SEARCH)
def test_no_class_of_the_search_inherits_from_another(name: str) -> None:
    tree = ast.parse((PACKAGE / f"{name}.py").read_text(encoding="utf-8"))
    classes = [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
    bases = {ast.unparse(base) for node in classes for base in node.bases}
    assert bases <= FOREIGN


@pytest.mark.parametrize("name", SEARCH)
def test_a_module_uses_only_those_that_the_package_names_before_it(name: str) -> None:
    tree = ast.parse((PACKAGE / f"{name}.py").read_text(encoding="utf-8"))
    used = {
        node.module.removeprefix("moon.oracle.")
        for node in tree.body  # not what is imported for types alone
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("moon.oracle.")
    }
    assert used <= set(SEARCH[: SEARCH.index(name)])


def test_the_judge_knows_nothing_of_what_is_received() -> None:
    """It can be read without knowing that observations come late, twice or not at all."""
    text = (PACKAGE / "model_oracle.py").read_text(encoding="utf-8")
    known = {"SourceStreams", "RequestTracking", "TakenMessages", "Held", "Progress", "Clock"}
    assert not {name for name in known if name in text}
    assert "received_ns" not in text
    assert ".sequence" not in text
