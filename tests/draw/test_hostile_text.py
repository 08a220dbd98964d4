"""Pictures of models whose every text is hostile: it is shown, and is no part of the picture's language."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from lxml import etree
from ruamel.yaml import YAML

from m2c.draw import document, draw_machine, draw_policy, draw_wiring, inline, tree_of, wiring_of
from m2c.draw.dot import machine_as_dot, policy_as_dot, wiring_as_dot
from m2c.draw.mermaid import machine_as_mermaid, policy_as_mermaid, wiring_as_mermaid
from m2c.draw.policy import Node
from m2c.draw.wiring import Wiring
from m2c.model import DiagnosticLog, Machine, System, load
from m2c.policy.reader import read_policy_file
from m2c.printable import printable

EXAMPLE = Path(__file__).parents[2] / "examples" / "lab_tour"
PAYLOADS = (
    '"];evil[label="x',
    'back\\slash \\" \\N \\G \\l \\',
    'line\nclick s0 href "javascript:alert(1)"\r\n\u2028x --> y',
    '%%{init: {"securityLevel": "loose"}}%%',
    "<script>alert(1)</script>]]><!-- & &lt; <b onclick='x'>",
    "</text></svg><svg onload=alert(1)>",
    "\x00\x1b]0;owned\x07\x1b[2J\x9b\x7f\ufffe\udcff",
    "\u202egnp.\u2066x\u200b\u00ad",
    *(
        "end",
        "graph",
        "node",
        "subgraph",
        "digraph",
        "strict",
        "edge",
        "state",
        "note",
        "[*]",
        "---",
    ),
    "<" + 300 * "x" + ">",
    "a:::b; `**c**` $$d$$ fa:fa-car #35; @{shape: x} ~~~ ",
)
hostile = st.one_of(
    st.sampled_from(PAYLOADS),
    st.text(st.characters(), min_size=1, max_size=30),
    st.text("\"\\<>&%{}[]()|;:#`'-=\n /\u202e\x1b", min_size=1, max_size=20),
)


def every_payload(test: Callable[..., None]) -> Callable[..., None]:
    """Tries ``test`` with each of them, whatever else is tried."""
    for payload in PAYLOADS:
        test = example(text=payload)(test)
    return test


MACHINE = """<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="NAME" initial="STATE">
<datamodel><data id="VARIABLE" expr="''" type="string"/></datamodel>
<ros_topic_publisher name="PORT" topic="/CHANNEL" type="std_msgs/String"/>
<ros_service_client name="CLIENT" service_name="/SERVICE" type="std_srvs/Trigger"/>
<state id="STATE"><onentry><log label="LABEL" expr="'TEXT'"/></onentry>
<transition event="EVENT" cond="VARIABLE == 'OTHER'" target="TARGET">
<ros_topic_publish name="PORT"><field name="data" expr="'TEXT'"/></ros_topic_publish>
<send event="SENT" delay="1s" id="TIMER"/><cancel sendid="TIMER"/></transition>
<transition event="EVENT" target="STATE"/></state><final id="TARGET"/></scxml>"""
SLOTS = re.findall(r"[A-Z]{4,}", re.sub(r"<[?!].*?>", "", MACHINE))


def swapped(value: Any, swap: Callable[[str], str]) -> Any:
    """``value`` with ``swap`` of every text in it that is a model's."""
    match value:
        case msgspec.Struct():
            fields = {name: getattr(value, name) for name in value.__struct_fields__}
            changed = {name: swapped(inner, swap) for name, inner in fields.items()}
            return msgspec.structs.replace(value, **changed)
        case tuple():
            return tuple(swapped(inner, swap) for inner in value)
        case str() if type(value) is str:
            return swap(value)
        case _:
            return value


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    path = tmp_path_factory.mktemp("models") / "model.scxml"
    path.write_text(MACHINE)
    log = DiagnosticLog()
    system = load([path], log)
    assert system is not None
    assert not log.has_errors, log.diagnostics
    return system.nodes[0]


def machine_of(machine: Machine, text: str) -> Machine:
    """``machine`` with ``text`` in the place of each of its texts; states are told apart."""
    words = dict.fromkeys(SLOTS, text) | {"TARGET": f"{text}2"}
    words |= {f"/{word}": f"/{text}/{word}" for word in ("CHANNEL", "SERVICE")}
    made: Machine = swapped(machine, lambda word: words.get(word, word))
    assert made.name == text
    return made


def wiring_with(machine: Machine, text: str) -> Wiring:
    user = machine_of(machine, text)
    offering = msgspec.structs.replace(user, name=f"{text}3")
    system = System(
        name=text,
        path=Path(),
        nodes=(user, offering),
        library=None,  # type: ignore[arg-type]  # not looked at
    )
    return wiring_of(system)


def tree_with(text: str) -> Node:
    file = read_policy_file(EXAMPLE / "policy.xml", DiagnosticLog())
    assert file is not None

    def renamed(node: Node) -> Node:
        children = [renamed(child) for child in node.children]
        return msgspec.structs.replace(node, name=text, children=children)

    return renamed(tree_of(file))


TAGS = {
    *("svg", "title", "style", "defs", "marker", "path", "rect", "circle", "g", "text"),
}
ATTRIBUTES = {
    *("width", "height", "viewBox", "font-family", "font-size", "id", "refX", "refY"),
    *("markerWidth", "markerHeight", "markerUnits", "orient", "class", "d", "fill", "x", "y"),
    *("rx", "cx", "cy", "r", "text-anchor", "marker-end", "data-keys", "role"),
}


def require_svg(text: str, shown: str) -> None:
    """That ``text`` is a well-formed picture of ours, with ``shown`` among its words."""
    root = etree.fromstring(text.encode(), etree.XMLParser(resolve_entities=False))
    for element in root.iter():
        assert isinstance(element.tag, str), "a comment or an instruction"
        assert etree.QName(element).localname in TAGS
        assert {str(key) for key in element.attrib} <= ATTRIBUTES
        for value in element.attrib.values():
            assert re.fullmatch(r"[\w .,:#()-]*", str(value), re.ASCII), value
    words = "".join(str(word) for word in root.itertext())
    assert all(c.isprintable() or c == "\n" for c in words)
    assert shown in words


@settings(max_examples=40, deadline=None)
@given(text=hostile)
@every_payload
def test_an_svg_has_no_element_or_attribute_that_is_not_ours(machine: Machine, text: str) -> None:
    made = machine_of(machine, text)
    shown = printable(text)[:40]
    require_svg(document(draw_machine(made), made.name), shown)
    require_svg(document(draw_wiring(wiring_with(machine, text)), text), shown)
    require_svg(document(draw_policy(tree_with(text)), text), shown)
    require_svg(inline(draw_machine(made, "d0-"), text, "d0-"), shown)


STRING = re.compile(r'"(?:[^"\\\n]|\\.)*"')
TOKEN = re.compile(rf"{STRING.pattern}|\w+(?:\.\d+)?|->|[{{}}\[\];=,]|\s+")
WORDS = {
    *("digraph", "subgraph", "node", "edge", "label", "labelloc", "fontname", "fontsize", "shape"),
    *("box", "arrowsize", "circle", "style", "filled", "fillcolor", "black", "width", "rounded"),
    *("peripheries", "rankdir", "LR", "ordering", "out", "dashed", "dotted", "solid", "bold"),
    *("dir", "back", "t"),
}
OWN = re.compile(r"(s|n|m\d+s)(\d+|start)|cluster\d+|\d+(\.\d+)?")


def require_dot(text: str, shown: str) -> None:
    """That all names and words of ``text`` are ours, and ``shown`` stands in a label as it is."""
    at = 0
    strings = []
    while at < len(text):
        found = TOKEN.match(text, at)
        assert found is not None, text[at : at + 40]
        at = found.end()
        token = found[0]
        if token.startswith('"'):
            assert re.fullmatch(r'"(?:[^"\\]|\\["\\nl])*"', token), token
            assert not re.search(r"&(?!amp;)", token), token
            strings.append(re.sub(r'\\(["\\])', r"\1", token).replace("&amp;", "&"))
        elif re.match(r"\w", token):
            assert token in WORDS or OWN.fullmatch(token), token
    assert all(c.isprintable() or c == "\n" for c in text)
    assert any(shown in string for string in strings)


@settings(max_examples=40, deadline=None)
@given(text=hostile)
@every_payload
def test_a_dot_file_has_no_name_or_attribute_that_is_not_ours(machine: Machine, text: str) -> None:
    shown = printable(text)
    require_dot(machine_as_dot(machine_of(machine, text)), shown)
    require_dot(wiring_as_dot(wiring_with(machine, text)), shown)
    require_dot(policy_as_dot(text, tree_with(text)), shown)


LABEL = r"(?:[A-Za-z0-9 _,=/()+*|!?']|#\d+;|<br/>)*"
STATEMENT = re.compile(
    rf'\s+(?:state "{LABEL}" as s\d+|s\d+: {LABEL}|(?:\[\*\]|s\d+) --> (?:\[\*\]|s\d+)(?:: {LABEL})?'
    rf'|n\d+(?:\["{LABEL}"\]|\(\["{LABEL}"\]\))|n\d+ (?:-->|---|==>|-\.->)(?:\|"{LABEL}"\|)? n\d+)'
)


def require_mermaid(text: str, title: str) -> None:
    """That every line of ``text`` is one of ours, and the title is ``title``."""
    fence, head, other_fence, kind, *lines = text.split("\n")
    assert (fence, other_fence) == ("---", "---")
    assert kind in ("stateDiagram-v2", "flowchart LR")
    assert re.fullmatch(r'title: "[^"%<>{}`#]*"', head), head
    assert YAML(typ="safe").load(head)["title"] == printable(" ".join(title.split()))
    assert [line for line in lines if line and not STATEMENT.fullmatch(line)] == []
    codes = [chr(int(code)) for code in re.findall(r"#(\d+);", text)]
    assert all(code.isprintable() for code in codes)


@settings(max_examples=40, deadline=None)
@given(text=hostile)
@every_payload
def test_a_mermaid_text_has_no_line_or_label_that_is_not_ours(machine: Machine, text: str) -> None:
    require_mermaid(machine_as_mermaid(machine_of(machine, text)), text)
    require_mermaid(wiring_as_mermaid(wiring_with(machine, text)), text)
    require_mermaid(policy_as_mermaid(text, tree_with(text)), text)
