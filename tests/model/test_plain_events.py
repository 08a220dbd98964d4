"""``<send event>`` without a channel: which events are messages between machines, and of which types."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

import m2c
from m2c.check import check_system
from m2c.check.reading import read_and_check
from m2c.language.datatypes import FLOAT64, INT64, STRING, Array, DataType, Primitive, describe
from m2c.model import DiagnosticLog, load
from m2c.model.loading import linked
from m2c.model.machine import Emit, EventKind, InterfaceKind, Machine, Raise
from m2c.model.naming import Naming
from m2c.model.system import read_with_reference
from m2c.model.walk import events_of, statements_of
from transports.registry import name_rules

INT16 = Primitive("int16")


def machine(name: str, body: str, tag: str = "ascxml") -> str:
    return (
        f'<{tag} xmlns="http://www.w3.org/2005/07/scxml" name="{name}" initial="s">{body}</{tag}>'
    )


def sender(name: str, *sends: str, data: str = "", take: str = "") -> str:
    model = f"<datamodel>{data}</datamodel>" if data else ""
    return machine(name, f'{model}<state id="s"><onentry>{"".join(sends)}</onentry>{take}</state>')


def send(event: str, attributes: str = "", **params: str) -> str:
    inner = "".join(f'<param name="{name}" expr="{value}"/>' for name, value in params.items())
    return f'<send event="{event}" {attributes}>{inner}</send>'


def taker(name: str, *events: str, body: str = "", data: str = "") -> str:
    model = f"<datamodel>{data}</datamodel>" if data else ""
    taken = "".join(f'<transition event="{event}">{body}</transition>' for event in events)
    return machine(name, f'{model}<state id="s">{taken}</state>')


def variable(name: str, kind: str, value: str = "0") -> str:
    return f'<data id="{name}" type="{kind}" expr="{value}"/>'


class Read:
    """Models read together, each from a file of its own, ``0.ascxml`` and so on."""

    def __init__(self, folder: Path, *models: str, naming: Naming | None = None) -> None:
        for number, text in enumerate(models):
            (folder / f"{number}.ascxml").write_text(text)
        self.folder = folder
        self.log = DiagnosticLog()
        found = read_and_check([folder], [], self.log, naming=naming or Naming())
        assert found is not None
        self.system = found

    @property
    def findings(self) -> list[str]:
        return [str(item).replace(f"{self.folder}/", "") for item in self.log.diagnostics]

    def node(self, name: str) -> Machine:
        found = self.system.node(name)
        assert found is not None
        return found

    def fields(self, type_name: str) -> dict[str, DataType]:
        return dict(self.system.library.message(f"plain_events/msg/{type_name}").fields)


def sent(owner: Machine) -> list[str]:
    return [item.interface for item in statements_of(owner) if isinstance(item, Emit)]


def queued(owner: Machine) -> list[str]:
    return [item.event for item in statements_of(owner) if isinstance(item, Raise)]


def taken(owner: Machine) -> list[tuple[str, str]]:
    return [(str(event.kind), event.name) for event in events_of(owner)]


def test_an_event_that_another_machine_takes_is_a_message_on_its_own_topic(tmp_path: Path) -> None:
    read = Read(tmp_path, sender("A", send("arm.done", n="1")), taker("B", "arm.done"))
    assert read.findings == []
    (out,) = read.node("A").interfaces
    assert (out.kind, out.channel, out.type_name, out.event) == (
        InterfaceKind.PUBLISHER, "/plain_events/arm/done", "plain_events/msg/ArmDone", "arm.done",
    )  # fmt: skip
    (into,) = read.node("B").interfaces
    assert (into.kind, into.channel) == (InterfaceKind.SUBSCRIBER, out.channel)
    assert sent(read.node("A")) == ["/plain_events/arm/done"]
    assert taken(read.node("B")) == [("message", "/plain_events/arm/done")]
    assert read.fields("ArmDone") == {"n": INT64}


def test_an_event_that_one_machine_alone_sends_and_takes_is_its_own(tmp_path: Path) -> None:
    own = sender("A", send("go"), take='<transition event="go" target="s"/>')
    read = Read(tmp_path, own, taker("B", "other"))
    assert queued(read.node("A")) == ["go"]
    assert read.node("A").interfaces == read.node("B").interfaces == ()
    assert read.system.library.defined() == ()


def test_a_sender_that_takes_the_event_is_one_of_its_receivers(tmp_path: Path) -> None:
    both = sender("A", send("go"), take='<transition event="go" target="s"/>')
    read = Read(tmp_path, both, taker("B", "go"))
    assert [item.kind for item in read.node("A").interfaces] == [
        InterfaceKind.PUBLISHER,
        InterfaceKind.SUBSCRIBER,
    ]
    assert queued(read.node("A")) == []
    assert taken(read.node("A")) == [("message", "/plain_events/go")]


def test_an_event_that_nobody_takes_is_published_whether_others_were_read_or_not(
    tmp_path: Path,
) -> None:
    read = Read(tmp_path, sender("A", send("success", ok="true")))
    assert read.findings == []
    assert sent(read.node("A")) == ["/plain_events/success"]


def test_an_event_that_nobody_sends_is_left_as_it_is(tmp_path: Path) -> None:
    read = Read(tmp_path, taker("A", "never"))
    assert taken(read.node("A")) == [("internal", "never")]


@pytest.mark.parametrize("content", ['<raise event="go"/>', send("go", 'target="#_internal"')])
def test_what_a_machine_raises_goes_to_nobody_else(tmp_path: Path, content: str) -> None:
    read = Read(tmp_path, sender("A", content), taker("B", "go"))
    assert queued(read.node("A")) == ["go"]
    assert taken(read.node("B")) == [("internal", "go")]


def test_an_event_that_is_raised_too_is_taken_from_both_sides(tmp_path: Path) -> None:
    own = sender("B", '<raise event="go"/>', take='<transition event="go"/>')
    read = Read(tmp_path, sender("A", send("go")), own)
    assert taken(read.node("B")) == [("message", "/plain_events/go"), ("internal", "go")]


def test_a_delayed_event_is_a_timer_of_the_machine_that_takes_it(tmp_path: Path) -> None:
    timer = send("late", 'delay="1s" id="t"')
    models = [sender(name, timer, take='<transition event="late"/>') for name in "AB"]
    read = Read(tmp_path, *models)
    assert read.findings == []
    assert queued(read.node("A")) == queued(read.node("B")) == ["late"]
    assert read.node("A").interfaces == ()


def test_a_delayed_event_for_others_is_refused(tmp_path: Path) -> None:
    read = Read(tmp_path, sender("A", send("late", 'delay="1s"')), taker("B", "late"))
    assert read.findings == [
        "0.ascxml:1:93: error: <send>: `late` goes to other machines, and is sent with a delay; delay an "
        "event of the machine's own, and send this one when that is taken [unsupported-event]"
    ]


def test_a_transition_takes_every_event_that_its_descriptor_is_for(tmp_path: Path) -> None:
    sends = [send("arm.done"), send("arm.failed"), send("armed")]
    read = Read(tmp_path, sender("A", *sends), taker("B", "arm"), taker("C", "arm.* x"))
    both = [("message", "/plain_events/arm/done"), ("message", "/plain_events/arm/failed")]
    assert taken(read.node("B")) == both
    assert taken(read.node("C")) == [*both, ("internal", "x")]
    read = Read(tmp_path, sender("A", *sends), taker("B", "*"), taker("C", "x"))
    assert taken(read.node("B")) == [
        *both, ("message", "/plain_events/armed"), ("internal", "*"),
    ]  # fmt: skip


def test_params_have_the_types_of_what_they_are_computed_from(tmp_path: Path) -> None:
    data = variable("n", "int16") + variable("list", "string[&lt;=3]", "[]")
    params = send("e", n="n", more="n + 1", half="n / 2", list="list", word="'a' + n", raw="[1, 2]")
    read = Read(tmp_path, sender("A", params, data=data))
    assert read.fields("E") == {
        "n": INT16,
        "more": INT64,
        "half": FLOAT64,
        "list": Array(STRING, 3),
        "word": STRING,
        "raw": Array(INT64),
    }


def test_a_literal_takes_the_type_that_other_senders_give(tmp_path: Path) -> None:
    one = sender("A", send("e", n="1", list="[]", x="2"))
    data = variable("n", "int16") + variable("l", "int8[]", "[]") + variable("x", "float32", "0.5")
    read = Read(tmp_path, one, sender("B", send("e", n="n", list="l", x="x"), data=data))
    assert read.fields("E") == {
        "n": INT16, "list": Array(Primitive("int8")), "x": Primitive("float32"),
    }  # fmt: skip
    read = Read(
        tmp_path, sender("A", send("e", n="70000")), sender("B", send("e", n="n"), data=data)
    )
    assert read.findings == [
        "0.ascxml:1:132: error: <param>: 70000 does not fit int16; int16 holds -32768 to 32767 "
        "[out-of-range]"
    ]


def test_numbers_of_two_types_widen(tmp_path: Path) -> None:
    first = sender("A", send("e", n="n", x="n"), data=variable("n", "int16"))
    second = sender(
        "B", send("e", n="n", x="x"), data=variable("n", "uint8") + variable("x", "float32", "0.5")
    )
    read = Read(tmp_path, first, second)
    assert read.findings == []
    assert read.fields("E") == {"n": INT64, "x": FLOAT64}


def test_a_number_without_a_type_is_a_float64(tmp_path: Path) -> None:
    read = Read(tmp_path, sender("A", send("e", n="n"), data='<data id="n" expr="0"/>'))
    assert read.findings == []
    assert read.fields("E") == {"n": FLOAT64}


def test_params_that_others_brought_keep_their_types_through_many_machines(tmp_path: Path) -> None:
    relays = [
        taker(f"R{i}", f"e{i}", body=send(f"e{i - 1}", n="_event.data.n")) for i in range(9, 0, -1)
    ]
    first = sender("A", send("e9", n="n"), data=variable("n", "int16"))
    read = Read(tmp_path, *reversed(relays), first)
    assert read.findings == []
    assert read.fields("E0") == read.fields("E5") == {"n": INT16}


def test_structures_are_params_too(tmp_path: Path) -> None:
    data = variable("at", "geometry_msgs/Point", "{'x': 1, 'y': 2, 'z': 3}")
    body = '<assign location="x" expr="_event.data.at.x"/>'
    hears = taker("B", "moved", body=body, data=variable("x", "float64", "0.5"))
    read = Read(tmp_path, sender("A", send("moved", at="at"), data=data), hears)
    assert read.findings == []
    assert describe(read.fields("Moved")["at"]) == "geometry_msgs/msg/Point"


def test_two_types_of_a_param_are_one_error_with_both_places(tmp_path: Path) -> None:
    first = sender("A", send("e", n="n"), data=variable("n", "int16"))
    read = Read(tmp_path, first, sender("B", send("e", n="'x'")), taker("C", "e"))
    assert read.findings == [
        "1.ascxml:1:110: error: <param>: `n` of the event `e` is of type string here, and of type int16 at "
        "0.ascxml:1:169; a param has one type, whoever sends the event [event-param-types]"
    ]


def test_a_param_that_a_sender_leaves_out_is_warned_of(tmp_path: Path) -> None:
    read = Read(tmp_path, sender("A", send("e", ok="true", n="1")), sender("B", send("e", n="2")))
    assert read.findings == [
        "1.ascxml:1:93: warning: <send>: `ok` of plain_events/msg/E is never set; it is sent as zero or "
        "empty; set it with <param> [unset-output-field]"
    ]


def test_a_receiver_is_checked_against_what_the_senders_give(tmp_path: Path) -> None:
    hears = taker("B", "e", body='<log label="" expr="_event.data.m"/>')
    read = Read(tmp_path, sender("A", send("e", n="1")), hears)
    assert read.findings == [
        "1.ascxml:1:126: error: <log>: plain_events/msg/E has no field `m`; known: n [unknown-field]"
    ]


def test_a_type_that_is_not_known_is_reported_where_it_began(tmp_path: Path) -> None:
    relay = taker("B", "e", body=send("f", n="_event.data.n"))
    read = Read(tmp_path, sender("A", send("e", n="n"), data='<data id="n" expr="[]"/>'), relay)
    assert [item.partition(" [")[2] for item in read.findings] == ["untyped-event-param]"]
    assert read.findings[0].startswith("0.ascxml:1:")


def test_params_that_feed_each_other_end(tmp_path: Path) -> None:
    swap = send("e", a="[_event.data.a]", b="_event.data.c", c="_event.data.b")
    read = Read(tmp_path, taker("A", "e", body=swap), sender("B", send("e", b="1", c="'x'")))
    assert "untyped-event-param]" in {item.partition(" [")[2] for item in read.findings}
    swap = send("e", b="_event.data.c", c="_event.data.b")
    read = Read(tmp_path, taker("A", "e", body=swap), sender("B", send("e", b="1", c="0.5")))
    assert read.findings == []
    assert read.fields("E") == {"b": FLOAT64, "c": FLOAT64}


def test_types_of_events_of_like_names_are_told_apart(tmp_path: Path) -> None:
    read = Read(tmp_path, sender("A", send("a_b", x="1"), send("a.b", y="1"), send("2")))
    assert [kind.name for kind in read.system.library.defined()] == [
        "plain_events/msg/AB", "plain_events/msg/AB2", "plain_events/msg/Event2",
    ]  # fmt: skip


def test_names_that_a_message_cannot_have_are_refused(tmp_path: Path) -> None:
    assert Read(tmp_path, sender("A", send("e", **{"a.b": "1"}))).findings == [
        "0.ascxml:1:110: error: <param>: no field of a message can be called `a.b`; write letters, digits "
        "and underscores [bad-name]"
    ]
    assert Read(tmp_path, sender("A", send("a/b"))).findings == [
        "0.ascxml:1:93: error: <send>: an event of several machines cannot be called `a/b`; write `a_b` "
        "[bad-name]"
    ]


def test_what_ros_2_cannot_carry_is_a_warning_and_an_error_where_it_is_chosen(
    tmp_path: Path,
) -> None:
    model = sender("A", send("e-f", goalAt="1", rows="[[1]]"))
    portable = Read(tmp_path, model, naming=Naming(name_rules()))
    chosen = Read(tmp_path, model, naming=Naming(name_rules(), chosen=True))
    assert {item.partition(" [")[2] for item in portable.findings} == {"unportable-name]"}
    assert [item.partition("error: ")[2] for item in chosen.findings] == [
        "the ros2 transport does not take the topic `/plain_events/e-f`: it has `-`; a-z, A-Z, 0-9 and _ may "
        "be in it; write /plain_events/e_f [bad-name]",
        "<param>: the ros2 transport does not take the field `goalAt`: lower-case letters, digits and single "
        "underscores may be in it; write goalat [bad-name]",
        "<param>: the ros2 transport does not take the type `int64[][]`: it has no arrays of arrays; write "
        "an array of structures with one [bad-name]",
    ]


def test_an_event_is_not_called_as_a_structure_is_with_which_it_shares_a_package(
    tmp_path: Path,
) -> None:
    system = m2c.read_system(_declared(tmp_path, "Parcel", "number"))
    (kind,) = system.library.defined()
    assert (kind.name, [name for name, _ in kind.fields]) == ("plain_events/msg/Parcel2", ["it"])
    m2c.generate(system, tmp_path / "out")
    made = tmp_path / "out/plain_events/msg"
    assert made.joinpath("Parcel2.msg").read_text().splitlines()[1:] == ["Parcel it"]
    assert made.joinpath("Parcel.msg").read_text().splitlines()[1:] == ["int32 number"]


def test_structures_whose_names_ros_2_does_not_take_are_refused_where_it_is_chosen(
    tmp_path: Path,
) -> None:
    log = DiagnosticLog()
    system = load([_declared(tmp_path, "my_parcel", "theNumber")], log)
    assert system is not None
    check_system(system, log, Naming(name_rules(), chosen=True))
    assert [str(item).partition("error: ")[2] for item in log.diagnostics] == [
        "<param>: the ros2 transport does not take the structure `my_parcel`: it begins with a capital "
        "letter, and letters and digits may be in it; write MyParcel [bad-name]",
        "<param>: the ros2 transport does not take the field `theNumber`: lower-case letters, digits and "
        "single underscores may be in it; write thenumber [bad-name]",
    ]


def _declared(folder: Path, structure: str, member: str) -> Path:
    """A system file: the event `parcel` has a param of a declared structure."""
    (folder / "types.xml").write_text(
        f'<types><struct id="{structure}"><member id="{member}" type="int32"/></struct></types>'
    )
    data = f'<datamodel><data id="it" type="{structure}"/></datamodel>'
    for name, content in (
        ("A", f'{data}<state id="s"><onentry>{send("parcel", it="it")}</onentry></state>'),
        ("B", '<state id="s"><transition event="parcel"/></state>'),
    ):
        (folder / f"{name}.ascxml").write_text(machine(name, content))
    system = folder / "system.xml"
    system.write_text(
        '<roaml><node_models><input type="node-ascxml" src="A.ascxml"/>'
        '<input type="node-ascxml" src="B.ascxml"/></node_models>'
        '<data_declarations><input type="xml" src="types.xml"/></data_declarations></roaml>'
    )
    return system


def test_a_topic_that_a_model_declares_is_no_event_s(tmp_path: Path) -> None:
    declared = machine(
        "B",
        '<ros_topic_subscriber topic="/plain_events/e" type="std_msgs/Empty"/><state id="s">'
        '<ros_topic_callback name="/plain_events/e"/></state>',
    )
    read = Read(tmp_path, sender("A", send("e")), declared)
    assert "[duplicate-interface]" in read.findings[0]
    assert "is the topic of the plain event `e`" in read.findings[0]


def test_an_action_thread_sends_to_others_and_takes_only_its_own(tmp_path: Path) -> None:
    thread = (
        '<ros_action_server name="act" action_name="/act" type="tf2_msgs/LookupTransform"/>'
        '<state id="s"/><ros_action_thread name="act" n_threads="2" initial="t"><state id="t"><onentry>'
        f'{send("told")}{send("own")}</onentry><transition event="own"/>%s</state></ros_action_thread>'
    )
    log = DiagnosticLog()
    for number, text in enumerate((machine("A", thread % ""), taker("B", "told", "own"))):
        (tmp_path / f"{number}.ascxml").write_text(text)
    system = load([tmp_path], log)
    assert system is not None
    (made,) = system.nodes[0].threads
    assert sent(made.machine) == ["/plain_events/told"]
    assert queued(made.machine) == ["own"]
    assert [item.event for item in system.nodes[0].interfaces] == ["", "told"]
    assert taken(system.nodes[1]) == [("message", "/plain_events/told"), ("internal", "own")]
    (tmp_path / "0.ascxml").write_text(machine("A", thread % '<transition event="go"/>'))
    (tmp_path / "1.ascxml").write_text(sender("B", send("go")))
    load([tmp_path], log)
    assert [item.rule for item in log.diagnostics] == ["unsupported-event"]


def test_plain_scxml_keeps_the_events_that_it_names_after_channels(tmp_path: Path) -> None:
    body = f'<state id="s"><transition event="go">{send("X.Y.Return")}</transition></state>'
    (tmp_path / "p.scxml").write_text(machine("P", body, tag="scxml"))
    (tmp_path / "q.ascxml").write_text(sender("Q", send("go")))
    system = m2c.read_system(tmp_path)
    plain = system.node("P")
    assert plain is not None
    assert queued(plain) == ["X.Y.Return"]
    assert taken(plain) == [("message", "/plain_events/go")]


def test_a_model_in_a_node_s_place_is_linked_as_the_node_was(tmp_path: Path) -> None:
    read = Read(tmp_path, sender("A", send("e", n="1")), taker("B", "e", "new"))
    other = tmp_path / "other.ascxml"
    other.write_text(sender("Other", send("new", x="0.5"), send("e")))
    log = DiagnosticLog()
    made = read_with_reference(other, read.system, "A", log)
    assert made is not None
    nodes = (made, read.node("B"))
    again = linked(msgspec.structs.replace(read.system, nodes=nodes), log)
    assert log.diagnostics == []
    assert sent(again.nodes[0]) == ["/plain_events/new", "/plain_events/e"]
    assert taken(again.nodes[1]) == [
        ("message", "/plain_events/e"),
        ("message", "/plain_events/new"),
    ]
    assert read.fields("E") == {"n": INT64}
    assert linked(again, log) == again


def test_the_quality_of_an_event_s_topic_is_set_as_that_of_any(tmp_path: Path) -> None:
    (tmp_path / "a.ascxml").write_text(sender("A", send("e")))
    (tmp_path / "b.ascxml").write_text(taker("B", "e"))
    (tmp_path / "system.xml").write_text(
        '<roaml><node_models><input type="node-ascxml" src="a.ascxml"/>'
        '<input type="node-ascxml" src="b.ascxml"/></node_models>'
        '<qos><topic name="/plain_events/e" reliability="best_effort"/></qos></roaml>'
    )
    system = m2c.read_system(tmp_path / "system.xml")
    assert all(node.interfaces[0].best_effort for node in system.nodes)
    assert events_of(system.nodes[1])[0].kind is EventKind.MESSAGE
