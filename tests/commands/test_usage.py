"""What the command lines say to somebody who has not used them before."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from m2c.cli import main as m2c
from moon.cli import main as moon


def commands_of(group: click.Group, path: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """The words of ``group`` and of everything in it."""
    context = click.Context(group)
    found = [path]
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        inner = (*path, name)
        found += commands_of(command, inner) if isinstance(command, click.Group) else [inner]
    return found


MAKEFILE = Path(__file__).parents[2] / "Makefile"
COMMANDS = [("m2c", *words) for words in commands_of(m2c)] + [
    ("moon", *words) for words in commands_of(moon)
]


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_every_help_has_an_example_of_its_own_command(words: tuple[str, ...]) -> None:
    result = CliRunner().invoke(m2c if words[0] == "m2c" else moon, [*words[1:], "--help"])
    assert result.exit_code == 0
    assert f"Example: {' '.join(words)}" in " ".join(result.output.split())


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_the_example_of_a_help_can_be_copied(words: tuple[str, ...]) -> None:
    """It is one line, however narrow the terminal; an option that it names is one of the command's."""
    result = CliRunner().invoke(
        m2c if words[0] == "m2c" else moon, [*words[1:], "--help"], terminal_width=60
    )
    lines = result.output.splitlines()
    example = lines[lines.index("  Example:") + 1]
    assert example.startswith(f"    {' '.join(words)}")
    assert "\\b" not in result.output
    own = example.split("&&")[0]
    options = [word.partition("=")[0] for word in own.split() if word.startswith("-")]
    assert [option for option in options if f"{option} " not in result.output] == []


@pytest.mark.parametrize(
    ("group", "name", "right"),
    [
        (m2c, "chek", "No such command 'chek'; did you mean check?"),
        (moon, "moniter", "No such command 'moniter'; did you mean monitor?"),
        (moon, "dance", "No such command 'dance'; known: "),
        (m2c, "tap", "No such command 'tap'; it is `moon tap`\n"),
        (
            m2c,
            "watch",
            "No such command 'watch'; it is `m2c check --watch`, or `m2c run --watch`\n",
        ),
        (moon, "run", "No such command 'run'; it is `m2c run`\n"),
        (moon, "report", "No such command 'report'; it is `moon check --report`\n"),
        (moon, "fleet", "No such command 'fleet'; it is `moon monitor --fleet`\n"),
    ],
)
def test_a_wrong_command_is_refused_with_the_right_one(
    group: click.Group, name: str, right: str
) -> None:
    result = CliRunner().invoke(group, [name])
    assert result.exit_code == 2
    assert right in result.output


def test_each_word_for_a_command_of_another_name_leads_to_one_that_there_is() -> None:
    groups: dict[str, click.Group] = {"m2c": m2c, "moon": moon}
    for group in groups.values():
        elsewhere: dict[str, str] = vars(group)["_elsewhere"]
        assert not set(elsewhere) & set(group.list_commands(click.Context(group)))
        for written in elsewhere.values():
            for line in written.split("`, or `"):
                program, *words = line.split()
                if program == "make":
                    assert f"\n{words[0]}:" in MAKEFILE.read_text()
                    continue
                command = [word for word in words[:1] if not word.startswith("--")]
                shown = CliRunner().invoke(groups[program], [*command, "--help"])
                assert shown.exit_code == 0, line
                options = [word for word in words if word.startswith("--")]
                assert [option for option in options if option not in shown.output] == [], line


def test_every_command_of_the_other_program_is_told() -> None:
    assert set(moon.list_commands(click.Context(moon))) <= {
        *vars(m2c)["_elsewhere"],
        *m2c.list_commands(click.Context(m2c)),
    }
    assert set(m2c.list_commands(click.Context(m2c))) <= {
        *vars(moon)["_elsewhere"],
        *moon.list_commands(click.Context(moon)),
    }


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            ["run"],
            "error: system.xml: no such file or folder; name a system file, or a folder made by `m2c generate`; `m2c new NAME` makes a system\n",
        ),
        (
            ["check"],
            "nothing to check; give a model, a folder or a system file; `m2c new NAME` makes a system\n",
        ),
    ],
)
def test_an_empty_folder_is_told_how_to_begin(
    words: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(m2c, words)
    assert result.exit_code == 2
    assert said in result.output


def test_a_system_that_is_not_there_is_refused_with_what_makes_one() -> None:
    result = CliRunner().invoke(m2c, ["run", "no_such"])
    assert result.exit_code == 2
    assert result.output == (
        "error: no_such: no such file or folder; "
        "expected a system file, or a folder made by `m2c generate`\n"
    )


@pytest.mark.parametrize("command", ["m2c", "moon"])
def test_help_does_not_wait_for_libraries_that_only_commands_need(command: str) -> None:
    program = (
        f"import sys; from {command}.cli import main; main(['--help'], standalone_mode=False); "
        "print(sorted({'lxml', 'jinja2', 'msgspec', 'rich', 'zenoh'} & sys.modules.keys()))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize("command", ["m2c", "moon"])
def test_a_command_line_may_be_run_as_a_module(command: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", command, "--version"],
        capture_output=True, text=True, check=True, timeout=60,
    )  # fmt: skip
    assert done.stdout.startswith(f"{command} ")


@pytest.mark.parametrize(
    "words",
    [
        ("--properties", "p.yaml"),
        ("--monitor", "--properties", "p.yaml"),
        ("--monitor", "--latency-bound", "1"),
    ],
)
def test_an_option_of_the_monitor_is_told_to_be_that(words: tuple[str, ...]) -> None:
    ended = CliRunner().invoke(m2c, ["run", *words])
    option = words[-2]
    assert ended.exit_code == 2
    told = f"No such option '{option}'. What `moon monitor` takes is in --monitor=\"{option} …\"."
    assert told in ended.output


def test_any_other_misspelt_option_is_told_with_those_that_are_like_it() -> None:
    ended = CliRunner().invoke(m2c, ["run", "--transprt", "zenoh"])
    assert ended.exit_code == 2
    assert "--transport" in ended.output
    assert "moon monitor" not in ended.output


@pytest.mark.parametrize(
    ("written", "told"),
    [
        ("Lidar", "--replace Lidar: expected NODE=PATH"),
        ("=lidar.py", "--replace =lidar.py: expected NODE=PATH"),
        ("Lidar=", "--replace Lidar=: expected NODE=PATH"),
        (
            "Lidar=lidr.py",
            "--replace Lidar: lidr.py: no such file or folder; did you mean lidar.py?",
        ),
        (
            "Lidar=none",
            "none: no such file or folder; expected a model, a package or a node written by",
        ),
    ],
)
def test_what_cannot_replace_a_node_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, written: str, told: str
) -> None:
    (tmp_path / "system.xml").write_text("<roaml/>")
    (tmp_path / "lidar.py").write_text("")
    monkeypatch.chdir(tmp_path)
    ended = CliRunner().invoke(m2c, ["run", "--replace", written])
    assert ended.exit_code == 2
    assert told in ended.output


@pytest.mark.parametrize("tool", [m2c, moon])
@pytest.mark.parametrize("word", ["mutate", "mutants"])
def test_mutants_are_made_by_make(tool: click.Group, word: str) -> None:
    ended = CliRunner().invoke(tool, [word])
    assert ended.exit_code == 2
    assert f"No such command '{word}'; it is `make mutants`" in ended.output


def test_the_folder_of_a_system_is_not_what_is_run(tmp_path: Path) -> None:
    (tmp_path / "system.xml").write_text("<roaml/>")
    ended = CliRunner().invoke(m2c, ["run", str(tmp_path)])
    assert ended.exit_code == 2
    assert f"its system is {tmp_path / 'system.xml'}" in ended.output.replace("\n", "")
