"""What a shell completes is what the commands take."""

from __future__ import annotations

import contextlib
import os
import pty
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
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


BEGUN = [
    ("m2c doc", "m2c doctor"),
    ("moon rec", "moon record"),
    ("m2c run --transport zen", "m2c run --transport zenoh"),
    ("m2c check --format sar", "m2c check --format sarif"),
    ("moon check-properties --int", "moon check-properties --interfaces"),
    ("m2c draw some_mo", "m2c draw some_model.scxml"),
]
"""What is typed before the tabulator, and the line that a shell makes of it."""


def by_bash(folder: Path, line: str) -> str:
    """What stands in bash's line editor after the tabulator."""
    (folder / ".bashrc").write_text(
        ". <(m2c completion bash) && . <(moon completion bash)\n"
        'tell() { printf %s "$READLINE_LINE" > told; exit; }\n'
        "bind -x '\"\\C-t\": tell'\n"
    )
    return _told(folder, line, "bash", "--rcfile", ".bashrc", "-i")


def by_zsh(folder: Path, line: str) -> str:
    """What stands in zsh's line editor after the tabulator."""
    (folder / ".zshrc").write_text(
        "autoload -Uz compinit && compinit -u -D\n"
        ". <(m2c completion zsh) && . <(moon completion zsh)\n"
        'tell() { printf %s "$BUFFER" > told; exit; }\n'
        "zle -N tell && bindkey '^T' tell\n"
    )
    return _told(folder, line, "zsh", "-d", "-i")


def by_fish(folder: Path, line: str) -> str:
    """The line that fish makes where there is one completion only."""
    program = line.partition(" ")[0]
    script = f'{program} completion fish | source; complete --do-complete "{line}"'
    done = subprocess.run(
        ["fish", "--no-config", "-c", script], cwd=folder, env=_environment(folder),
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.stderr == ""
    completions = [text.partition("\t")[0] for text in done.stdout.splitlines()]
    return " ".join([line.rpartition(" ")[0], *completions])


def _told(folder: Path, line: str, *shell: str) -> str:
    """The line that ``shell`` writes to the file ``told``: ``line`` and a tabulator typed on a terminal."""
    keyboard, screen = pty.openpty()
    with subprocess.Popen(
        shell, cwd=folder, env=_environment(folder),
        stdin=screen, stdout=screen, stderr=screen, start_new_session=True,
    ):  # fmt: skip
        os.close(screen)
        os.write(keyboard, f"{line}\t\x14".encode())
        with contextlib.suppress(OSError):  # EIO: the shell has ended
            while os.read(keyboard, 4096):
                pass
    os.close(keyboard)
    return (folder / "told").read_text().strip()


def _environment(folder: Path) -> dict[str, str]:
    return {
        **os.environ,
        "PATH": os.pathsep.join([str(folder), os.environ["PATH"]]),
        "HOME": str(folder),
        "ZDOTDIR": str(folder),
        "TERM": "vt100",
    }


@pytest.mark.parametrize(("line", "completed_line"), BEGUN)
@pytest.mark.parametrize("by_shell", [by_bash, by_zsh, by_fish])
def test_each_shell_completes_by_its_script(
    tmp_path: Path, by_shell: Callable[[Path, str], str], line: str, completed_line: str
) -> None:
    shell = by_shell.__name__.removeprefix("by_")
    if shutil.which(shell) is None:
        pytest.skip(f"there is no {shell}")
    for program in GROUPS:
        own = tmp_path / program
        own.write_text(f"#!{sys.executable}\nfrom {program}.cli import main\nmain()\n")
        own.chmod(0o755)
    (tmp_path / "some_model.scxml").touch()
    assert by_shell(tmp_path, line) == completed_line
