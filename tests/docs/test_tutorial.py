"""The tutorial and the how-to pages, followed to the letter: what is written and run gives what is shown."""

from __future__ import annotations

import itertools
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.docs.test_examples_in_documents import BLOCK, LINK
from tests.docs.walkthrough import Command, File, Shell, difference, steps
from tests.transports.ros2_network import own_domain

ROOT = Path(__file__).parents[2]
TUTORIAL = ROOT / "docs" / "tutorial"
HOW_TO = ROOT / "docs" / "how-to"
PAGES = ("begin", "model", "run", "monitor", "record")
ROS2 = "ros2"
ROS_VARIABLES = ("ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE")
MOST_LINES = 80
INSTALLS = ("python3 -m venv ", ". robot/", "pip install ")
"""What is installed already where the tests run."""
PREPARES = ("m2c new ", "cd ", "rm ", "sed -i ")
"""What makes the files that the last page needs."""


@pytest.fixture
def domain() -> Iterator[int]:
    with own_domain() as number:
        yield number


@pytest.fixture
def shell(tmp_path: Path) -> Iterator[Shell]:
    """A shell of somebody who has m2c and moon, and nothing else of this repository."""
    kept = ("PYTHONPATH", "PYTHONDONTWRITEBYTECODE", "LANG", *ROS_VARIABLES)
    environment = {name: os.environ[name] for name in kept if name in os.environ}
    environment["VIRTUAL_ENV"] = str(Path(sys.executable).parents[1])
    environment["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    with Shell(tmp_path, {**environment, "HOME": str(tmp_path)}, free_port()) as running:
        yield running


def free_port() -> str:
    """An address and a port of loopback that nobody uses at the moment."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return f"127.0.0.1:{server.getsockname()[1]}"


def follow(shell: Shell, page: Path, but: tuple[str, ...] = INSTALLS) -> None:
    """Do what ``page`` says, but for commands that begin so; what is shown is what comes."""
    for step in steps(page):
        if isinstance(step, File):
            shell.write(step)
        elif not step.text.startswith(but):
            assert difference(step, shell.run(step.text)) == "", page.name


def prepare(shell: Shell) -> None:
    """The files as they are at the end of PAGES, without what was only shown."""
    for page in PAGES:
        for step in steps(TUTORIAL / f"{page}.md"):
            if isinstance(step, File):
                shell.write(step)
            elif step.text.startswith(PREPARES):
                shell.run(step.text)


@pytest.mark.slow
@pytest.mark.zenoh
def test_who_follows_the_text_alone_sees_what_it_shows(shell: Shell) -> None:
    for page in PAGES:
        follow(shell, TUTORIAL / f"{page}.md")


@pytest.mark.slow
@pytest.mark.zenoh
@pytest.mark.parametrize("page", sorted(HOW_TO.glob("*.md")), ids=lambda page: page.stem)
def test_a_how_to_page_shows_what_comes(page: Path, shell: Shell) -> None:
    assert page.read_text().count("\n") <= MOST_LINES, "one thing, told shortly"
    follow(shell, page)


@pytest.mark.slow
@pytest.mark.ros2
@pytest.mark.timeout(900)  # it builds interface packages
def test_the_nodes_of_the_tutorial_run_on_ros2(domain: int, shell: Shell) -> None:
    prepare(shell)
    follow(shell, TUTORIAL / f"{ROS2}.md")


@pytest.mark.soak
@pytest.mark.timeout(1200)  # it installs everything
def test_a_bare_machine_installs_what_the_text_says(tmp_path: Path) -> None:
    subprocess.run(["git", "clone", "-q", str(ROOT), str(tmp_path / "m2c-moon")], check=True)
    environment = {"HOME": str(tmp_path), "PATH": os.environ["PATH"]}
    with Shell(tmp_path, environment, free_port()) as shell:
        for page in PAGES:
            follow(shell, TUTORIAL / f"{page}.md", but=())


def test_the_pages_follow_one_another() -> None:
    pages = [*PAGES, ROS2]
    listed = [link for link, _ in LINK.findall((TUTORIAL / "README.md").read_text())]
    assert listed == [f"{page}.md" for page in pages]
    for page, after in itertools.pairwise(pages):
        assert f"]({after}.md)" in (TUTORIAL / f"{page}.md").read_text().splitlines()[-1]


@pytest.mark.parametrize("page", [*PAGES, ROS2])
def test_every_block_is_something_to_do(page: str) -> None:
    blocks = BLOCK.findall((TUTORIAL / f"{page}.md").read_text())
    done = list(steps(TUTORIAL / f"{page}.md"))
    assert sum(bool(language) for language, _ in blocks) == sum(
        isinstance(step, File) for step in done
    )
    assert all(text.startswith("$ ") for language, text in blocks if not language)


@pytest.mark.parametrize(
    ("shown", "said", "is_same"),
    [
        (["a 1"], ["a 1"], True),
        (["a 1"], ["a 2"], False),
        (["a 1"], ["a 1", "b"], False),
        (["a", "...", "c"], ["a", "c"], True),
        (["a", "...", "c"], ["a", "b", "b", "c"], True),
        (["a", "...", "c"], ["a", "b"], False),
        (["..."], [], True),
        ([], ["Traceback"], False),
        (["ended: in 0.1 s"], ["ended: in 12.3 s"], True),
        (["a.c"], ["abc"], False),
    ],
)
def test_what_is_shown_is_compared_line_by_line(
    shown: list[str], said: list[str], is_same: bool
) -> None:
    command = Command("m2c check x", tuple(shown))
    assert (difference(command, said) == "") is is_same


def test_numbers_of_what_runs_in_real_time_are_not_compared() -> None:
    shown = ("10:11:12.5  /a  → b  data: 2  (1,539 µs)",)
    said = ["23:59:59.123456  /a        → b  data: 12  (39 µs)"]
    assert difference(Command("moon tap /a", shown), said) == ""
    assert difference(Command("moon tap /a", shown), [said[0].replace("/a", "/b")]) != ""
    assert difference(Command("m2c run --transport simulated", shown), said) != ""
