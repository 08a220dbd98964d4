"""Whole systems with a drawn text in every slot, and their twins with harmless ones.

A *shape* says of which parts a system is made; its *slots* are the places for texts. The same shape
with other texts is the same system but for names: what is generated from both must differ in these
only. Files are written by an XML serializer, so that each text arrives in the model as it is.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Callable, Mapping
from functools import cache

import msgspec
from hypothesis import strategies as st
from lxml import etree

from tests.hostile.texts import ALIKE, hostile_texts, texts_for

NAMESPACE = "http://www.w3.org/2005/07/scxml"
HARMLESS = "zq"
"""What every harmless text has, and nothing that the generator writes."""


class Slot(msgspec.Struct, frozen=True):
    """A place for a text. Texts of one ``scope`` differ; ``kind``: see ``tests.hostile.texts``."""

    name: str
    kind: str
    scope: str


class Case(msgspec.Struct, frozen=True):
    """A system: the parts that it is made of, and the text in each slot that is not harmless."""

    shape: tuple[str, ...]
    texts: dict[str, str]

    def __repr__(self) -> str:
        return f"Case(shape={self.shape!r}, texts={self.texts!r})"

    def files(self) -> dict[str, bytes]:
        """Every file of the system, by its path; the first is the system file.

        Raises:
            ValueError: a text cannot be written in XML.
        """
        return _Writer(self.texts).system(self.shape)

    def twin(self) -> Case:
        """The same system with harmless texts only."""
        return Case(self.shape, {})

    def text(self, slot: str) -> str:
        """The text in ``slot``."""
        return self.texts.get(slot, harmless_texts(self.shape)[slot])


SHAPES: tuple[tuple[str, ...], ...] = (
    ("machine",),
    ("topics",),
    ("services",),
    ("action",),
    ("tree",),
    ("machine", "topics", "tree"),
    ("services", "action"),
)


@cache
def slots_of(shape: tuple[str, ...]) -> tuple[Slot, ...]:
    """The slots of a system of ``shape``."""
    writer = _Writer({})
    writer.system(shape)
    return tuple(writer.slots.values())


@cache
def harmless_texts(shape: tuple[str, ...]) -> dict[str, str]:
    """What stands in each slot of ``shape`` unless something else is drawn."""
    writer = _Writer({})
    writer.system(shape)
    return writer.written


@st.composite
def cases(draw: st.DrawFn) -> Case:
    """Systems of every shape: one hostile slot, many of them, or names of one scope that are alike.

    In one slot of a hundred stands a text that nobody made fit, so that the check has to refuse it.
    """
    shape = draw(st.sampled_from(SHAPES))
    slots = slots_of(shape)
    drawn = {1: _one, 2: _many, 3: _alike}[draw(st.sampled_from((1, 1, 1, 2, 2, 3)))](draw, slots)
    texts: dict[str, str] = {}
    taken: dict[str, list[str]] = {}
    for slot, text in drawn:
        used = taken.setdefault(slot.scope, [])
        if slot.scope and any(_clash(slot, text, other) for other in used):
            continue
        used.append(text)
        texts[slot.name] = text
    return Case(shape, texts)


_Drawn = list[tuple[Slot, str]]


def _one(draw: st.DrawFn, slots: tuple[Slot, ...]) -> _Drawn:
    slot = draw(st.sampled_from(slots))
    return [(slot, _text(draw, slot))]


def _many(draw: st.DrawFn, slots: tuple[Slot, ...]) -> _Drawn:
    chosen = draw(st.lists(st.sampled_from(slots), min_size=2, max_size=len(slots), unique=True))
    return [(slot, _text(draw, slot)) for slot in chosen]


def _text(draw: st.DrawFn, slot: Slot) -> str:
    unfit = draw(st.sampled_from(range(100))) == 99 and slot.kind != "literal"
    return draw(hostile_texts if unfit else texts_for(slot.kind))


def _alike(draw: st.DrawFn, slots: tuple[Slot, ...]) -> _Drawn:
    shared = [slot for slot in slots if slot.scope and slot.kind in ALIKE]
    scope = draw(st.sampled_from(shared)).scope
    chosen = [slot for slot in shared if slot.scope == scope]
    return [(slot, draw(st.sampled_from(ALIKE[slot.kind]))) for slot in chosen]


def _clash(slot: Slot, one: str, other: str) -> bool:
    """Whether one scope cannot have both: equal, or an event that is the other's family (SCXML 3.12.1)."""
    if slot.kind == "event":
        return f"{one}.".startswith(f"{other}.") or f"{other}.".startswith(f"{one}.")
    return one.strip() == other.strip()


class _Writer:
    """Writes the files of one system; each call of a slot's method is the one place of its text."""

    def __init__(self, texts: Mapping[str, str]) -> None:
        self._texts = texts
        self.slots: dict[str, Slot] = {}
        self.written: dict[str, str] = {}

    def _slot(self, name: str, kind: str, scope: str = "") -> str:
        if name not in self.slots:
            self.slots[name] = Slot(name, kind, scope)
            self.written[name] = self._texts.get(name, _harmless(kind, len(self.slots)))
        return self.written[name]

    # -- the system ----------------------------------------------------------------------------

    def system(self, shape: tuple[str, ...]) -> dict[str, bytes]:
        folder = self._slot("folder", "file")
        root = etree.Element("roaml")
        tree = etree.SubElement(root, "behavior_tree") if "tree" in shape else None
        nodes = etree.SubElement(root, "node_models")
        interfaces = ""
        if shape != ("machine",):
            interfaces = self._slot("interface folder", "file", "folders")
            _add(_add(root, "interfaces"), "input", type="ros-interfaces", src=f"./{interfaces}")
        files: dict[str, bytes] = {f"{folder}/system.xml": b""}
        machines: dict[str, etree._Element] = {}
        for part in shape:
            machines |= getattr(self, f"_{part}")()
        for name, machine in machines.items():
            file = self._slot(f"{name} file", "file", "files")
            files[f"{folder}/models/{file}.scxml"] = etree.tostring(machine, encoding="utf-8")
            is_plugin = name.startswith("plugin")
            kind = "bt-plugin-ascxml" if is_plugin else "node-ascxml"
            parent = tree if is_plugin else nodes
            etree.SubElement(parent, "input", type=kind, src=f"models/{file}.scxml")
        if tree is not None:
            file = self._slot("policy file", "file")
            etree.SubElement(tree, "input", type="bt.cpp-xml", src=f"./{file}.xml")
            files[f"{folder}/{file}.xml"] = etree.tostring(self._policy(), encoding="utf-8")
        for path, text in (self._definitions(shape) if interfaces else {}).items():
            files[f"{folder}/{interfaces}/{path}"] = text.encode("utf-8")
        files[f"{folder}/system.xml"] = etree.tostring(root, encoding="utf-8")
        return files

    def _root(self, node: str, initial: str) -> etree._Element:
        root = etree.Element("scxml", nsmap={None: NAMESPACE})
        root.set("name", self._slot(node, "name", "nodes"))
        root.set("initial", initial)
        root.append(etree.Comment(self._slot(f"{node} comment", "comment")))
        return root

    def _type(self, name: str) -> str:
        return f"{self._slot('package', 'package')}/{self._slot(name, 'type', 'types')}"

    def _field(self, of: str, name: str) -> str:
        return self._slot(f"{of} {name}", "field", f"{of} fields")

    # -- one machine with everything that needs no other ----------------------------------------

    def _machine(self) -> dict[str, etree._Element]:
        def state(number: int) -> str:
            return self._slot(f"state {number}", "name", "states")

        def event(number: int) -> str:
            return self._slot(f"event {number}", "event", "events")

        def variable(number: int) -> str:
            return self._slot(f"variable {number}", "variable", "variables")

        def literal(number: int) -> str:
            return quoted(self._slot(f"literal {number}", "literal"))

        def label(number: int) -> str:
            return self._slot(f"label {number}", "label")

        key, other_key = (
            self._slot("key 0", "literal", "keys"),
            self._slot("key 1", "literal", "keys"),
        )
        root = self._root("node", state(0))
        data = _add(root, "datamodel")
        _add(data, "data", id=variable(0), type="int32", expr="0")
        _add(data, "data", id=variable(1), type="string", expr=literal(0))
        made = f"{{{quoted(key)}: 1, {quoted(other_key)}: {literal(1)}}}"
        _add(data, "data", id=variable(2), expr=made)
        timer = self._slot("timer", "name", "timers")
        _add(root, "ros_time_rate", name=timer, rate_hz="50")
        publisher = self._slot("publisher", "name")
        topic = self._slot("topic", "channel", "channels")
        attributes = {"name": publisher, "topic": topic, "type": "std_msgs/String"}
        _add(root, "ros_topic_publisher", **attributes)
        first = _add(root, "state", id=state(0))
        entry = _add(first, "onentry")
        _add(entry, "log", label=label(0), expr=literal(2))
        _add(entry, "log", label=label(1))
        _add(entry, "assign", location=variable(0), expr=f"{variable(0)} + 1")
        _add(entry, "raise", event=event(0))
        identifier = self._slot("id 0", "name", "ids")
        parameter = self._slot("parameter", "label").strip()
        sent = _add(entry, "send", event=event(1), id=identifier, delay="120ms")
        _add(sent, "param", name=parameter or "zqp", expr=literal(3))
        unsent = self._slot("id 1", "name", "ids")
        _add(entry, "send", event=event(2), id=unsent, delay="500ms")
        _add(_add(first, "onexit"), "log", label=label(2), expr=variable(1))
        raised = _add(first, "transition", event=event(0), cond=f"{variable(1)} == {literal(0)}")
        _add(raised, "log", label=label(3), expr=f"_event.name + {literal(4)}")
        late = _add(first, "transition", event=event(1), target=state(1))
        _add(late, "cancel", sendid=unsent)
        _add(late, "log", label=label(4), expr=f"{variable(2)}[{quoted(other_key)}]")
        rung = _add(first, "ros_rate_callback", name=timer)
        published = _add(rung, "ros_topic_publish", name=publisher)
        _add(published, "field", name="data", expr=f"'ab' + {literal(5)}.length")
        _add(first, "transition", event=event(2), target=state(2))
        second = _add(root, "state", id=state(1))
        _add(second, "transition", after="300ms", target=state(0))
        _add(root, "final", id=state(2))
        return {"node": root}

    # -- a publisher and a subscriber ------------------------------------------------------------

    def _topics(self) -> dict[str, etree._Element]:
        message = self._type("message")
        topic = self._slot("message topic", "channel", "channels")
        number, text = self._field("message", "number"), self._field("message", "text")
        nested, inner = self._field("message", "nested"), self._field("part", "number")
        out = self._root("source", self._slot("source state", "name"))
        count = self._slot("source variable", "variable")
        _add(_add(out, "datamodel"), "data", id=count, type="int32", expr="0")
        timer = self._slot("source timer", "name")
        _add(out, "ros_time_rate", name=timer, rate_hz="10")
        _add(out, "ros_topic_publisher", name=topic, topic=topic, type=message)
        state = _add(out, "state", id=self.written["source state"])
        rung = _add(state, "ros_rate_callback", name=timer)
        _add(rung, "assign", location=count, expr=f"{count} + 1")
        publish = _add(rung, "ros_topic_publish", name=topic)
        _add(publish, "field", name=number, expr=count)
        _add(publish, "field", name=text, expr=quoted(self._slot("sent", "text")))
        _add(publish, "field", name=f"{nested}.{inner}", expr="2")
        into = self._root("sink", self._slot("sink state", "name"))
        data = _add(into, "datamodel")
        seen, kept = self._slot("seen", "variable", "sink"), self._slot("kept", "variable", "sink")
        _add(data, "data", id=seen, type="int32", expr="0")
        _add(data, "data", id=kept, type=message)
        subscriber = self._slot("subscriber", "name")
        _add(into, "ros_topic_subscriber", name=subscriber, topic=topic, type=message)
        state = _add(into, "state", id=self.written["sink state"])
        heard = _add(state, "ros_topic_callback", name=subscriber)
        _add(heard, "assign", location=seen, expr=f"_msg.{number} + _msg.{nested}.{inner}")
        _add(heard, "assign", location=f"{kept}.{number}", expr=seen)
        _add(heard, "log", label=self._slot("heard", "label"), expr=f"_msg.{text}")
        same = quoted(self.written["sent"])
        branch = _add(heard, "if", cond=f"_msg.{text} == {same} && {seen} > 0")
        _add(branch, "log", label=self._slot("same", "label"))
        _add(branch, "else")
        _add(branch, "log", label=self._slot("other", "label"), expr=f"{kept}.{text}")
        return {"source": out, "sink": into}

    # -- a server and a client --------------------------------------------------------------------

    def _services(self) -> dict[str, etree._Element]:
        service = self._type("service")
        channel = self._slot("service channel", "channel", "channels")
        asked, answered = self._field("request", "number"), self._field("response", "text")
        serving = self._root("server", self._slot("server state", "name"))
        name = self._slot("server name", "name")
        attributes = {"name": name, "service_name": channel, "type": service}
        _add(serving, "ros_service_server", **attributes)
        state = _add(serving, "state", id=self.written["server state"])
        taken = _add(state, "ros_service_handle_request", name=name)
        answer = _add(taken, "ros_service_send_response", name=name)
        text = quoted(self._slot("answer", "text"))
        _add(answer, "field", name=answered, expr=f"_req.{asked} > 1 ? {text} : 'few'")
        calling = self._root("client", self._slot("client state", "name"))
        data = _add(calling, "datamodel")
        got = self._slot("got", "variable")
        _add(data, "data", id=got, type="string", expr="''")
        timer = self._slot("client timer", "name")
        client = self._slot("client name", "name")
        _add(calling, "ros_time_rate", name=timer, rate_hz="8")
        attributes = {"name": client, "service_name": channel, "type": service}
        _add(calling, "ros_service_client", **attributes)
        state = _add(calling, "state", id=self.written["client state"])
        rung = _add(state, "ros_rate_callback", name=timer)
        request = _add(rung, "ros_service_send_request", name=client)
        _add(request, "field", name=asked, expr="2")
        response = _add(state, "ros_service_handle_response", name=client)
        _add(response, "assign", location=got, expr=f"_res.{answered}")
        _add(response, "log", label=self._slot("got label", "label"), expr=got)
        failed = _add(state, "ros_service_handle_error", name=client)
        _add(failed, "log", label=self._slot("failed label", "label"))
        return {"server": serving, "client": calling}

    # -- an action server with a thread, and its client --------------------------------------------

    def _action(self) -> dict[str, etree._Element]:
        action = self._type("action")
        channel = self._slot("action channel", "channel", "channels")
        goal, result = self._field("goal", "number"), self._field("result", "number")
        feedback = self._field("feedback", "text")
        serving = self._root("worker", self._slot("worker state", "name"))
        name = self._slot("worker name", "name")
        wanted = self._slot("wanted", "variable", "worker")
        identifier = self._slot("goal id", "variable", "worker")
        data = _add(serving, "datamodel")
        _add(data, "data", id=wanted, type="int32", expr="0")
        _add(data, "data", id=identifier, type="int64", expr="0")
        attributes = {"name": name, "action_name": channel, "type": action}
        _add(serving, "ros_action_server", **attributes)
        timer = self._slot("worker timer", "name")
        _add(serving, "ros_time_rate", name=timer, rate_hz="20")
        thread = _add(serving, "ros_action_thread", name=name, n_threads="1")
        thread.set("initial", self._slot("thread state 0", "name", "thread"))
        data = _add(thread, "datamodel")
        own = self._slot("thread variable", "variable")
        _add(data, "data", id=own, type="int64", expr="0")
        waiting = _add(thread, "state", id=self.written["thread state 0"])
        second = self._slot("thread state 1", "name", "thread")
        started = _add(waiting, "ros_action_handle_thread_start", name=name, target=second)
        _add(started, "assign", location=own, expr="_action.goal_id")
        working = _add(thread, "state", id=second)
        done = _add(working, "ros_rate_callback", name=timer, target=self.written["thread state 0"])
        told = _add(done, "ros_action_feedback", name=name, goal_id=own)
        _add(told, "field", name=feedback, expr=quoted(self._slot("progress", "text")))
        reached = _add(done, "ros_action_succeed", name=name, goal_id=own)
        _add(reached, "field", name=result, expr="3")
        _add(done, "ros_action_thread_free", name=name, goal_id=own)
        state = _add(serving, "state", id=self.written["worker state"])
        taken = _add(state, "ros_action_handle_goal", name=name)
        _add(taken, "assign", location=wanted, expr=f"_goal.{goal}")
        _add(taken, "assign", location=identifier, expr="_action.goal_id")
        _add(taken, "ros_action_accept_goal", name=name, goal_id=identifier)
        start = _add(taken, "ros_action_start_thread", name=name, goal_id=identifier, thread_id="0")
        _add(start, "field", name=goal, expr=wanted)
        _add(state, "ros_action_handle_thread_free", name=name)
        asking = self._root("boss", self._slot("boss state 0", "name", "boss"))
        client = self._slot("boss name", "name")
        attributes = {"name": client, "action_name": channel, "type": action}
        _add(asking, "ros_action_client", **attributes)
        first = _add(asking, "state", id=self.written["boss state 0"])
        second, third = (self._slot(f"boss state {i}", "name", "boss") for i in (1, 2))
        begin = _add(first, "transition", after="100ms", target=second)
        sent = _add(begin, "ros_action_send_goal", name=client)
        _add(sent, "field", name=goal, expr="1")
        state = _add(asking, "state", id=second)
        _add(state, "ros_action_handle_goal_response", name=client, accept=third, reject=self.written["boss state 0"])  # fmt: skip
        state = _add(asking, "state", id=third)
        heard = _add(state, "ros_action_handle_feedback", name=client)
        _add(
            heard, "log", label=self._slot("progress label", "label"), expr=f"_feedback.{feedback}"
        )
        over = _add(
            state,
            "ros_action_handle_success_result",
            name=client,
            target=self.written["boss state 0"],
        )
        shown = f"_wrapped_result.result.{result}"
        _add(over, "log", label=self._slot("result label", "label"), expr=shown)
        return {"worker": serving, "boss": asking}

    # -- a behaviour tree, a skill and two plugins --------------------------------------------------

    def _tree(self) -> dict[str, etree._Element]:
        package = self._slot("package", "package")
        skill = self._root("skill", self._slot("skill state", "name"))
        tick = self._slot("tick channel", "channel", "channels")
        halt = self._slot("halt channel", "channel", "channels")
        _add(skill, "ros_service_server", service_name=tick, type=f"{package}/TickAction")
        _add(skill, "ros_service_server", service_name=halt, type=f"{package}/HaltAction")
        state = _add(skill, "state", id=self.written["skill state"])
        taken = _add(state, "ros_service_handle_request", name=f"/{tick}")
        answer = _add(taken, "ros_service_send_response", name=f"/{tick}")
        _add(answer, "field", name="status", expr="0")
        taken = _add(state, "ros_service_handle_request", name=f"/{halt}")
        answer = _add(taken, "ros_service_send_response", name=f"/{halt}")
        _add(answer, "field", name="ok", expr="true")
        used = self._root("plugin", self._slot("plugin state", "name"))
        given = self._slot("port in", "port", "ports")
        set_to = self._slot("port out", "port", "ports")
        _add(used, "bt_declare_port_in", key=given, type="string")
        _add(used, "bt_declare_port_out", key=set_to, type="string")
        data = _add(used, "datamodel")
        held = self._slot("plugin variable", "variable")
        _add(data, "data", id=held, type="string", expr="''")
        state = _add(used, "state", id=self.written["plugin state"])
        ticked = _add(state, "bt_tick")
        assigned = _add(_add(ticked, "assign", location=held), "expr")
        _add(assigned, "bt_get_input", key=given)
        _add(ticked, "log", label=self._slot("plugin label", "label"), expr=held)
        joined = f"{held} + {quoted(self._slot('plugin text', 'text'))}"
        _add(ticked, "bt_set_output", key=set_to, expr=joined)
        _add(ticked, "bt_return_status", status="SUCCESS")
        unused = self._root("plugin unused", self._slot("unused state", "name"))
        port = self._slot("unused port", "name", "unused")
        lookup = self._slot("unused channel port", "name", "unused")
        _add(unused, "bt_declare_port_in", key=port, type="int32")
        _add(unused, "bt_declare_port_in", key=lookup, type="string")
        client = self._slot("unused client", "name")
        caller = _add(unused, "ros_service_client", name=client, type=f"{package}/TickAction")
        _add(_add(caller, "service_name"), "bt_get_input", key=lookup)
        data = _add(unused, "datamodel")
        looked_up = _add(data, "data", id=self._slot("unused variable", "variable"), type="int32")
        _add(_add(looked_up, "expr"), "bt_get_input", key=port)
        state = _add(unused, "state", id=self.written["unused state"])
        _add(_add(state, "bt_tick"), "ros_service_send_request", name=client)
        answered = _add(state, "ros_service_handle_response", name=client)
        _add(answered, "bt_return_status", status="SUCCESS")
        return {"skill": skill, "plugin": used, "plugin unused": unused}

    def _policy(self) -> etree._Element:
        root = etree.Element("root", BTCPP_format="4")
        root.append(etree.Comment(self._slot("policy comment", "comment")))
        main = self._slot("main tree", "name", "trees")
        below = self._slot("sub tree", "name", "trees")
        root.set("main_tree_to_execute", main)
        sequence = _add(_add(root, "BehaviorTree", ID=main), "Sequence")
        sequence.set("name", self._slot("sequence", "name"))
        leaf = self._slot("leaf", "name", "leaves")
        _add(sequence, "Action", ID="Skill", name=leaf, service_name=self.written["tick channel"])
        _add(sequence, "SubTree", ID=below)
        placed = _add(_add(root, "BehaviorTree", ID=below), "Action", ID=self.written["plugin"])
        placed.set("name", self._slot("plugin leaf", "name", "leaves"))
        placed.set(self.written["port in"], self._slot("port value", "label").strip() or "zqv")
        placed.set(self.written["port out"], "{zq_entry}")
        return root

    # -- interface definitions -----------------------------------------------------------------------

    def _definitions(self, shape: tuple[str, ...]) -> dict[str, str]:
        package = self._slot("package", "package")
        files = {}
        if "topics" in shape:
            part = self._slot("part", "type", "types")
            default, fixed = self._slot("default", "text"), self._slot("constant text", "text")
            files[f"msg/{part}.msg"] = f"int32 {self._field('part', 'number')}\n"
            files[f"msg/{self.written['message']}.msg"] = (
                f"# {' '.join(self._slot('definition comment', 'comment').splitlines())}\n"
                f"int32 {self._slot('constant 0', 'constant', 'constants')}=3\n"
                f"string {self._slot('constant 1', 'constant', 'constants')}={defined(fixed)}\n"
                f"int32 {self.written['message number']}\n"
                f"string {self.written['message text']} {defined(default)}\n"
                f"{part} {self.written['message nested']}\n"
            )
        if "services" in shape:
            files[f"srv/{self.written['service']}.srv"] = (
                f"int32 {self.written['request number']}\n---\nstring {self.written['response text']}\n"
            )
        if "action" in shape:
            files[f"action/{self.written['action']}.action"] = (
                f"int32 {self.written['goal number']}\n---\nint32 {self.written['result number']}\n---\n"
                f"string {self.written['feedback text']}\n"
            )
        if "tree" in shape:
            files["srv/TickAction.srv"] = "---\nint8 status\n"
            files["srv/HaltAction.srv"] = "---\nbool ok\n"
        return {f"{package}/{path}": text for path, text in files.items()}


def _add(parent: etree._Element, tag: str, **attributes: str) -> etree._Element:
    return etree.SubElement(parent, tag, attributes)


_HARMLESS: dict[str, Callable[[int], str]] = {
    "type": lambda number: f"Zq{number}",
    "constant": lambda number: f"ZQ{number}",
}


def _harmless(kind: str, number: int) -> str:
    return _HARMLESS.get(kind, lambda at: f"{HARMLESS}{at}")(number)


def quoted(text: str) -> str:
    r"""``text`` as a string literal of ECMAScript; what XML or a line cannot carry as ``\u….``."""
    return "'" + "".join(_escaped(letter) for letter in text) + "'"


def _escaped(letter: str) -> str:
    if letter in "'\\":
        return f"\\{letter}"
    if unicodedata.category(letter) in ("Cc", "Cs", "Zl", "Zp", "Cn"):
        units = letter.encode("utf-16-be", "surrogatepass")
        return "".join(f"\\u{units[i : i + 2].hex()}" for i in range(0, len(units), 2))
    return letter


def defined(text: str) -> str:
    """``text`` as a string of an interface definition (a literal of Python, on one line)."""
    written = "".join(
        f"\\{letter}"
        if letter in "\"'\\"
        else letter
        if letter.isprintable()
        else f"\\U{ord(letter):08x}"
        for letter in text
    )
    return f'"{written}"'
