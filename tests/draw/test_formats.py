"""Wirings, policies, and the text formats."""

from __future__ import annotations

import itertools
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest

from m2c.diagnostics import Position
from m2c.draw import document, draw_policy, draw_wiring, tree_of, wiring_of
from m2c.draw.bounds import TooLargeError
from m2c.draw.dot import machine_as_dot, policy_as_dot, quoted, wiring_as_dot
from m2c.draw.mermaid import escaped, machine_as_mermaid, policy_as_mermaid, wiring_as_mermaid
from m2c.draw.wiring import POLICY
from m2c.draw.wording import short_names
from m2c.language.parsing import parse_expression
from m2c.language.text import expression_text
from m2c.model import DiagnosticLog, System, load
from m2c.policy.reader import read_policy_file
from m2c.policy.tree import PolicyFile
from tests.systems import SORTING_CELL, read

EXAMPLE = Path(__file__).parents[2] / "examples" / "lab_tour"
CALLS = tuple(f"/{name}/tick" for name in ("AlarmSkill", "BatteryLevelSkill", "WaitSkill"))


@pytest.fixture(scope="module")
def system() -> System:
    found = load([EXAMPLE / "system.xml"], DiagnosticLog())
    assert found is not None
    return found


@pytest.fixture(scope="module")
def policy() -> PolicyFile:
    found = read_policy_file(EXAMPLE / "policy.xml", DiagnosticLog())
    assert found is not None
    return found


@pytest.mark.parametrize(
    "text",
    [
        "(a + b) * c - d / (e - f)",
        "a - (b - c)",
        "(a ** b) ** c",
        "a ** b ** c",
        "!(a && b) || c",
        "-(-a)",
        "x == 1 ? 'it\\'s' : y ? [1, 2.5] : {k: null}",
        "(a ? b : c) + Math.max(d[i + 1].e, 2)",
        "Array.from({length: a + 1}, () => ({x: b}).x)",
        "Array.from({length: 2}, (_, i) => ({x: Array.from({length: i}, (_, j) => i ? j : a)}))",
        "typeof a === 'string' && _msg.data.length > 3",
    ],
)
def test_an_expression_is_written_so_that_it_is_read_as_the_same(text: str) -> None:
    def tree(written: str) -> str:
        log = DiagnosticLog()
        parsed = parse_expression(written, Position("x"), "data", log)
        assert parsed is not None, log.diagnostics
        return re.sub(r"position=Position\([^)]*\)", "", repr(parsed))

    parsed = parse_expression(text, Position("x"), "data", DiagnosticLog())
    assert parsed is not None
    assert tree(expression_text(parsed)) == tree(text)


def test_a_channel_is_called_by_as_little_as_tells_it_apart() -> None:
    names = short_names(["/a/tick", "/b/tick", "/b/halt", "plain"])
    assert names == {
        "/a/tick": "/a/tick",
        "/b/tick": "/b/tick",
        "/b/halt": "halt",
        "plain": "plain",
    }


def test_a_wiring_shows_who_uses_what(system: System) -> None:
    wiring = wiring_of(system, CALLS)
    names = [place.name for place in wiring.places]
    assert names[0] == POLICY
    wires = {
        (names[wire.user], names[wire.provider], wire.offer.channel if wire.offer else "")
        for wire in wiring.wires
    }
    assert (POLICY, "WaitSkill", "") in wires
    level = "/BatteryComponent/level"
    assert ("BatteryLevelSkill", "BatteryComponent", level) in wires
    words = "".join(ElementTree.fromstring(document(draw_wiring(wiring), "w")).itertext())
    assert all(node.name in words for node in system.nodes)


def test_a_channel_that_nobody_in_the_system_offers_is_outside(tmp_path: Path) -> None:
    loaded = load(
        [EXAMPLE / "skills" / "WaitSkill.scxml", EXAMPLE / "skills" / "GoToPoiSkill.scxml"],
        DiagnosticLog(),
    )
    assert loaded is not None
    wiring = wiring_of(loaded)
    assert [place.role for place in wiring.places] == ["node", "node", "outside"]
    assert {offer.channel for offer in wiring.places[-1].offers} == {
        "/SchedulerComponent/GetPoi",
        "/NavigationComponent/GoToPoi",
    }


def test_a_topic_and_a_service_may_have_one_name(tmp_path: Path) -> None:
    head = '<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" initial="s" name='
    for name, interfaces in (
        ("Offers", '<ros_topic_publisher name="t" topic="/x" type="std_msgs/Int32"/>'),
        ("Serves", '<ros_service_server name="s" service_name="/x" type="std_srvs/Trigger"/>'),
        (
            "Uses",
            '<ros_topic_subscriber name="t" topic="/x" type="std_msgs/Int32"/>'
            '<ros_service_client name="s" service_name="/x" type="std_srvs/Trigger"/>',
        ),
    ):
        path = tmp_path / f"{name}.scxml"
        path.write_text(f'{head}"{name}">{interfaces}<state id="s"/></scxml>')
    loaded = load([tmp_path], DiagnosticLog())
    assert loaded is not None
    wiring = wiring_of(loaded)
    names = [place.name for place in wiring.places]
    wires = {
        (names[wire.user], names[wire.provider], str(wire.offer.sort))
        for wire in wiring.wires
        if wire.offer
    }
    assert wires == {("Uses", "Offers", "topic"), ("Uses", "Serves", "service")}
    assert ElementTree.fromstring(document(draw_wiring(wiring), "w")) is not None


def test_a_policy_is_drawn_with_its_sub_trees_in_place(policy: PolicyFile) -> None:
    root = ElementTree.fromstring(document(draw_policy(tree_of(policy)), "p"))
    words = [element.text for element in root.iter("{http://www.w3.org/2000/svg}text")]
    assert words.count("not") == 2
    leaves = [leaf.name for leaf in policy.leaves()]
    assert all(name in words or f"{name}?" in words for name in leaves)


def test_sub_trees_that_multiply_are_refused(tmp_path: Path) -> None:
    trees = "".join(
        f'<BehaviorTree ID="T{i}"><Sequence><SubTree ID="T{i + 1}"/><SubTree ID="T{i + 1}"/>'
        "</Sequence></BehaviorTree>"
        for i in range(14)
    )
    path = tmp_path / "policy.xml"
    path.write_text(
        f'<root BTCPP_format="4" main_tree_to_execute="T0">{trees}'
        '<BehaviorTree ID="T14"><AlwaysSuccess/></BehaviorTree></root>'
    )
    log = DiagnosticLog()
    file = read_policy_file(path, log)
    assert file is not None
    with pytest.raises(TooLargeError):
        tree_of(file)


def test_mermaid_has_every_state_and_transition_in_its_syntax(system: System) -> None:
    line = re.compile(
        r'\s+(state "[^"]+" as \w+( \{)?|\}|(\[\*\]|\w+) --> (\[\*\]|\w+)(: .+)?|\w+: .+)'
    )
    for machine in system.nodes:
        head, *lines = machine_as_mermaid(machine).split("---\n", 2)[2].splitlines()
        assert head == "stateDiagram-v2"
        assert [text for text in lines if not line.fullmatch(text)] == []
        states = len(machine.states) + sum(len(t.machine.states) for t in machine.threads)
        boxes = len(machine.threads) + 1 if machine.threads else 0
        assert sum("state " in text for text in lines) == states + boxes


def test_mermaid_flowcharts_quote_every_label(system: System, policy: PolicyFile) -> None:
    node = re.compile(r'\s+n\d+(\["[^"]*"\]|\(\["[^"]*"\]\))')
    link = re.compile(r'\s+n\d+ (-->|---|==>|-\.->)(\|"[^"]*"\|)? n\d+')
    for text in (
        wiring_as_mermaid(wiring_of(system, CALLS)),
        policy_as_mermaid("p", tree_of(policy)),
    ):
        head, *lines = text.split("---\n", 2)[2].splitlines()
        assert head == "flowchart LR"
        assert [one for one in lines if not node.fullmatch(one) and not link.fullmatch(one)] == []


def test_nothing_in_a_text_ends_a_mermaid_label() -> None:
    assert set(re.sub(r"#\d+;", "", escaped('a"b;c#d]<x>:{-->\n`%%'))) <= set("abcdx ")


def test_dot_strings_are_closed_and_braces_match(system: System, policy: PolicyFile) -> None:
    for text in (
        *(machine_as_dot(machine) for machine in system.nodes),
        wiring_as_dot(wiring_of(system, CALLS)),
        policy_as_dot("p", tree_of(policy)),
    ):
        bare = re.sub(r'"(?:[^"\\]|\\.)*"', "S", text)
        assert '"' not in bare
        assert bare.count("{") == bare.count("}")
        statement = re.compile(r"digraph S \{|\s*subgraph \w+ \{|\s*\}|.*;")
        assert [line for line in bare.splitlines() if not statement.fullmatch(line)] == []


def test_a_dot_string_escapes_quotes_backslashes_and_entities() -> None:
    assert quoted('a"b\\c & d', "second") == '"a\\"b\\\\c &amp; d\\nsecond"'


PORTS = """<root BTCPP_format="4" main_tree_to_execute="M"><BehaviorTree ID="M">
<Sequence _skipIf="1 == 2">
  <Script code="n := 1; m := 2"/>
  <Repeat num_cycles="3" _onSuccess="n := 2"><Condition ID="Level" service_name="/Level/tick"/></Repeat>
  <Inverter _post="n := 3"><AlwaysSuccess/></Inverter>
  <Inverter><Action ID="Go" name="Go there" service_name="/Go/tick" service_name_halt="/Go/halt" speed="{n}"/></Inverter>
  <SubTree ID="T" name="twice" goal="{n}" _autoremap="true"/>
  <SubTree ID="T"/>
</Sequence></BehaviorTree>
<BehaviorTree ID="T"><SetBlackboard output_key="k" value="VALUE"/></BehaviorTree></root>"""


def ports_in(path: Path, text: str) -> tuple[PolicyFile, list[str]]:
    path.write_text(text)
    log = DiagnosticLog()
    file = read_policy_file(path, log)
    assert file is not None, log.diagnostics
    elements = ElementTree.fromstring(text).iter()
    skipped = ("ID", "name", "main_tree_to_execute", "BTCPP_format")
    return file, [
        f"{key}={value}" for one in elements for key, value in one.items() if key not in skipped
    ]


def test_every_port_and_attribute_of_a_node_is_drawn(tmp_path: Path) -> None:
    file, written = ports_in(tmp_path / "policy.xml", PORTS)
    tree = tree_of(file)
    drawn = ElementTree.fromstring(document(draw_policy(tree), "p"))
    words = [one.text for one in drawn.iter("{http://www.w3.org/2000/svg}text")]
    for port in written:
        assert words.count(port) == (2 if port in ("output_key=k", "value=VALUE") else 1)
        assert quoted(port).strip('"') in policy_as_dot("p", tree)
        assert escaped(port) in policy_as_mermaid("p", tree)
    assert "twice" in words


def test_boxes_with_many_ports_do_not_overlap(tmp_path: Path) -> None:
    many = " ".join(f'p{number}="{number}"' for number in range(12))
    sub_trees = f'<SubTree ID="T" {many}/>' * 3
    text = PORTS.replace('<SubTree ID="T"/>', sub_trees)
    file, _ = ports_in(tmp_path / "policy.xml", text)
    drawn = ElementTree.fromstring(document(draw_policy(tree_of(file)), "p"))
    columns: dict[float, list[tuple[float, float]]] = {}
    for box in drawn.iter("{http://www.w3.org/2000/svg}rect"):
        if box.get("class") in ("box", "tool") and box.get("width") != "30":
            x, y, height = (float(str(box.get(key))) for key in ("x", "y", "height"))
            columns.setdefault(x, []).append((y, y + height))
    for boxes in columns.values():
        boxes.sort()
        assert all(end <= begin for (_, end), (begin, _) in itertools.pairwise(boxes))
        assert boxes[0][0] > 20
        assert boxes[-1][1] < float(str(drawn.get("height")))


def test_a_long_value_is_shortened_in_its_box_and_in_full_where_one_points(tmp_path: Path) -> None:
    value = "ever " * 100
    file, _ = ports_in(tmp_path / "policy.xml", PORTS.replace("VALUE", value))
    tree = tree_of(file)
    text = document(draw_policy(tree), "p")
    drawn = ElementTree.fromstring(text)
    titles = [one.text or "" for one in drawn.iter("{http://www.w3.org/2000/svg}title")]
    assert any(f"value={value}" in title for title in titles)
    words = [one.text or "" for one in drawn.iter("{http://www.w3.org/2000/svg}text")]
    assert any(word.startswith("value=ever") and word.endswith("…") for word in words)
    assert float(str(drawn.get("width"))) < 1600
    assert policy_as_dot("p", tree).count("ever") == 200
    assert policy_as_mermaid("p", tree).count("ever") == 200


def test_what_a_plugin_sends_does_not_come_from_outside() -> None:
    wiring = wiring_of(read(SORTING_CELL))
    roles = {place.name: place.role for place in wiring.places}
    assert roles.keys() == {"Belt", "Bins", "Gripper", "NextParcel", "ChooseBin", "Grip", "Drop"}
    assert {name for name, role in roles.items() if role == "plugin"} == {
        *("NextParcel", "ChooseBin", "Grip", "Drop")
    }
    names = list(roles)
    wires = {(names[wire.user], names[wire.provider]) for wire in wiring.wires}
    assert {("Gripper", "Grip"), ("Grip", "Gripper"), ("NextParcel", "Belt")} < wires
