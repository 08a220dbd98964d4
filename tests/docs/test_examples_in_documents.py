"""What the documents show is what happens: commands give the output shown, links lead somewhere."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES += sorted((ROOT / "examples").rglob("*.md"))
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)#\s]*)(?:#([^)]*))?\)")
HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)
LINES = 200
INDICES = ("README.md", "property-patterns.md")
OTHERWISE_LONG = {
    "README.md": 260,  # every feature once
    "docs/api.md": 1000,  # generated, to be searched
}
REPEATABLE = ("mkdir ", "sed ", "echo ", "m2c check ", "m2c generate ", "m2c new ")
"""Commands without a running system, whose output is the same each time."""


def blocks(page: Path, language: str = "") -> list[str]:
    """The fenced blocks of a page that are marked with ``language``."""
    return [text for marked, text in BLOCK.findall(page.read_text()) if marked == language]


def commands_of(block: str) -> list[tuple[str, list[str]]]:
    """Commands and the lines shown after each."""
    found: list[tuple[str, list[str]]] = []
    for line in block.splitlines():
        if line.startswith("$ "):
            found.append((line[2:], []))
        elif found:
            found[-1][1].append(line)
    return found


def is_repeatable(block: str) -> bool:
    commands = [command for command, _ in commands_of(block)]
    # The plain-SCXML model of the page is the published one, which is not in this repository.
    elided = "..." in block.splitlines()
    return (
        bool(commands)
        and not elided
        and all(
            command.startswith(REPEATABLE) and "SetPoi1SkillSM" not in command
            for command in commands
        )
    )


@pytest.mark.parametrize("name", ["README.md", "docs/commands/m2c-generate.md"])
def test_the_commands_of_a_page_give_the_output_that_it_shows(name: str, tmp_path: Path) -> None:
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    shown = [block for block in blocks(ROOT / name) if is_repeatable(block)]
    assert shown
    for command, expected in (pair for block in shown for pair in commands_of(block)):
        done = subprocess.run(
            ["bash", "-c", command],
            cwd=tmp_path,
            env={**os.environ, "PATH": path},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        assert done.stdout.splitlines() == expected, command


@pytest.mark.parametrize("name", ["README.md", "docs/commands/m2c-generate.md"])
def test_the_python_of_a_page_is_in_the_generated_code(name: str, tmp_path: Path) -> None:
    from m2c.codegen.package import system_files
    from m2c.model import DiagnosticLog, load

    system = load([ROOT / "examples" / "lab_tour" / "system.xml"], DiagnosticLog())
    assert system is not None
    written = {line.strip() for text in system_files(system).values() for line in text.splitlines()}
    shown = [line.strip() for block in blocks(ROOT / name, "python") for line in block.splitlines()]
    assert shown
    assert [line for line in shown if line not in {*written, "...", ""}] == []


def anchors_of(page: Path) -> set[str]:
    """What a link may name on a page: its headings, spelt as GitHub spells them."""
    text = BLOCK.sub("", page.read_text())
    bare = [re.sub(r"[^\w\s-]", "", heading.lower()) for heading in HEADING.findall(text)]
    return {heading.strip().replace(" ", "-") for heading in bare}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_is_short_enough_to_be_read(page: Path) -> None:
    """A page answers one question; one that needs more lines than this answers two."""
    most = OTHERWISE_LONG.get(str(page.relative_to(ROOT)), LINES)
    assert page.read_text().count("\n") <= most, "split it, or say less"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_the_links_of_a_page_lead_to_files_and_headings(page: Path) -> None:
    wrong = []
    for link, anchor in LINK.findall(page.read_text()):
        target = page.parent / link if link else page
        if "://" in link:
            continue
        if not target.exists() or (anchor and anchor not in anchors_of(target)):
            wrong.append(f"{link}#{anchor}")
    assert wrong == []


def test_every_page_can_be_reached_from_the_index() -> None:
    docs = ROOT / "docs"
    reached, waiting = set(), [docs / "README.md"]
    while waiting:
        page = waiting.pop()
        if page in reached:
            continue
        reached.add(page)
        if page.name in INDICES:
            found = [(page.parent / link).resolve() for link, _ in LINK.findall(page.read_text())]
            waiting += [path for path in found if path.suffix == ".md" and docs in path.parents]
    assert [page for page in sorted(docs.rglob("*.md")) if page not in reached] == []
