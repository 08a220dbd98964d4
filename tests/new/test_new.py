"""``m2c new``: what it writes runs at once, and what it refuses."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

import m2c
from m2c.check.reading import findings_of
from m2c.cli import main


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def new(*words: str) -> Result:
    return CliRunner().invoke(main, ["new", *words])


def test_a_system_is_valid_and_its_test_passes(folder: Path):
    done = new("demo_2")
    assert done.exit_code == 0, done.output
    assert findings_of(m2c.read_system(folder / "demo_2" / "system.xml")) == []
    words = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_system.py"]
    ran = subprocess.run(
        words, check=False, cwd=folder / "demo_2", capture_output=True, text=True, timeout=60
    )
    assert ran.returncode == 0, ran.stdout


def test_a_system_runs_where_it_is_without_being_named(folder: Path, monkeypatch):
    new("demo")
    monkeypatch.chdir("demo")
    words = ["run", "--transport", "simulated", "--ticks", "20"]
    ran = CliRunner().invoke(main, [*words, "--monitor=--properties properties.yaml"])
    assert ran.exit_code == 0, ran.output
    assert "0 violations" in ran.output
    assert "SUCCESS  Work ok" in ran.output


@pytest.mark.parametrize(
    ("kind", "name", "path", "node"),
    [
        ("skill", "GoToDock", "skills/GoToDockSkill.ascxml", "GoToDockSkill"),
        ("skill", "LookSkill", "skills/LookSkill.ascxml", "LookSkill"),
        ("component", "Battery", "components/Battery.ascxml", "Battery"),
        ("plugin", "IsEnough", "plugins/IsEnough.ascxml", "IsEnough"),
    ],
)
def test_a_model_is_added_that_the_system_takes(
    kind: str, name: str, path: str, node: str, folder: Path, monkeypatch
):
    new("demo")
    monkeypatch.chdir("demo")
    done = new(kind, name)
    assert done.exit_code == 0, done.output
    assert Path(path).is_file()
    system = m2c.read_system("system.xml")
    assert node in [machine.name for machine in (*system.nodes, *system.plugins)]
    assert findings_of(system) == []
    assert "</roaml>" in Path("system.xml").read_text()
    again = new(kind, name)
    assert (again.exit_code, "is there already" in again.output) == (2, True)


def test_a_system_may_be_said_to_be_one(folder: Path):
    assert new("demo").exit_code == new("system", "other").exit_code == 0
    assert len(list(Path("demo").rglob("*"))) == len(list(Path("other").rglob("*")))


@pytest.mark.parametrize("kind", ["skill", "plugin"])
def test_the_leaf_that_is_named_works_in_the_policy(kind: str, folder: Path, monkeypatch):
    new("demo")
    monkeypatch.chdir("demo")
    leaf = new(kind, "Look").output.rpartition("policy: ")[2].strip()
    policy = Path("policy.xml")
    policy.write_text(policy.read_text().replace("</Sequence>", f"  {leaf}\n    </Sequence>"))
    assert findings_of(m2c.read_system("system.xml")) == []
    ran = CliRunner().invoke(main, ["run", "--transport", "simulated", "--ticks", "30"])
    assert "Look ok" in ran.output, ran.output


@pytest.mark.parametrize(
    ("kind", "name", "taken"),
    [
        ("component", "WorkSkill", "WorkSkill"),
        ("plugin", "Worker", "Worker"),
        ("skill", "WORK", "WorkSkill"),
        ("component", "Dock", "Dock"),
    ],
)
def test_a_name_that_a_model_of_the_system_has_is_refused(
    kind: str, name: str, taken: str, folder: Path, monkeypatch
):
    new("demo")
    monkeypatch.chdir("demo")
    assert new("plugin", "Dock").exit_code == 0
    before = Path("system.xml").read_text()
    done = new(kind, name)
    assert done.exit_code == 2
    assert done.output == (
        f"error: system.xml has a model called `{taken}` already; choose another name\n"
    )
    assert Path("system.xml").read_text() == before


def test_what_a_system_file_says_in_comments_is_left_alone(folder: Path, monkeypatch):
    new("demo")
    monkeypatch.chdir("demo")
    path = Path("system.xml")
    text = path.read_text() + "<!-- </node_models> -->\n"
    path.write_bytes(text.replace("\n", "\r\n").encode())
    assert new("component", "Battery").exit_code == 0
    assert findings_of(m2c.read_system(path)) == []
    assert b"<!-- </node_models> -->\r\n" in path.read_bytes()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("Demo",), "`Demo` cannot be a system's name"),
        (("1demo",), "cannot be a system's name"),
        (("json",), "cannot be a system's name"),
        (("class",), "cannot be a system's name"),
        (("../demo",), "cannot be a system's name"),
        (("a" * 61,), "cannot be a system's name"),
        (("a__b",), "cannot be a system's name"),
        (("full",), "full is there already, and is not an empty folder"),
        (("skill",), "`skill` needs a name"),
        (("system",), "`system` needs a name: m2c new system NAME"),
        (("robot", "x"), "expected NAME, or one of system, skill, component, plugin"),
        (("skill", "a", "b"), "expected NAME, or one of"),
        (("skill", "Dock"), "no system.xml in this folder"),
        (("skill", "dock"), "`dock` cannot be a skill's name; write it like GoToDock"),
        (("skill", "Skill"), "`Skill` says nothing"),
        (("plugin", "../X"), "cannot be a plugin's name"),
    ],
)
def test_what_cannot_be_is_told_in_one_line(words: tuple[str, ...], said: str, folder: Path):
    (folder / "full").mkdir()
    (folder / "full" / "kept").write_text("")
    done = new(*words)
    assert (done.exit_code, said in done.output) == (2, True), done.output
    assert sorted(path.name for path in folder.iterdir()) == ["full"]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"<roaml><node_models/></roaml>", "system.xml has no <node_models>"),
        (b"<roaml>\xff</roaml>", "system.xml is not in UTF-8"),
    ],
)
def test_a_system_file_that_cannot_be_added_to_stays_as_it_is(
    content: bytes, said: str, folder: Path
):
    (folder / "system.xml").write_bytes(content)
    done = new("component", "Battery")
    assert (done.exit_code, said in done.output) == (2, True), done.output
    assert (folder / "system.xml").read_bytes() == content
    assert not (folder / "components").exists()


def test_templates_of_a_user_s_own_take_the_place_of_ours(folder: Path, monkeypatch):
    own = folder / "own"
    own.mkdir()
    (own / "README.md.j2").write_text("# {{ name }} of ours\n")
    assert new("demo", "--templates", "own").exit_code == 0
    assert (folder / "demo" / "README.md").read_text() == "# demo of ours\n"
    (own / "README.md.j2").write_text("{{ nobody }}")
    done = new("other", "--templates", "own")
    assert (done.exit_code, "README.md.j2:1" in done.output) == (2, True), done.output
    assert not (folder / "other").exists()
