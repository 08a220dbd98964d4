"""What a shell completes is what the commands take."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from m2c.cli import main as m2c
from m2c.completion import SHELLS
from moon.cli import main as moon
from tests.commands.test_usage import COMMANDS
from transports.registry import available

GROUPS = {"m2c": m2c, "moon": moon}


def completed(*words: str) -> list[str]:
    """The values that bash is given for the last of ``words``."""
    program = words[0]
    done = CliRunner().invoke(
        GROUPS[program],
        [],
        prog_name=program,
        env={
            f"_{program.upper()}_COMPLETE": "bash_complete",
            "COMP_WORDS": shlex.join(words),
            "COMP_CWORD": str(len(words) - 1),
        },
    )
    assert "Traceback" not in done.output, done.output
    return [line.partition(",")[2] for line in done.output.splitlines()]


@pytest.mark.parametrize("program", GROUPS)
def test_the_names_of_commands_are_completed(program: str) -> None:
    names = {words[1] for words in COMMANDS if words[0] == program and len(words) > 1}
    assert set(completed(program, "")) == names
    assert completed(program, "ch") == sorted(name for name in names if name.startswith("ch"))


def test_a_groups_commands_are_completed_too() -> None:
    assert completed("moon", "keys", "") == ["init", "renew"]


def command_of(words: tuple[str, ...]) -> click.Command:
    command: click.Command = GROUPS[words[0]]
    for name in words[1:]:
        assert isinstance(command, click.Group)
        found = command.get_command(click.Context(command), name)
        assert found is not None
        command = found
    return command


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_all_options_of_a_command_are_completed_and_none_that_is_hidden(
    words: tuple[str, ...],
) -> None:
    context = click.Context(command_of(words), help_option_names=["-h", "--help"])
    options = [p for p in context.command.get_params(context) if isinstance(p, click.Option)]
    shown = {name for option in options if not option.hidden for name in option.opts}
    assert set(completed(*words, "--")) == {name for name in shown if name.startswith("--")}


@pytest.mark.parametrize(
    "command", ["m2c run", "m2c generate", "m2c check", "moon tap", "m2c doctor"]
)
def test_the_names_of_transports_are_completed(command: str) -> None:
    assert completed(*command.split(), "--transport", "") == available()
    assert completed(*command.split(), "--transport", "z") == ["zenoh"]


def test_the_values_of_a_choice_and_files_are_completed() -> None:
    assert completed("m2c", "check", "--format", "s") == ["sarif"]
    assert completed("m2c", "completion", "") == list(SHELLS)
    assert completed("m2c", "draw", "a") == ["a"]  # of type file: the shell does it


@pytest.mark.parametrize(
    "words", [("m2c", "nonsense", ""), ("m2c", "run", "--nonsense", "--"), ("moon", "x")]
)
def test_what_is_wrong_before_is_no_error_of_the_completion(words: tuple[str, ...]) -> None:
    completed(*words)


@pytest.mark.parametrize("program", GROUPS)
@pytest.mark.parametrize("shell", SHELLS)
def test_the_script_is_for_the_shell_and_the_program(program: str, shell: str) -> None:
    done = CliRunner().invoke(GROUPS[program], ["completion", shell])
    assert done.exit_code == 0
    assert f"_{program.upper()}_COMPLETE={shell}_complete" in done.output


@pytest.mark.parametrize(
    "arguments", [["completion"], ["completion", "tcsh"], ["completion", "bash", "zsh"]]
)
def test_a_shell_that_is_not_known_is_refused(arguments: list[str]) -> None:
    done = CliRunner().invoke(m2c, arguments)
    assert done.exit_code == 2
    assert "Traceback" not in done.output


@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")
@pytest.mark.parametrize(
    ("program", "begun", "all_"), [("m2c", "doc", ["doctor"]), ("moon", "re", ["record", "replay"])]
)
def test_bash_completes_by_the_script(
    tmp_path: Path, program: str, begun: str, all_: list[str]
) -> None:
    own = tmp_path / program
    own.write_text(f"#!{sys.executable}\nfrom {program}.cli import main\nmain()\n")
    own.chmod(0o755)
    script = (
        f". <({program} completion bash) && COMP_WORDS=({program} {begun}) && COMP_CWORD=1 && "
        f'_{program}_completion {program} && echo "${{COMPREPLY[@]}}"'
    )
    path = os.pathsep.join([str(tmp_path), os.environ["PATH"]])
    done = subprocess.run(
        ["bash", "-c", script],
        env={**os.environ, "PATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.split() == all_, done.stderr
