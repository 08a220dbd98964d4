"""The page on ``moon tap`` names all there is, and no option that there is not."""

from __future__ import annotations

import re
from pathlib import Path

import click
import msgspec
import pytest

from moon.tap.command import tap
from moon.tap.selection import KINDS
from moon.tap.statistics import Row
from moon.tap.stream import MAX_OPEN_CALLS, Line

PAGE = (Path(__file__).parents[2] / "docs" / "commands" / "moon-tap.md").read_text("utf-8")
OPTIONS = {
    name for option in tap.params if isinstance(option, click.Option) for name in option.opts
}


@pytest.mark.parametrize("option", sorted(OPTIONS))
def test_the_page_has_a_row_for_the_option(option: str) -> None:
    assert re.search(rf"^\| `{option}\b", PAGE, re.MULTILINE)


def test_the_page_names_no_option_that_there_is_not() -> None:
    assert set(re.findall(r"`(--[a-z-]+)", PAGE)) <= OPTIONS | {"--help"}


@pytest.mark.parametrize("kind", KINDS)
def test_the_page_names_the_kind(kind: str) -> None:
    assert f"`{kind}`" in PAGE


@pytest.mark.parametrize("field", [field.encode_name for field in msgspec.structs.fields(Line)])
def test_the_page_explains_the_key(field: str) -> None:
    assert re.search(rf"^\| .*`{field}`.* \|", PAGE, re.MULTILINE)


@pytest.mark.parametrize("field", [field.encode_name for field in msgspec.structs.fields(Row)])
def test_the_page_shows_the_key_of_the_statistics(field: str) -> None:
    assert f'"{field}":' in PAGE


def test_the_page_has_the_limit_that_the_code_has() -> None:
    assert f"More than {MAX_OPEN_CALLS:,} calls" in PAGE
