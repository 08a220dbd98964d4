"""The page of ``m2c convert`` shows what the command writes, and every option it has."""

from __future__ import annotations

import re
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from m2c.cli import main
from m2c.convert.command import convert

PAGE = (Path(__file__).parents[2] / "docs" / "commands" / "m2c-convert.md").read_text()
GIVEN, MADE = re.findall(r"```xml\n(.*?)```", PAGE, re.DOTALL)
((COMMAND, OUTPUT),) = re.findall(r"```\n\$ m2c (.*?)\n(.*?)```", PAGE, re.DOTALL)


def test_the_page_s_output_is_the_command_s(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("fill.scxml").write_text(GIVEN)
    result = CliRunner().invoke(main, COMMAND.split())
    assert result.output == OUTPUT
    assert Path("converted/fill.ascxml").read_text() == MADE


def test_the_page_names_every_option() -> None:
    options = [
        name for item in convert.params if isinstance(item, click.Option) for name in item.opts
    ]
    assert [name for name in options if f"`{name}" not in PAGE] == []
