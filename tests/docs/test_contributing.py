"""The files that CONTRIBUTING.md sends a newcomer to are there, with what it says to look for."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
PATHS = sorted({path for path in re.findall(r"`([\w.]+(?:/[\w.-]+)+)`", TEXT) if "*" not in path})
QUESTIONS = re.findall(r"^\| (.+\?) \| `(.+)` \| `(.+)` \|$", TEXT, re.MULTILINE)


@pytest.mark.parametrize("path", PATHS)
def test_a_path_that_is_named_is_there(path: str) -> None:
    assert (ROOT / path).exists()


@pytest.mark.parametrize(("question", "file", "name"), QUESTIONS)
def test_the_file_that_answers_a_question_has_what_to_look_for(
    question: str, file: str, name: str
) -> None:
    defined = rf"^\s*(?:def|class) {name}\b|^{name}\b"
    assert re.search(defined, (ROOT / file).read_text(encoding="utf-8"), re.MULTILINE), question


def test_ten_questions_and_the_path_from_a_tick_to_its_verdict_are_answered() -> None:
    assert len(QUESTIONS) >= 10
    path = TEXT[TEXT.index("## From a tick to its verdict") :]
    assert path.index("m2c/policy/runner.py") < path.index("transports/zenoh/tap.py")
    assert path.index("transports/zenoh/tap.py") < path.index("moon/verdict.py")


def test_the_table_of_what_runs_names_targets_that_there_are_and_forgets_none_of_the_long_ones() -> (
    None
):
    phony = re.search(r"^\.PHONY: (.+)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert phony is not None
    rows = re.findall(r"^\| `make (\w+)` \|", TEXT, re.MULTILINE)
    assert set(rows) <= set(phony[1].split())
    parts = {
        "lint",
        "types",
        "imports",
        "unit",
        "interfaces",
        "browser",
        "scxml-tests",
    }  # of `make test`
    assert set(phony[1].split()) - set(rows) == parts | {"interpreted", "clean"}
