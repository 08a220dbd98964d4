"""The two command lines import a command when it runs, and say what they do not know."""

from __future__ import annotations

import subprocess
import sys

import pytest
from click.testing import CliRunner

import m2c.cli
import moon.cli


@pytest.mark.parametrize(
    ("module", "commands"),
    [("m2c.cli", ["check", "generate", "interfaces", "run"]), ("moon.cli", ["tap"])],
)
def test_help_names_every_command_and_imports_none(module, commands) -> None:
    script = (
        f"import sys, {module} as cli\n"
        "from click.testing import CliRunner\n"
        "result = CliRunner().invoke(cli.main, ['--help'])\n"
        "assert result.exit_code == 0\n"
        "print(result.output)\n"
        "assert not [name for name in sys.modules if name.endswith('.command')]\n"
    )
    told = subprocess.run(
        [sys.executable, "-c", script], check=True, capture_output=True, text=True
    ).stdout
    for command in commands:
        assert f"\n  {command} " in told


@pytest.mark.parametrize("main", [m2c.cli.main, moon.cli.main])
def test_every_command_of_a_command_line_can_be_imported(main) -> None:
    for command in main.list_commands(None):
        assert CliRunner().invoke(main, [command, "--help"]).exit_code == 0


@pytest.mark.parametrize("main", [m2c.cli.main, moon.cli.main])
def test_an_unknown_command_is_exit_code_2(main) -> None:
    result = CliRunner().invoke(main, ["dance"])
    assert result.exit_code == 2
    assert "No such command 'dance'" in result.output
