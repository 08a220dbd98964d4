"""The page of ``m2c check`` shows what the command says, and every option it has."""

from __future__ import annotations

import re
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from m2c.check.command import check
from m2c.cli import main

PAGE = (Path(__file__).parents[2] / "docs" / "commands" / "m2c-check.md").read_text()
MODEL = re.findall(r"```xml\n(.*?)```", PAGE, re.DOTALL)[0]
CORRECTED = MODEL.replace("percentage", "data").replace('expr="1"', 'expr="true"')
RUNS = re.findall(r"```\n\$ m2c (check .*?)\n(.*?)```", PAGE, re.DOTALL)


def test_the_page_s_output_is_the_command_s(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "alarm.scxml"
    skills = tmp_path / "skills"
    skills.mkdir()
    for number in range(1, 41):
        text = CORRECTED.replace("Alarm", f"Alarm{number:02}").replace(
            "/alarm", f"/alarm{number:02}"
        )
        (skills / f"alarm{number:02}.scxml").write_text(text)
    for (command, output), (text, code) in zip(
        RUNS, ((MODEL, 2), (MODEL, 0), (CORRECTED, 2)), strict=True
    ):
        path.write_text(text)
        result = CliRunner().invoke(main, command.split())
        assert result.output == output
        assert result.exit_code == code


def test_the_page_names_every_option() -> None:
    options = [
        name for item in check.params if isinstance(item, click.Option) for name in item.opts
    ]
    assert [name for name in options if f"`{name}" not in PAGE] == []


def test_the_page_names_every_format() -> None:
    (form,) = (item.type for item in check.params if item.name == "form")
    assert isinstance(form, click.Choice)
    assert [name for name in form.choices if f"--format {name}`" not in PAGE] == []
