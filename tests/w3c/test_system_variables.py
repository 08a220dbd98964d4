"""``_event.name`` and ``_name`` (W3C SCXML 5.10, tests 318 to 323, 342, 500)."""

from __future__ import annotations

from pathlib import Path

import pytest

import m2c
from tests.launch.test_own_events import HEAD, ran, sender, taker, write
from tests.w3c.both import Both, probe, say

IS = "(_event.name == '{0}') ? 1 : 2"


@pytest.mark.parametrize(
    ("taken", "sent"), [("e", "e"), ("e", "e.f"), ("*", "e.f.g"), ("e.*", "e.x")]
)
def test_an_event_says_its_name(taken: str, sent: str, tmp_path: Path) -> None:
    states = (
        f'<state id="a"><transition event="go"><raise event="{sent}"/><send event="{sent}" '
        f'target="#_internal"/><send event="{sent}" delay="1s"/></transition><transition event="{taken}" '
        f"cond=\"_event.name == '{sent}'\">{say(IS.format(sent))}</transition></state>"
    )
    assert Both(tmp_path, probe(states)).take("go") == [1, 1, 1]


@pytest.mark.parametrize("taken", ["e", "e.f", "e.*", "x e.f y"])
def test_an_event_of_another_machine_does_too(taken: str, tmp_path: Path) -> None:
    """The one that sends took says which event it took."""
    took = '<send event="took"><param name="what" expr="_event.name"/></send>'
    one = '<state id="s"><transition after="1s" target="t"><send event="e.f"/></transition></state>'
    path = write(
        tmp_path,
        One=f'{HEAD.format("One")}{one}<state id="t"/></ascxml>',
        Sender=taker("Sender", taken, then=took),
    )
    said, violations = ran(path, path)
    assert said == ["e.f"]
    assert violations == []


def test_an_own_event_that_others_take_does_too(tmp_path: Path) -> None:
    text = sender(("shared", "private")).replace("expr=\"'private'\"", 'expr="_event.name"')
    text = text.replace("expr=\"'shared'\"", 'expr="_event.name"')
    path = write(tmp_path, Sender=text, Taker=taker("Taker", "shared"))
    said, violations = ran(path, path)
    assert said == ["shared", "private"]
    assert violations == []


def test_a_machine_knows_its_name(tmp_path: Path) -> None:
    length = say("(_name == 'Probe') ? _name.length : -1")
    content = f"<onentry>{length}</onentry>"
    assert Both(tmp_path, probe(f'<state id="a">{content}</state>')).said == [5]


def test_a_variable_of_that_name_is_one(tmp_path: Path) -> None:
    data = '<datamodel><data id="_name" type="int32" expr="3"/></datamodel>'
    entry = f'<onentry><assign location="_name" expr="_name + 1"/>{say("_name")}</onentry>'
    assert Both(tmp_path, probe(f'{data}<state id="a">{entry}</state>')).said == [4]


def test_a_name_cannot_be_assigned(tmp_path: Path) -> None:  # W3C test 322
    path = tmp_path / "Probe.scxml"
    path.write_text(
        probe('<state id="a"><onentry><assign location="_name" expr="1"/></onentry></state>')
    )
    findings = [str(item) for item in m2c.check(m2c.read_system(path)) if item.severity == "error"]
    assert len(findings) == 1
    assert "`_name` is not declared" in findings[0]
