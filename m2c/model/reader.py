"""Reading HL-SCXML, ASCXML and plain SCXML into a :class:`Machine`.

Structure is checked here (tags, attributes, targets, interfaces that exist); types of expressions
are checked by :mod:`m2c.check`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import msgspec

from m2c.diagnostics import DiagnosticLog, shortened
from m2c.language.datatypes import STRING
from m2c.language.expressions import Literal
from m2c.model.binding import bind_plain_events
from m2c.model.content import ContentReader
from m2c.model.declarations import DeclarationReader, loop_variables
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import (
    ActionThread,
    Data,
    Dialect,
    Interface,
    InterfaceKind,
    Machine,
)
from m2c.model.nesting import MAX_TRANSITIONS, TooLargeError, asked_states, lowered
from m2c.model.states import LEGACY_EVENTS, StateReader
from m2c.model.structure import check_element, number
from m2c.model.vocabulary import MISPLACED, ROOT_CHILDREN, UNSUPPORTED
from m2c.model.walk import with_machine_name
from m2c.model.xml import Element, read_xml
from m2c.suggestions import nearest

MODEL_ROOTS = ("scxml", "ascxml")
DATA_MODELS = ("", "ecmascript", "null")
"""What ``datamodel`` may say; a machine of the data model ``null`` has no data (W3C SCXML B.1)."""
_MAX_SHOWN = 80
"""Characters of a name that an error repeats."""


def read_machine(
    path: Path,
    log: DiagnosticLog,
    library: InterfaceLibrary | None = None,
) -> Machine | None:
    """Read the state machine in ``path``.

    Args:
        path: a ``.scxml`` or ``.ascxml`` file.
        log: where every fault and warning goes.
        library: the interface types; only the ones of the standard if None.

    Returns:
        The machine, or None if an error was reported.
    """
    errors_before = len(log.diagnostics)
    root = read_xml(path, log)
    if root is None:
        return None
    machine = machine_of(root, log, library or InterfaceLibrary())
    new = log.diagnostics[errors_before:]
    return None if any(found.severity == "error" for found in new) else machine


def machine_of(
    root: Element,
    log: DiagnosticLog,
    library: InterfaceLibrary,
    reference: Machine | None = None,
    channels: Mapping[str, str] | None = None,
) -> Machine | None:
    """The machine that the element ``root`` describes; see :func:`read_machine`.

    Of plain SCXML, ``reference`` is the machine whose declared interfaces its events mean, and ``channels``
    are the types of channels that other machines of the system declare.
    """
    if root.tag not in MODEL_ROOTS:
        log.error(
            "unknown-tag",
            root.position,
            root.tag,
            "not a state machine",
            "the root of a model is <scxml> or <ascxml>",
        )
        return None
    written = root.get("datamodel")
    if written.lower() not in DATA_MODELS:  # its expressions would be faults, one by one
        what = f"the data model `{shortened(written, _MAX_SHOWN)}` is not part of the language"
        hint = 'write expressions in ECMAScript, and datamodel="ecmascript"'
        log.error("unsupported-element", root.at("datamodel"), root.tag, what, hint)
        return None
    machine = MachineReader(root, log, library).read()
    if machine is None:
        return None
    machine = with_machine_name(machine)
    if machine.dialect is not Dialect.SCXML:
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
        is_ascxml: bool = False,
    ) -> None:
        self._root = root
        self._is_ascxml = is_ascxml or root.tag == "ascxml"
        self._log = log
        self._library = library
        self._declarations = DeclarationReader(log, library, outer, self._is_ascxml)

    def read(self) -> Machine | None:
        """The machine; None if it has no usable state."""
        root, before = self._root, len(self._log.diagnostics)
        if root.tag != "ros_action_thread":
            check_element(root, self._log, as_tag="scxml")
        for child in root.children:
            self._check_child(child)
        for child in root.children:
            self._declarations.declare(child)
        content = ContentReader(self._log, tuple(self._declarations.interfaces))
        data = tuple(self._declarations.data(root, content))
        if not any(root.all("state", "final")):
            if not any(root.all("parallel")):
                what = "the machine has no <state>"
                self._log.error("no-states", root.position, root.tag, what)
            return None
        known = {item.name for item in data}
        reader = StateReader(self._log, content, root, self._library, known)
        states, initial = reader.read()
        data += tuple(
            Data(item.variable, STRING, Literal(value="", position=item.position), item.position)
            for item in reader.remembered
        )
        data += loop_variables(states, data)
        machine = Machine(
            name=self._name(),
            dialect=_dialect(root),
            position=root.position,
            initial=initial,
            states=states,
            data=data,
            interfaces=tuple(self._declarations.interfaces),
            ports=tuple(self._declarations.ports),
            threads=tuple(self._read_threads()),
        )
        if not any(state.states for state in states) and not any(asked_states(states)):
            return machine
        if any(found.severity == "error" for found in self._log.diagnostics[before:]):
            return None
        return self._lowered(machine)

    def _lowered(self, machine: Machine) -> Machine | None:
        tree = msgspec.structs.replace(machine, tree=machine.states, starts_in=machine.initial)
        try:
            return lowered(tree, MAX_TRANSITIONS)
        except TooLargeError:
            what = (
                f"the machine has more than {MAX_TRANSITIONS} transitions, those of compound states "
                "counted for each state in them"
            )
            hint = "make it several machines"
            self._log.error("unsupported-element", machine.position, self._root.tag, what, hint)
            return None

    def _name(self) -> str:
        """The machine's name: that of its file, without the ending, where it has none (W3C SCXML 3.2.1)."""
        return self._root.get("name") or Path(self._root.position.file).stem

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
            hint = MISPLACED.get(child.tag) or nearest(child.tag, ROOT_CHILDREN)
            where = f"not an element of <{self._root.tag}>"
            self._log.error("unknown-tag", child.position, child.tag, where, hint)

    def _read_threads(self) -> list[ActionThread]:
        threads = []
        for element in self._root.all("ros_action_thread"):
            content = ContentReader(self._log, tuple(self._declarations.interfaces))
            interface = content.interface_of(element, InterfaceKind.ACTION_SERVER)
            count = number(element.get("n_threads") or "1")
            if count is None or count < 1 or not float(count).is_integer():
                self._log.error(
                    "bad-number",
                    element.at("n_threads"),
                    element.tag,
                    f"`{element.get('n_threads')}` is not a number of threads",
                    "a whole number from 1",
                )
                count = 1
            interfaces = tuple(self._declarations.interfaces)
            reader = MachineReader(element, self._log, self._library, interfaces, self._is_ascxml)
            machine = reader.read()
            if machine is not None:
                name = f"{self._name()}Thread"
                named = msgspec.structs.replace(machine, name=name)
                threads.append(ActionThread(interface, int(count), named, element.position))
        return threads


def _dialect(root: Element) -> Dialect:
    if root.tag == "ascxml":
        return Dialect.ASCXML
    stack = [root]
    while stack:
        element = stack.pop()
        if element.tag.startswith(("ros_", "bt_")):
            return Dialect.HL_SCXML
        if element.tag == "transition" and element.get("event") in LEGACY_EVENTS:
            return Dialect.HL_SCXML
        stack += element.children
    return Dialect.SCXML
