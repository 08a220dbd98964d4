"""Findings that are one mistake repeated are shown once, so that a big system's stay readable."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from m2c.cli import main

NS = 'xmlns="http://www.w3.org/2005/07/scxml" version="1.0"'


def skill(name: str, body: str = "") -> str:
    """A skill that discards requests in one of its states, and what else is wrong in ``body``."""
    return (
        f'<scxml {NS} name="{name}" initial="idle">'
        f'<ros_service_server service_name="/{name}/reset" type="std_srvs/Empty"/>{body}'
        f'<state id="idle"><ros_service_handle_request name="/{name}/reset" target="busy">'
        f'<ros_service_send_response name="/{name}/reset"/></ros_service_handle_request></state>'
        '<state id="busy"/></scxml>'
    )


def write(folder: Path, skills: int, body: str = "") -> None:
    for number in range(skills):
        (folder / f"skill{number:02}.scxml").write_text(skill(f"Skill{number:02}", body))


def run(*arguments: str) -> tuple[int, list[str]]:
    result = CliRunner().invoke(main, list(arguments))
    return result.exit_code, result.output.splitlines()


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "models").mkdir()
    monkeypatch.chdir(tmp_path)


def test_a_mistake_in_forty_skills_is_shown_once() -> None:
    write(Path("models"), 40)
    code, lines = run("check", "models")
    assert code == 0
    assert lines[0].startswith("models/skill00.scxml:1:")
    assert "state `busy` discards a request to /Skill00/reset" in lines[0]
    assert lines[1:] == [
        "  ... and 39 more like this in 39 files (--all shows each)",
        "40 models, 0 errors, 40 warnings",
    ]


def test_all_shows_each() -> None:
    write(Path("models"), 40)
    _, lines = run("check", "--all", "models")
    assert sum("[request-discarded]" in line for line in lines) == 40
    assert not any("more like this" in line for line in lines)


def test_three_of_a_kind_are_shown_each() -> None:
    write(Path("models"), 3)
    _, lines = run("check", "models")
    assert sum("[request-discarded]" in line for line in lines) == 3


def test_a_mistake_does_not_hide_one_of_another_kind() -> None:
    write(Path("models"), 5, '<datamodel><data id="n" type="intt8"/></datamodel>')
    Path("models/one.scxml").write_text(
        skill("One", '<datamodel><data id="n" expr="1 +"/></datamodel>')
    )
    code, lines = run("check", "models")
    assert code == 2
    assert sum("[unknown-type]" in line for line in lines) == 1
    assert sum("[bad-expression]" in line for line in lines) == 1


def test_one_rule_with_two_texts_is_two_mistakes() -> None:
    body = '<state id="a"><onentry><log expr="1 == \'1\'"/><log expr="-\'1\'"/></onentry></state>'
    for number in range(5):
        text = f'<scxml {NS} name="M{number}" initial="a">{body}</scxml>'
        Path(f"models/m{number}.scxml").write_text(text)
    _, lines = run("check", "models")
    shown = [line for line in lines if "[type-mismatch]" in line]
    assert len(shown) == 2, lines
    assert sum("... and 4 more like this in 4 files" in line for line in lines) == 2


def test_many_findings_of_several_rules_end_in_a_summary_by_rule() -> None:
    write(Path("models"), 12)
    Path("models/one.scxml").write_text(
        f'<scxml {NS} name="One" initial="a"><state id="a"/><state id="b"/></scxml>'
    )
    _, lines = run("check", "models")
    assert lines[-2:] == [
        "12 request-discarded, 1 unreachable-state",
        "13 models, 0 errors, 13 warnings",
    ]


@pytest.mark.parametrize("form", ["json", "sarif"])
def test_formats_for_programs_have_each_finding(form: str) -> None:
    write(Path("models"), 40)
    result = CliRunner().invoke(main, ["check", "--format", form, "models"])
    found = json.loads(result.output)
    assert len(found if form == "json" else found["runs"][0]["results"]) == 40


def test_other_commands_say_which_one_shows_each() -> None:
    write(Path("models"), 5)
    code, lines = run("generate", "models", "-o", "made")
    assert code == 0
    assert "  ... and 4 more like this in 4 files (m2c check --all shows each)" in lines


def test_a_name_with_marks_of_quotation_hides_nothing(tmp_path: Path) -> None:
    names = ["a`b", 'a"b', "`", "did you mean ", "``x"]
    for number, name in enumerate(names):
        quoted = name.replace('"', "&quot;")
        text = f'<scxml {NS} name="M{number}" initial="a"><state id="a"/><state id="{quoted}"/></scxml>'
        Path(f"models/m{number}.scxml").write_text(text)
    _, lines = run("check", "models")
    shown = sum("[" in line for line in lines)
    folded = sum(int(line.split()[2]) for line in lines if "more like this" in line)
    assert shown + folded == len(run("check", "--all", "models")[1]) - 1
