"""A model in one dialect: today's names, and ``ros_*`` tags for the events of plain SCXML."""

from __future__ import annotations

import re
from collections.abc import Mapping
from copy import deepcopy
from itertools import groupby

from lxml import etree

from m2c.convert.expressions import DATA_NAMES, respelled
from m2c.convert.trees import document, drop_prefixes, elements, replace_tag, with_root
from m2c.diagnostics import DiagnosticLog, Position
from m2c.model.binding import meaning_of
from m2c.model.content import LEGACY_SENDS
from m2c.model.machine import Dialect, EventKind, Interface, InterfaceKind, Machine, OutputKind
from m2c.model.states import LEGACY_EVENTS
from m2c.model.vocabulary import DECLARATIONS, HANDLERS, OUTPUTS
from m2c.model.xml import SCXML_NAMESPACE

ROOTS = {Dialect.ASCXML: "ascxml", Dialect.HL_SCXML: "scxml"}
"""The root of a model in each dialect that can be written."""
_HANDLER_TAGS = {handler.event: tag for tag, handler in HANDLERS.items()}
_OUTPUT_TAGS = {output.kind: tag for tag, output in OUTPUTS.items()}
_DECLARATION_TAGS = {kind: (tag, channel) for tag, (kind, channel, _) in DECLARATIONS.items()}
_LENGTH = re.compile(r"\[(\d+)\]")
_EXPRESSIONS = ("cond", "expr", "location", "delayexpr", "goal_id", "thread_id", "array")
"""Attributes that are expressions."""
_WITH_TEXT = ("data", "assign", "log", "param", "field", "bt_set_output", "expr")
"""Elements whose text may be an expression."""


def converted_model(
    tree: etree._Element,
    places: Mapping[etree._Element, Position],
    machine: Machine,
    dialect: Dialect,
    log: DiagnosticLog,
) -> str:
    """The model ``tree`` as a text in ``dialect``.

    Args:
        tree: of its file, with comments; it is changed.
        places: of its elements, for messages.
        machine: what was read from it.
        dialect: ASCXML or HL-SCXML.
        log: where ``unfaithful-conversion`` goes: what no element of the dialect says.
    """
    drop_prefixes(tree)
    model = _Model(machine, places, log)
    for node in list(elements(tree)):
        if node.tag in DECLARATIONS:
            _rename_channel(node)
        elif node.tag == "send":
            model.send(node)
        elif node.tag == "data" and (machine.dialect, dialect) == (
            Dialect.ASCXML,
            Dialect.HL_SCXML,
        ):
            _bound_arrays(node)
    for node in list(elements(tree)):
        if node.tag == "transition":
            model.transition(node)
    _respell(tree, "")
    model.declare(tree)
    return document(tree, with_root(tree, ROOTS[dialect], SCXML_NAMESPACE))


class _Model:
    def __init__(
        self, machine: Machine, places: Mapping[etree._Element, Position], log: DiagnosticLog
    ) -> None:
        self._machine = machine
        self._places = places
        self._log = log
        self._used: set[tuple[InterfaceKind, str]] = set()

    def declare(self, tree: etree._Element) -> None:
        """Name the machine, and declare the interfaces that its events have meant."""
        if self._machine.dialect is Dialect.SCXML or not tree.get("name", "").strip():
            tree.set("name", self._machine.name)
        first = next((index for index, node in enumerate(tree) if isinstance(node.tag, str)), 0)
        used = [item for item in self._machine.interfaces if (item.kind, item.name) in self._used]
        for offset, interface in enumerate(used):
            made = _declaration(interface)
            made.tail = tree.text
            tree.insert(first + offset, made)

    def transition(self, node: etree._Element) -> None:
        """Make handlers of the events that have a tag of their own."""
        events = [(*self._handler(event), event) for event in node.get("event", "").split()]
        if all(tag == "transition" for tag, _, _ in events):
            return
        made = []
        for (tag, name), group in groupby(events, key=lambda item: item[:2]):
            written = [event for _, _, event in group]
            attributes = {key: value for key, value in _attributes(node) if key != "event"}
            if tag == "transition":
                names = [{"event": " ".join(written)}]
            else:
                if not _is_compound(node.getparent()):
                    attributes.pop("type", None)  # it makes no difference
                names = [{"name": name} if name else {} for _ in written]
            for named in names:
                handler = deepcopy(node)
                replace_tag(handler, tag, {**named, **attributes})
                made.append(handler)
        above = node.getparent()
        assert above is not None  # the root is a machine
        index = above.index(node)
        above[index : index + 1] = made

    def _handler(self, event: str) -> tuple[str, str]:
        """The tag that handles ``event``, and the interface it names."""
        if event in LEGACY_EVENTS:
            return event, ""
        found = self._meaning(event)
        if found is None or not isinstance(found[1], EventKind):
            return "transition", ""
        return _HANDLER_TAGS[found[1]], self._use(found[0])

    def send(self, node: etree._Element) -> None:
        """Make an output of an event that goes to another node, or to the tree."""
        event = node.get("event", "").strip()
        if event in LEGACY_SENDS:
            for child in list(node.iterchildren(etree.Element)):
                node.remove(child)
            kind, status = LEGACY_SENDS[event]
            replace_tag(node, _OUTPUT_TAGS[kind], {"status": status} if status else {})
            return
        found = self._meaning(event)
        if found is None or not isinstance(found[1], OutputKind):
            return
        if node.get("target", "").strip():
            return
        if node.get("delay", "").strip() or "delayexpr" in node.attrib:
            what = f"`{event}` goes to another node, and no element sends that after a delay"
            hint = "send an event to the machine itself after the delay, and this one when it comes"
            self._log.error("unfaithful-conversion", self._places[node], "send", what, hint)
        for child in node.iterchildren(etree.Element):
            value = child.get("location", "").strip() or child.get("expr")
            given = {} if value is None else {"expr": value}
            replace_tag(child, "field", {"name": child.get("name", ""), **given})
        for name in node.get("namelist", "").split():
            etree.SubElement(node, "field", {"name": name, "expr": name})
        replace_tag(node, _OUTPUT_TAGS[found[1]], {"name": self._use(found[0])})

    def _meaning(self, event: str) -> tuple[Interface, EventKind | OutputKind] | None:
        """The interface that ``event`` of a plain machine means, and what goes over it."""
        found = meaning_of(event, self._machine.name)
        if self._machine.dialect is not Dialect.SCXML or found is None:
            return None
        kind, channel, direction = found
        interface = self._machine.interface(channel, kind)
        return None if interface is None else (interface, direction)

    def _use(self, interface: Interface) -> str:
        self._used.add((interface.kind, interface.name))
        return interface.name


def _is_compound(state: etree._Element | None) -> bool:
    return state is not None and any(child.tag in ("state", "final") for child in state)


def _bound_arrays(node: etree._Element) -> None:
    """``T[5]`` of ASCXML, an array of up to 5, as HL-SCXML says it."""
    if "type" in node.attrib:
        node.set("type", _LENGTH.sub(r"[<=\1]", node.get("type", "")))


def _declaration(interface: Interface) -> etree._Element:
    tag, channel = _DECLARATION_TAGS[interface.kind]
    package, _, name = interface.type_name.split("/")
    return etree.Element(tag, {channel: interface.channel or "", "type": f"{package}/{name}"})


def _rename_channel(node: etree._Element) -> None:
    """``service="…"`` as ``service_name="…"``."""
    _, long, _ = DECLARATIONS[str(node.tag)]
    short = long.removesuffix("_name")
    if short == long:
        return
    attributes = dict(_attributes(node))
    written = attributes.get(short, "")
    if written and not attributes.get(long, "").strip():
        attributes[long] = written
    attributes.pop(short, None)
    replace_tag(node, str(node.tag), attributes)
    for child in list(node.iterchildren(short)):
        child.tag = long


def _respell(node: etree._Element, data_name: str) -> None:
    """Write the expressions in ``node`` as today; event data are called ``data_name`` there."""
    if node.tag in HANDLERS:
        data_name = DATA_NAMES.get(HANDLERS[str(node.tag)].event, "")
    for name in _EXPRESSIONS:
        if name in node.attrib:
            node.set(name, respelled(node.get(name, ""), data_name))
    if node.tag in _WITH_TEXT and len(node) == 0 and node.text and "expr" not in node.attrib:
        node.text = respelled(node.text, data_name)
    for child in node.iterchildren(etree.Element):
        _respell(child, data_name)


def _attributes(node: etree._Element) -> list[tuple[str, str]]:
    return [(str(name), str(value)) for name, value in node.attrib.items()]
