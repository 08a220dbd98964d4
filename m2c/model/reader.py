"""Reading HL-SCXML, ASCXML and plain SCXML into a :class:`Machine`.

Structure is checked here (tags, attributes, targets, interfaces that exist); types of expressions
are checked by :mod:`m2c.check`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import msgspec

from m2c.model.binding import bind_plain_events
from m2c.model.content import ContentReader
from m2c.model.datatypes import ANY, NULL, NUMBER, Array, DataType, Primitive, Structure, is_number
from m2c.model.diagnostics import DiagnosticLog, Position
from m2c.model.durations import parse_duration
from m2c.model.expressions import ArrayLiteral, Expression, Literal, ObjectLiteral, PortInput
from m2c.model.interfaces import InterfaceLibrary, canonical
from m2c.model.machine import (
    ActionThread,
    Data,
    Event,
    EventKind,
    Interface,
    InterfaceKind,
    Machine,
    Port,
    Spelling,
    State,
    Target,
    Transition,
)
from m2c.model.structure import check_element, require
from m2c.model.types import parse_type
from m2c.model.typing import Scope, nearest, type_of
from m2c.model.vocabulary import DECLARATIONS, HANDLERS, ROOT_CHILDREN, STATE_CHILDREN, UNSUPPORTED
from m2c.model.xml import Element, read_xml

_LEGACY_EVENTS = {
    "bt_tick": EventKind.BT_TICK,
    "bt_halt": EventKind.BT_HALT,
}
"""How early HL-SCXML plugins spell the tree's events in a plain ``<transition>``."""


def read_machine(
    path: Path,
    log: DiagnosticLog,
    library: InterfaceLibrary | None = None,
    *,
    reference: Machine | None = None,
    channels: Mapping[str, str] | None = None,
) -> Machine | None:
    """Read the state machine in ``path``.

    Args:
        path: a ``.scxml`` or ``.ascxml`` file.
        log: where every fault and warning goes.
        library: the interface types; only the ones of the standard if None.
        reference: plain SCXML only: the machine whose declared interfaces its events mean.
        channels: plain SCXML only: types of channels that other machines of the system declare.

    Returns:
        The machine, or None if an error was reported.
    """
    errors_before = len(log.diagnostics)
    root = read_xml(path, log)
    if root is None:
        return None
    machine = machine_of(root, log, library or InterfaceLibrary(), reference, channels or {})
    new = log.diagnostics[errors_before:]
    return None if any(found.severity == "error" for found in new) else machine


def machine_of(
    root: Element,
    log: DiagnosticLog,
    library: InterfaceLibrary,
    reference: Machine | None = None,
    channels: Mapping[str, str] | None = None,
) -> Machine | None:
    """The machine that the element ``root`` describes; see :func:`read_machine`."""
    if root.tag not in ("scxml", "ascxml"):
        log.error(
            "unknown-tag",
            root.position,
            root.tag,
            "not a state machine",
            "the root of a model is <scxml> or <ascxml>",
        )
        return None
    machine = MachineReader(root, log, library).read()
    if machine is None or machine.spelling is not Spelling.SCXML:
        return machine
    return bind_plain_events(machine, library, reference, channels or {}, log)


class MachineReader:
    """Reads one machine element (the root, or an action thread inside it)."""

    def __init__(
        self,
        root: Element,
        log: DiagnosticLog,
        library: InterfaceLibrary,
        outer: tuple[Interface, ...] = (),
    ) -> None:
        self._root = root
        self._log = log
        self._library = library
        self._outer = outer
        self._interfaces: list[Interface] = list(outer)
        self._ports: list[Port] = []

    def read(self) -> Machine | None:
        """The machine; None if it has no usable state."""
        root = self._root
        if root.tag != "ros_action_thread":
            check_element(root, self._log, as_tag="scxml")
            require(root, "name", self._log)
        for child in root.children:
            self._check_child(child)
        for child in root.children:
            self._declare(child)
        content = ContentReader(self._log, tuple(self._interfaces))
        data = tuple(self._read_data(content))
        elements = list(root.all("state", "final"))
        names = [element.get("id") for element in elements]
        if not elements:
            self._log.error("no-states", root.position, root.tag, "the machine has no <state>")
            return None
        states = tuple(self._read_state(element, names, content) for element in elements)
        for index, name in enumerate(names):
            if name and name in names[:index]:
                self._log.error(
                    "duplicate-state",
                    elements[index].position,
                    elements[index].tag,
                    f"a second state is called `{name}`",
                    "state ids are unique in a machine",
                )
        initial = root.get("initial") or names[0]
        if initial not in names:
            self._log.error(
                "unknown-target",
                root.at("initial"),
                root.tag,
                f"the initial state `{initial}` does not exist",
                nearest(initial, names),
            )
        return Machine(
            name=root.get("name"),
            spelling=_spelling(root),
            position=root.position,
            initial=initial,
            states=states,
            data=data,
            interfaces=tuple(self._interfaces),
            ports=tuple(self._ports),
            threads=tuple(self._read_threads()),
        )

    def _check_child(self, child: Element) -> None:
        if child.tag in ROOT_CHILDREN:
            check_element(child, self._log)
        elif child.tag in UNSUPPORTED:
            self._log.error(
                "unsupported-element",
                child.position,
                child.tag,
                "not supported",
                UNSUPPORTED[child.tag],
            )
        else:
            hint = nearest(child.tag, ROOT_CHILDREN)
            where = f"not an element of <{self._root.tag}>"
            self._log.error("unknown-tag", child.position, child.tag, where, hint)

    # -- declarations -------------------------------------------------------------------------

    def _declare(self, element: Element) -> None:
        if element.tag in DECLARATIONS:
            self._declare_channel(element)
        elif element.tag == "ros_time_rate":
            name = require(element, "name", self._log)
            rate = _number(element.get("rate_hz"))
            if rate is None or rate <= 0:
                self._log.error(
                    "bad-rate",
                    element.at("rate_hz"),
                    element.tag,
                    f"`{element.get('rate_hz')}` is not a rate",
                    "rate_hz is a number of callbacks a second, greater than 0",
                )
                rate = 1.0
            self._add(
                Interface(
                    kind=InterfaceKind.TIMER,
                    name=name,
                    position=element.position,
                    channel=name,
                    rate_hz=rate,
                )
            )
        elif element.tag in ("bt_declare_port_in", "bt_declare_port_out"):
            key = require(element, "key", self._log)
            kind = parse_type(element, self._library, self._log)
            output = element.tag.endswith("out")
            self._ports.append(Port(key, kind or ANY, output, element.position))

    def _declare_channel(self, element: Element) -> None:
        kind, attribute, folder = DECLARATIONS[element.tag]
        short = attribute.removesuffix("_name")
        channel = element.get(attribute) or element.get(short)
        port = ""
        child = element.first(attribute) or element.first(short)
        if child is not None:
            lookup = child.first("bt_get_input")
            port = require(lookup, "key", self._log) if lookup is not None else ""
            channel = channel or child.text.strip()
        type_child = element.first("type")
        written = element.get("type") or (type_child.text.strip() if type_child is not None else "")
        if not written:
            require(element, "type", self._log)
        if not channel and not port:
            hint = f'write {attribute}="/…"'
            what = f"the attribute `{attribute}` is missing"
            self._log.error("missing-attribute", element.position, element.tag, what, hint)
        if channel and not channel.startswith("/"):
            channel = f"/{channel}"
        self._add(
            Interface(
                kind=kind,
                name=element.get("name") or channel or port,
                position=element.position,
                channel=channel or None,
                type_name=canonical(written, folder) if written else "",
                port=port or None,
            )
        )

    def _add(self, interface: Interface) -> None:
        for known in self._interfaces:
            if known.kind is interface.kind and known.name == interface.name:
                self._log.error(
                    "duplicate-interface",
                    interface.position,
                    "",
                    f"a second {interface.kind} is called `{interface.name}`",
                    f"the first is at {known.position}",
                )
        self._interfaces.append(interface)

    # -- data ---------------------------------------------------------------------------------

    def _read_data(self, content: ContentReader) -> list[Data]:
        found: list[Data] = []
        for model in self._root.all("datamodel"):
            for element in model.children:
                if not check_element(element, self._log, inside=("data",), parent="datamodel"):
                    continue
                data = self._read_item(element, content)
                if any(known.name == data.name for known in found):
                    self._log.error(
                        "duplicate-data",
                        element.position,
                        "data",
                        f"`{data.name}` is declared twice",
                        "ids are unique in a datamodel",
                    )
                found.append(data)
        return found

    def _read_item(self, element: Element, content: ContentReader) -> Data:
        name = require(element, "id", self._log)
        declared = parse_type(element, self._library, self._log) if element.get("type") else None
        value = content.expression_of(element, "expr", optional=True)
        if value is None:
            value = _zero(declared, element.position)
        kind = declared
        if kind is None:
            kind = type_of(value, Scope({}))
            if is_number(kind):
                kind = NUMBER
            elif kind == NULL or isinstance(kind, Array) or isinstance(value, PortInput):
                kind = ANY
        return Data(name, kind, value, element.position, declared is not None)

    # -- states -------------------------------------------------------------------------------

    def _read_state(self, element: Element, names: list[str], content: ContentReader) -> State:
        name = require(element, "id", self._log)
        entry: list[Element] = []
        leaving: list[Element] = []
        transitions: list[Transition] = []
        for child in element.children:
            if child.tag in ("state", "final", "parallel", "history", "initial"):
                self._log.error(
                    "unsupported-element",
                    child.position,
                    child.tag,
                    f"a state inside state `{name}`: compound states are not part of the language",
                    "make it a state of the machine",
                )
            elif child.tag in UNSUPPORTED:
                hint = UNSUPPORTED[child.tag]
                self._log.error(
                    "unsupported-element", child.position, child.tag, "not supported", hint
                )
            elif not check_element(child, self._log, inside=STATE_CHILDREN, parent="state"):
                continue
            elif child.tag == "onentry":
                entry += child.children
            elif child.tag == "onexit":
                leaving += child.children
            else:
                index = len(transitions)
                transitions += self._read_transitions(child, name, index, names, content)
        if element.get("initial"):
            self._log.error(
                "unsupported-element",
                element.at("initial"),
                element.tag,
                f"state `{name}` has an initial state: compound states are not part of the language",
                "remove the attribute",
            )
        return State(
            name=name,
            position=element.position,
            on_entry=content.block(entry),
            on_exit=content.block(leaving),
            transitions=tuple(transitions),
            final=element.tag == "final",
        )

    def _read_transitions(
        self, element: Element, state: str, index: int, names: list[str], content: ContentReader
    ) -> list[Transition]:
        tag = element.tag
        if tag == "ros_action_handle_goal_response":
            return self._goal_response(element, names, content)
        cond = content.expression_of(element, "cond", optional=True)
        targets = self._targets(element, names, content)
        body = content.block([child for child in element.children if child.tag != "target"])
        events: list[Event | None]
        after = None
        if tag in HANDLERS:
            events = [content.handler_event(element)]
        elif element.get("after"):
            after = parse_duration(element.get("after"))
            if after is None:
                self._log.error(
                    "bad-duration",
                    element.at("after"),
                    tag,
                    f"`{element.get('after')}` is not a time",
                    "write it like 5s or 200ms",
                )
            if element.get("event"):
                what = "`after` and `event` exclude each other"
                self._log.error("unknown-attribute", element.at("event"), tag, what)
            events = [Event(EventKind.AFTER, f"{state}#{index}")]
        else:
            written = element.get("event").split()
            events = [
                Event(
                    _LEGACY_EVENTS.get(event, EventKind.INTERNAL),
                    "" if event in _LEGACY_EVENTS else event,
                )
                for event in written
            ] or [None]
        return [
            Transition(
                event=event,
                position=element.position,
                cond=cond,
                targets=targets,
                body=body,
                after_s=after,
                element=tag,
            )
            for event in events
        ]

    def _goal_response(
        self, element: Element, names: list[str], content: ContentReader
    ) -> list[Transition]:
        interface = content.interface_of(element, InterfaceKind.ACTION_CLIENT)
        found = []
        for attribute, kind in (
            ("accept", EventKind.GOAL_ACCEPTED),
            ("reject", EventKind.GOAL_REJECTED),
        ):
            target = require(element, attribute, self._log)
            self._check_target(target, element, attribute, names)
            found.append(
                Transition(
                    event=Event(kind, interface),
                    position=element.position,
                    targets=(Target(target),),
                    body=content.block(element.children),
                    element=element.tag,
                )
            )
        return found

    def _targets(
        self, element: Element, names: list[str], content: ContentReader
    ) -> tuple[Target, ...]:
        written = element.get("target")
        children = list(element.all("target"))
        if written and children:
            what = "a `target` attribute and <target> elements exclude each other"
            self._log.error("unknown-attribute", element.at("target"), element.tag, what)
        if written:
            self._check_target(written, element, "target", names)
            return (Target(written),)
        targets = []
        left = 1.0
        for child in children:
            check_element(child, self._log)
            name = require(child, "id", self._log)
            self._check_target(name, child, "id", names)
            probability = _number(child.get("prob")) if child.get("prob") else None
            if child.get("prob") and (probability is None or not 0 <= probability <= 1):
                self._log.error(
                    "bad-probability",
                    child.at("prob"),
                    "target",
                    f"`{child.get('prob')}` is not a probability",
                    "a number from 0 to 1",
                )
                probability = 0.0
            if probability is None:
                probability = max(left, 0.0)
            left -= probability
            targets.append(Target(name, probability, content.block(child.children)))
        if len(targets) == 1:
            return (Target(targets[0].state, None, targets[0].body),)
        if children and abs(left) > 1e-9:
            self._log.error(
                "bad-probability",
                element.position,
                element.tag,
                f"the probabilities add up to {1 - left:g}",
                "they add up to 1",
            )
        return tuple(targets)

    def _check_target(
        self, target: str, element: Element, attribute: str, names: list[str]
    ) -> None:
        if target and target not in names:
            self._log.error(
                "unknown-target",
                element.at(attribute),
                element.tag,
                f"the target state `{target}` does not exist",
                nearest(target, names),
            )

    # -- action threads -----------------------------------------------------------------------

    def _read_threads(self) -> list[ActionThread]:
        threads = []
        for element in self._root.all("ros_action_thread"):
            content = ContentReader(self._log, tuple(self._interfaces))
            interface = content.interface_of(element, InterfaceKind.ACTION_SERVER)
            count = _number(element.get("n_threads") or "1")
            if count is None or count < 1 or not float(count).is_integer():
                self._log.error(
                    "bad-number",
                    element.at("n_threads"),
                    element.tag,
                    f"`{element.get('n_threads')}` is not a number of threads",
                    "a whole number from 1",
                )
                count = 1
            reader = MachineReader(element, self._log, self._library, tuple(self._interfaces))
            machine = reader.read()
            if machine is not None:
                name = f"{self._root.get('name')}Thread"
                named = msgspec.structs.replace(machine, name=name)
                threads.append(ActionThread(interface, int(count), named, element.position))
        return threads


def _spelling(root: Element) -> Spelling:
    if root.tag == "ascxml":
        return Spelling.ASCXML
    stack = [root]
    while stack:
        element = stack.pop()
        if element.tag.startswith(("ros_", "bt_")):
            return Spelling.HL_SCXML
        if element.tag == "transition" and element.get("event") in _LEGACY_EVENTS:
            return Spelling.HL_SCXML
        stack += element.children
    return Spelling.SCXML


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _zero(kind: DataType | None, position: Position) -> Expression:
    match kind:
        case Primitive("bool"):
            return Literal(value=False, position=position)
        case Primitive("string"):
            return Literal(value="", position=position)
        case Primitive(name) if name.startswith("float"):
            return Literal(value=0.0, position=position)
        case Primitive(name) if name != "any":
            return Literal(value=0, position=position)
        case Array():
            return ArrayLiteral(position=position)
        case Structure():
            return ObjectLiteral(position=position)
        case _:
            return Literal(value=None, position=position)
