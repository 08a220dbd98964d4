"""Names that no tool could use are refused, with one that would work; texts may hold anything."""

from __future__ import annotations

from pathlib import Path

import pytest
from lxml import etree

from m2c.check.reading import read_and_check
from m2c.model import DiagnosticLog, Severity

UNSEEN = {
    "newline": ("a\nb", "a\\nb` has U+000A, a control character; write `a_b`"),
    "next line": ("a\u0085b", "a\\x85b` has U+0085, a control character; write `a_b`"),
    "line separator": ("a\u2028b", "a\\u2028b` has U+2028, line separator; write `a_b`"),
    "right to left": ("a\u202eb", "a\\u202eb` has U+202E, right-to-left override; write `ab`"),
    "zero width": ("a\u200bb", "a\\u200bb` has U+200B, zero width space; write `ab`"),
    "unassigned": ("a\u0378b", "a\\u0378b` has U+0378, unassigned; write `ab`"),
}
SLOTS = {
    "machine": "the machine's name",
    "state": "the state",
    "event": "the event",
    "send": "the event",
    "id": "the id",
    "cancel": "the id",
    "variable": "the variable",
    "timer": "the timer's name",
    "topic": "the channel",
    "publisher": "the name of a publisher",
    "in": "the port",
    "out": "the port",
    "lookup": "the port",
    "thread state": "the state",
}


def model(names: dict[str, str]) -> bytes:
    """A machine with a name in every slot; those that ``names`` does not give are plain."""

    def of(slot: str) -> str:
        return names.get(slot, slot.replace(" ", "_"))

    root = etree.Element("scxml", name=of("machine"), xmlns="http://www.w3.org/2005/07/scxml")
    etree.SubElement(root, "bt_declare_port_in", key=of("in"), type="int32")
    etree.SubElement(root, "bt_declare_port_out", key=of("out"), type="int32")
    etree.SubElement(root, "ros_time_rate", name=of("timer"), rate_hz="1")
    etree.SubElement(root, "bt_declare_port_in", key=of("lookup"), type="string")
    topic = f"/{of('topic')}"
    attributes = {"name": of("publisher"), "topic": topic, "type": "std_msgs/Int32"}
    etree.SubElement(root, "ros_topic_publisher", attributes)
    reader = etree.SubElement(root, "ros_topic_subscriber", type="std_msgs/Int32")
    etree.SubElement(etree.SubElement(reader, "topic"), "bt_get_input", key=of("lookup"))
    action = {"name": "act", "action_name": "/act", "type": "example_interfaces/action/Do"}
    etree.SubElement(root, "ros_action_server", action)
    data = etree.SubElement(root, "datamodel")
    etree.SubElement(data, "data", id=of("variable"), expr="0")
    state = etree.SubElement(root, "state", id=of("state"))
    entry = etree.SubElement(state, "onentry")
    etree.SubElement(entry, "log", label=names.get("label", ""), expr="1")
    etree.SubElement(entry, "raise", event=of("event"))
    etree.SubElement(entry, "send", event=of("send"), id=of("id"), delay="1s")
    etree.SubElement(entry, "cancel", sendid=of("cancel"))
    thread = etree.SubElement(root, "ros_action_thread", name="act")
    etree.SubElement(thread, "state", id=of("thread state"))
    return etree.tostring(root)


def errors(folder: Path, content: bytes, name: str = "m") -> list[str]:
    """What the check finds wrong with the model, without its path."""
    path = folder / f"{name}.scxml"
    path.write_bytes(content)
    action = folder / "interfaces" / "example_interfaces" / "action" / "Do.action"
    action.parent.mkdir(parents=True, exist_ok=True)
    action.write_text("---\n---\n")
    log = DiagnosticLog()
    read_and_check([path], [], log)
    found = [item for item in log.diagnostics if item.severity is Severity.ERROR]
    return [str(item).replace(f"{path}:", "") for item in found]


def test_a_model_with_plain_names_in_every_slot_is_accepted(tmp_path: Path) -> None:
    assert errors(tmp_path, model({})) == []


@pytest.mark.parametrize("slot", SLOTS)
@pytest.mark.parametrize("what", UNSEEN)
def test_a_name_with_what_cannot_be_seen_is_refused_in_every_slot(
    tmp_path: Path, slot: str, what: str
) -> None:
    text, message = UNSEEN[what]
    (found,) = errors(tmp_path, model({slot: text}))
    message = message.replace("write `", "write `/") if slot == "topic" else message
    assert found.endswith(f"{message} [bad-name]")
    assert SLOTS[slot] in found
    assert found.startswith("1:")
    assert text not in found


@pytest.mark.parametrize("slot", SLOTS)
def test_a_name_of_more_than_255_characters_is_refused_and_one_of_255_is_not(
    tmp_path: Path, slot: str
) -> None:
    longest = "x" * (254 if slot == "topic" else 255)
    assert errors(tmp_path, model({slot: longest})) == []
    (found,) = errors(tmp_path, model({slot: f"{longest}x"}))
    assert "…` has 256 characters; a name has at most 255 [bad-name]" in found


@pytest.mark.parametrize(
    "name",
    ["'", '"""', "\\", "{{ x }}", "os.system('x')", "a b", "é", "漢字", "e\u0301", "#", "%s"],
)
def test_a_name_may_have_any_character_that_can_be_seen(tmp_path: Path, name: str) -> None:
    slots = {slot: name for slot in SLOTS if slot != "variable"}
    slots["in"], slots["out"] = f"{name}1", f"{name}2"
    if name == "#":  # Zenoh's: see the test of channels
        del slots["topic"]
    assert errors(tmp_path, model(slots)) == []


@pytest.mark.parametrize("text", ["a\nb", "\u202e", "x" * 300, "\u0378"])
def test_the_label_of_a_log_may_have_any_character(tmp_path: Path, text: str) -> None:
    assert errors(tmp_path, model({"label": text})) == []


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("1a", "_1a"),
        ("a b", "a_b"),
        ("a-b", "a_b"),
        ("class", "class_"),
        ("true", "true_"),
        ("_event", "_event_"),
        ("_msg", "_msg_"),
        ("undefined", "undefined_"),
        ("²", "_"),
    ],
)
def test_a_variable_that_no_expression_can_name_is_refused(
    tmp_path: Path, name: str, hint: str
) -> None:
    (found,) = errors(tmp_path, model({"variable": name}))
    assert found == (
        f"1:{found.split(':')[1]}: error: <data>: no expression can name the variable `{name}`; "
        f"write `{hint}` [bad-name]"
    )
    assert errors(tmp_path, model({"variable": hint})) == []


@pytest.mark.parametrize("name", ["ﬁ", "ª", "K", "None", "self", "é", "__init__", "print", "$"])
def test_a_variable_may_have_any_name_of_ecmascript(tmp_path: Path, name: str) -> None:
    assert errors(tmp_path, model({"variable": name})) == []


@pytest.mark.parametrize(
    ("channel", "hint"), [("a//b", "/a/b"), ("/", "/node/value"), ("a/", "/a"), ("a/ /b", "/a/b")]
)
def test_a_channel_with_an_empty_part_is_refused(tmp_path: Path, channel: str, hint: str) -> None:
    (found,) = errors(tmp_path, model({"topic": channel}))
    assert found.endswith(f"has an empty part; write it like {hint} [bad-name]")


def test_the_name_of_a_system_is_checked_though_no_element_has_it(tmp_path: Path) -> None:
    (found,) = errors(tmp_path, model({}), "a\u202eb")
    assert "the system's name `a\\u202eb`" in found


def test_a_plain_machine_must_have_a_name_without_its_suffix(tmp_path: Path) -> None:
    tick = tmp_path / "interfaces" / "bt_interfaces" / "srv" / "TickAction.srv"
    tick.parent.mkdir(parents=True)
    tick.write_text("---\nint8 status\n")
    content = (
        b'<scxml xmlns="http://www.w3.org/2005/07/scxml" name="Action"><state id="a">'
        b'<transition event="CMD_TICK"><send event="TICK_RESPONSE"><param name="status" expr="1"/>'
        b"</send></transition></state></scxml>"
    )
    machine, channel = errors(tmp_path, content)
    assert machine == (
        "1:1: error: <scxml>: nothing is left of the machine's name without `Action` and "
        "`Condition`; write it like BatteryAction [bad-name]"
    )
    assert "the channel `//tick` has an empty part" in channel


SYSTEM = (
    '<roaml><behavior_tree><input type="bt.cpp-xml" src="tree.xml"/></behavior_tree>'
    '<node_models><input type="node-ascxml" src="m.scxml"/></node_models></roaml>'
)


def test_a_node_may_not_have_the_name_of_the_one_that_ticks_the_policy(tmp_path: Path) -> None:
    (tmp_path / "m.scxml").write_text(
        '<scxml xmlns="http://www.w3.org/2005/07/scxml" name="policy"><state id="a"/></scxml>'
    )
    (tmp_path / "tree.xml").write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><AlwaysSuccess/></BehaviorTree></root>'
    )
    path = tmp_path / "system.xml"
    path.write_text(SYSTEM)
    log = DiagnosticLog()
    read_and_check([path], [], log)
    (found,) = log.diagnostics
    assert str(found).endswith(
        "m.scxml:1:1: error: <scxml>: the node that ticks the policy is called `policy`, too; "
        "give the machine another name [duplicate-node]"
    )
