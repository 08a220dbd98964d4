"""The page of the Python interface is what the docstrings say, and its examples run."""

from __future__ import annotations

import doctest
import importlib
import runpy
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
SCRIPT: dict[str, Any] = runpy.run_path(str(ROOT / "docs" / "api.py"))


def test_the_page_is_what_the_docstrings_say() -> None:
    committed = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    assert committed == SCRIPT["page"](), "run `python docs/api.py`"


@pytest.mark.parametrize("package", SCRIPT["PACKAGES"])
def test_every_name_of_the_interface_is_on_the_page(package: str) -> None:
    exported = importlib.import_module(package).__all__
    assert SCRIPT["names_of"](package) == exported
    lines = SCRIPT["page"]().splitlines()
    for name in exported:
        assert any(
            line == f"### `{package}.{name}`" or line.startswith(f"| `{name}` |") for line in lines
        ), name


@pytest.mark.parametrize("package", SCRIPT["PACKAGES"])
def test_the_examples_of_a_package_run(package: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    result = doctest.testmod(importlib.import_module(package))
    assert result.attempted > 0
    assert result.failed == 0
