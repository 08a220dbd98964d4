"""State machine diagrams: everything is there once, nothing lies on anything else."""

from __future__ import annotations

import random
import re
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest

from m2c.draw import document, draw_machine, inline, transition_keys
from m2c.model import DiagnosticLog, Machine, load

EXAMPLE = Path(__file__).parents[2] / "examples" / "lab_tour"
SEED = Path(__file__).parents[3] / "shared" / "seed_models" / "lab_tour" / "policies" / "main.xml"
SVG = "{http://www.w3.org/2000/svg}"
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")

Rectangle = tuple[float, float, float, float]


def machines(path: Path) -> tuple[Machine, ...]:
    system = load([path], DiagnosticLog())
    assert system is not None
    return (*system.nodes, *system.plugins)


def machine_of(text: str, tmp_path: Path) -> Machine:
    path = tmp_path / "model.scxml"
    path.write_text(text, encoding="utf-8")
    log = DiagnosticLog()
    system = load([path], log)
    assert not log.has_errors, log.diagnostics
    assert system is not None
    return system.nodes[0]


def scxml(states: str, initial: str = "s0") -> str:
    root = '<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="M"'
    return f'{root} initial="{initial}">{states}</scxml>'


def random_machine(seed: int, tmp_path: Path) -> Machine:
    choice = random.Random(seed)
    count = choice.randint(2, 9)
    states = []
    for index in range(count):
        transitions = "".join(
            f'<transition event="e{choice.randint(0, 9)}" target="s{choice.randrange(count)}">'
            '<log label="a rather long label of an action"/></transition>'
            for _ in range(choice.randint(0, 4))
        )
        states.append(f'<state id="s{index}">{transitions}</state>')
    return machine_of(scxml("".join(states)), tmp_path)


def parsed(machine: Machine) -> ElementTree.Element:
    return ElementTree.fromstring(document(draw_machine(machine), machine.name))


def rectangle(shape: ElementTree.Element) -> Rectangle:
    x, y, width, height = (float(shape.get(key, "0")) for key in ("x", "y", "width", "height"))
    return (x, y, x + width, y + height)


def obstacles(root: ElementTree.Element) -> list[Rectangle]:
    """States, and labels that stand beside arrows."""
    found, inside = [], set()
    for group in root.iter(f"{SVG}g"):
        if group.get("class") == "state":
            box = group.find(f"{SVG}rect")
            assert box is not None
            found.append(rectangle(box))
            inside.update(id(one) for one in group.iter(f"{SVG}g"))
    for group in root.iter(f"{SVG}g"):
        if group.get("class") == "transition" and id(group) not in inside:
            ground = group.find(f"{SVG}rect")
            if ground is None:  # a transition without words: the arrow is all of it
                continue
            found.append(rectangle(ground))
    return found


def overlap(one: Rectangle, other: Rectangle) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


def along(path: str) -> Iterator[tuple[float, float]]:
    """Points of an SVG path of lines and cubic curves."""
    here = (0.0, 0.0)
    for command, values in re.findall(r"([MLC])([^MLC]*)", path):
        numbers = [float(value) for value in NUMBER.findall(values)]
        if command == "M":
            here = (numbers[0], numbers[1])
        elif command == "L":
            end = (numbers[0], numbers[1])
            for step in range(1, 21):
                yield (
                    here[0] + (end[0] - here[0]) * step / 20,
                    here[1] + (end[1] - here[1]) * step / 20,
                )
            here = end
        else:
            ends = [here, *zip(numbers[::2], numbers[1::2], strict=True)]
            for step in range(1, 21):
                t = step / 20
                weights = ((1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t * t * (1 - t), t**3)
                yield (
                    sum(w * point[0] for w, point in zip(weights, ends, strict=True)),
                    sum(w * point[1] for w, point in zip(weights, ends, strict=True)),
                )
            here = ends[-1]


def assert_nothing_lies_on_anything(machine: Machine) -> None:
    root = parsed(machine)
    found = obstacles(root)
    for index, one in enumerate(found):
        assert not [other for other in found[:index] if overlap(one, other)]
    for arrow in root.iter(f"{SVG}path"):
        if arrow.get("class") != "line":
            continue
        for x, y in along(arrow.get("d", "")):
            for left, top, right, bottom in found:
                assert not (left + 1 < x < right - 1 and top + 1 < y < bottom - 1)
    width, height = float(root.get("width", "")), float(root.get("height", ""))
    assert all(x >= 0 and y >= 0 and r <= width and b <= height for x, y, r, b in found)


@pytest.mark.parametrize(
    "machine", machines(EXAMPLE / "system.xml"), ids=lambda machine: machine.name
)
def test_no_label_state_or_arrow_of_the_lab_tour_lies_on_another(machine: Machine) -> None:
    assert_nothing_lies_on_anything(machine)


@pytest.mark.seed
@pytest.mark.skipif(not SEED.exists(), reason="the published case study is not here")
def test_no_label_state_or_arrow_of_the_published_lab_tour_lies_on_another() -> None:
    for machine in machines(SEED):
        assert_nothing_lies_on_anything(machine)


@pytest.mark.parametrize("seed", range(40))
def test_no_label_state_or_arrow_of_any_machine_lies_on_another(seed: int, tmp_path: Path) -> None:
    assert_nothing_lies_on_anything(random_machine(seed, tmp_path))


@pytest.mark.parametrize(
    "machine", machines(EXAMPLE / "system.xml"), ids=lambda machine: machine.name
)
def test_every_transition_has_an_element_of_its_own(machine: Machine) -> None:
    root = parsed(machine)
    states = [*machine.states, *(s for thread in machine.threads for s in thread.machine.states)]
    transitions = [transition for state in states for transition in state.transitions]
    shown = [g.get("id", "") for g in root.iter(f"{SVG}g") if g.get("class") == "transition"]
    assert sorted(shown) == sorted(f"t{number}" for number in range(len(transitions)))
    keys = transition_keys(machine)
    assert {str(transition.position) for transition in transitions} == set(keys)
    assert sorted(" ".join(keys.values()).split()) == sorted(shown)


def test_the_text_of_a_model_is_text_and_no_markup(tmp_path: Path) -> None:
    machine = machine_of(
        scxml(
            '<state id="s0"><transition event="e" cond="1 &lt; 2 &amp;&amp; true" target="s1">'
            "<log label=\"&lt;/text&gt;&lt;script&gt;alert('x')&lt;/script&gt;\"/></transition></state>"
            '<state id="s1"/>'
        ),
        tmp_path,
    )
    root = parsed(machine)
    words = [element.text for element in root.iter(f"{SVG}text")]
    assert "[1 < 2 && true]" in words
    assert "log </text><script>alert('x')</script>" in words
    assert not list(root.iter("script"))
    assert not list(root.iter(f"{SVG}script"))


def test_the_same_model_gives_the_same_bytes() -> None:
    for machine in machines(EXAMPLE / "system.xml"):
        assert document(draw_machine(machine), "x") == document(draw_machine(machine), "x")


def test_two_pictures_in_a_page_share_no_id() -> None:
    one, other = machines(EXAMPLE / "system.xml")[:2]
    texts = [
        inline(draw_machine(machine, f"m{number}-"), machine.name, f"m{number}-")
        for number, machine in enumerate((one, other))
    ]
    found = [set(re.findall(r' id="([^"]*)"', text)) for text in texts]
    assert all(found)
    assert not found[0] & found[1]
    for text, ids in zip(texts, found, strict=True):
        assert set(re.findall(r"url\(#([^)]*)\)", text)) <= ids


def test_a_state_entered_again_and_a_choice_by_probability_are_told(tmp_path: Path) -> None:
    machine = machine_of(
        scxml(
            '<state id="s0"><transition event="again" target="s0"/>'
            '<transition event="e"><target id="s1" prob="0.25"/><target id="s2" prob="0.75"/>'
            '</transition></state><state id="s1"/><final id="s2"/>'
        ),
        tmp_path,
    )
    root = parsed(machine)
    words = [element.text for element in root.iter(f"{SVG}text")]
    assert "↺ again" in words
    assert {"with probability 0.25", "with probability 0.75"} <= set(words)
    ids = [g.get("id") for g in root.iter(f"{SVG}g") if g.get("class") == "transition"]
    assert sorted(map(str, ids)) == ["t0", "t1", "t1-1"]


def test_a_machine_of_hundreds_of_states_is_drawn(tmp_path: Path) -> None:
    states = "".join(
        f'<state id="s{i}"><transition event="a" target="s{(i * 7 + 1) % 150}"/>'
        f'<transition event="b" target="s{(i + 1) % 150}"/></state>'
        for i in range(150)
    )
    root = parsed(machine_of(scxml(states), tmp_path))
    assert sum(g.get("class") == "state" for g in root.iter(f"{SVG}g")) == 150
