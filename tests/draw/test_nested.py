"""State machine diagrams of compound states: boxes in boxes, each transition once, histories."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

from m2c.draw import draw_machine, transition_keys
from m2c.draw.bounds import TooLargeError
from m2c.draw.diagram import diagrams_of
from m2c.draw.dot import machine_as_dot
from m2c.draw.mermaid import machine_as_mermaid
from m2c.model import Machine
from m2c.model.walk import with_inner
from tests.draw.test_machine import (
    SVG,
    Rectangle,
    assert_nothing_lies_on_anything,
    machine_of,
    overlap,
    parsed,
    rectangle,
    scxml,
)
from tests.w3c.nested import Made

NESTED = """
<state id="off"><transition event="go" target="last"/><transition event="on" target="on"/></state>
<state id="on">
  <history id="last" type="deep"><transition target="b"><log label="first"/></transition></history>
  <history id="recent"><transition target="a"/></history>
  <onentry><log label="in"/></onentry>
  <initial><transition target="b"><log label="begin"/></transition></initial>
  <transition event="off" target="off"/>
  <transition event="stay"/>
  <transition event="anew" target="a"/>
  <transition event="inside" target="a" type="internal"/>
  <transition event="back" target="last"/>
  <state id="a"><transition event="leave" target="on"/><transition event="off" target="b"/></state>
  <state id="c"><state id="b"><transition event="out" target="off"/></state><final id="f"/></state>
</state>"""


def shapes(root: ElementTree.Element, kind: str) -> dict[str, Rectangle]:
    """The boxes of the groups ``kind``, by what is written in them first."""
    found = {}
    for group in root.iter(f"{SVG}g"):
        if group.get("class") == kind:
            box, text = group.find(f"{SVG}rect"), group.find(f"{SVG}text")
            assert box is not None
            assert text is not None
            found[text.text or ""] = rectangle(box)
    return found


def contains(outer: Rectangle, inner: Rectangle) -> bool:
    left, top, right, bottom = outer
    return left < inner[0] and top < inner[1] and inner[2] < right and inner[3] < bottom


def nested(tmp_path: Path) -> Machine:
    return machine_of(scxml(NESTED, "off"), tmp_path)


def test_states_stand_in_their_compound_state_and_beside_its_head(tmp_path: Path) -> None:
    machine = nested(tmp_path)
    root = parsed(machine)
    states, compounds = shapes(root, "state"), shapes(root, "compound")
    histories = shapes(root, "history")
    assert (set(states), set(compounds)) == ({"off", "a", "b", "f"}, {"on", "c"})
    assert set(histories) == {"H", "H*"}
    for inner in (states["a"], compounds["c"], *histories.values()):
        assert contains(compounds["on"], inner)
    assert contains(compounds["c"], states["b"])
    assert not overlap(compounds["on"], states["off"])
    assert_nothing_lies_on_anything(machine)


def test_a_transition_of_a_compound_state_is_drawn_once_from_its_side(tmp_path: Path) -> None:
    machine = nested(tmp_path)
    root = parsed(machine)
    ids = [g.get("id", "") for g in root.iter(f"{SVG}g") if g.get("class") == "transition"]
    assert sorted(ids) == sorted(f"t{number}" for number in range(10))
    assert sorted(" ".join(transition_keys(machine).values()).split()) == sorted(ids)
    written = {str(item.position) for s in with_inner(machine.written) for item in s.transitions}
    assert written == set(transition_keys(machine))
    on = shapes(root, "compound")["on"]
    (off,) = [
        arrow.find(f".//{SVG}path")
        for arrow in root.iter(f"{SVG}g")
        if arrow.get("data-keys") == "t2"
    ]
    assert off is not None
    x, y = map(float, re.findall(r"[\d.]+", off.get("d", ""))[:2])
    assert x in (on[0], on[2]) or y in (on[1], on[3])


def test_what_leaves_a_compound_state_and_enters_it_again_is_marked(tmp_path: Path) -> None:
    words = [text.text for text in parsed(nested(tmp_path)).iter(f"{SVG}text")]
    for again in ("↺ anew", "↺ back", "↺ leave"):
        assert again in words
    for other in ("inside", "stay", "off", "go", "on", "out", "log first", "log begin"):
        assert other in words
    assert any(word is not None and word.startswith("↺ leaves") for word in words)


@pytest.mark.parametrize("first", range(0, 300, 10))
def test_nothing_lies_on_anything_in_any_nested_machine(first: int, tmp_path: Path) -> None:
    machine = machine_of(Made(first).text(), tmp_path)
    assert_nothing_lies_on_anything(machine)
    root = parsed(machine)
    boxes = {**shapes(root, "state"), **shapes(root, "compound")}
    for state in with_inner(machine.written):
        for inner in state.states:
            assert contains(boxes[state.name], boxes[inner.name])
        for one in state.states:
            for other in state.states:
                assert one is other or not overlap(boxes[one.name], boxes[other.name])


def test_a_machine_that_begins_deep_inside_is_drawn(tmp_path: Path) -> None:
    for initial in ("b", "last", "on"):
        assert_nothing_lies_on_anything(machine_of(scxml(NESTED, initial), tmp_path))


def test_states_nested_deep_are_drawn_or_refused_in_words(tmp_path: Path) -> None:
    deep = 40
    opened = "".join(f'<state id="s{n}">' for n in range(deep))
    ways = "".join(f'<transition event="e{n}" target="s{n}"/>' for n in range(deep))
    machine = machine_of(scxml(f"{opened}{ways}{'</state>' * deep}"), tmp_path)
    assert_nothing_lies_on_anything(machine)
    many = "".join(f'<transition event="f{n}" target="s{n}"/>' for n in range(deep))
    states = "".join(f'<state id="t{n}">{many}</state>' for n in range(30))
    large = machine_of(scxml(f"{opened}{'</state>' * deep}{states}"), tmp_path)
    with pytest.raises(TooLargeError, match=r"boxes with .* links make no readable picture"):
        draw_machine(large)


def test_mermaid_and_dot_nest_states_as_they_are_written(tmp_path: Path) -> None:
    machine = nested(tmp_path)
    (diagram,) = diagrams_of(machine)
    names = [state.name for state in diagram.states]
    on, last, a, c, b = (names.index(name) for name in ("on", "H*", "a", "c", "b"))
    mermaid = machine_as_mermaid(machine).splitlines()
    assert mermaid.count("  }") == 1
    assert f'  state "on" as s{on} {{' in mermaid
    assert f'    state "c" as s{c} {{' in mermaid
    assert f"    [*] --> s{b}: / log begin" in mermaid
    assert f"  s{on} --> s0: off" in mermaid
    assert f"  s{on}side --> s{a}: inside" in mermaid
    assert f"  s{last} --> s{b}: / log first" in mermaid
    dot = machine_as_dot(machine).splitlines()
    assert "  compound=true;" in dot
    assert f"  subgraph clusters{on} {{" in dot
    assert f"    subgraph clusters{c} {{" in dot
    assert f'  s{on} -> s0 [label="off\\l", ltail=clusters{on}];' in dot
    assert f'  s{on} -> s{a} [label="inside\\l"];' in dot
    assert f'  s0 -> s{on} [label="on\\l", lhead=clusters{on}];' in dot
