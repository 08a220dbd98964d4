"""Names that cannot work anywhere: unreadable characters, too long, or nothing that an expression can say.

A name of a model becomes an identifier, a file, a channel or a line on a screen. Characters that
cannot be seen make two names look like one (Unicode Technical Report 36, section 2) or break the
line that a name stands in. Texts (labels of logs, string literals, comments) may hold anything.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Iterable, Iterator

from m2c.diagnostics import DiagnosticLog, Position
from m2c.language.expressions import Variable
from m2c.language.parsing import parse_expression
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import (
    CHANNEL_KINDS,
    Cancel,
    Emit,
    EventKind,
    InterfaceKind,
    Machine,
    Raise,
)
from m2c.model.naming import ANYWHERE, Naming, check_channel, check_field, check_node
from m2c.model.system import System
from m2c.model.walk import statements_of, with_threads

MAX_NAME = 255
"""Characters: what a file system (NAME_MAX of POSIX) and a topic of DDS have room for."""
_SHOWN = 40
_SEPARATORS = {"Cc", "Zl", "Zp"}
_UNSEEN = _SEPARATORS | {"Cf", "Cn", "Cs"}
"""General categories: control, line and paragraph separator, format (bidi, zero width), unassigned
(in the version of Unicode that this Python knows), surrogate."""

_RESERVED = frozenset(
    (
        *("break", "case", "catch", "class", "const", "continue", "debugger", "default", "delete"),
        *("do", "else", "enum", "export", "extends", "false", "finally", "for", "function", "if"),
        *("import", "in", "instanceof", "new", "null", "return", "super", "switch", "this"),
        *("throw", "true", "try", "typeof", "var", "void", "while", "with"),
    )
)
"""Words that are no identifiers (ECMA-262, section 12.7.2), except those that are in a script."""


def check_names(system: System, log: DiagnosticLog, naming: Naming = ANYWHERE) -> None:
    """Report ``bad-name`` for every name of ``system`` that cannot be used.

    Names of nodes and channels that single transports refuse are ``bad-name`` where these were chosen,
    else ``unportable-name``.

    Args:
        system: whose own name, machines, states, events, ids, variables, ports and channels are read.
        log: where the findings go; each has a name that would work.
        naming: the transports that are asked.
    """
    whole = Position(str(system.path))
    _check(system.name, "the system's name", whole, "", log)
    if system.policy is not None:
        _check(system.policy.stem, "the policy's name", Position(str(system.policy)), "", log)
    for machine in (*system.nodes, *system.plugins):
        fine = _check_machine(machine, log)
        if fine and machine in system.nodes:  # a plugin runs in the policy's node
            check_node(machine.name, *machine.name_place, naming, log)
        _check_declarations(machine, naming, log)
        _check_events(machine, system.library, naming, log)
        for owner in with_threads(machine):
            _check_content(owner, log)


def _check_machine(machine: Machine, log: DiagnosticLog) -> bool:
    if machine.name:
        return _check(machine.name, "the machine's name", *machine.name_place, log)
    # plain SCXML: what is left of `Action` without its suffix
    message = "nothing is left of the machine's name without `Action` and `Condition`"
    log.error("bad-name", machine.position, "scxml", message, "write it like BatteryAction")
    return False


def _check_declarations(machine: Machine, naming: Naming, log: DiagnosticLog) -> None:
    declared = {port.key for port in machine.ports}
    for interface in machine.interfaces:
        is_timer = interface.kind is InterfaceKind.TIMER
        at = interface.position
        if interface.name not in (interface.channel, interface.port):
            _check(interface.name, f"the name of a {interface.kind.noun}", at, "", log)
        if interface.channel is not None:
            what = "the timer's name" if is_timer else "the channel"
            fine = _check(interface.channel, what, at, "", log)
            if fine and not is_timer:
                kind = CHANNEL_KINDS[interface.kind]
                check_channel(kind, interface.channel, at, "", naming, log)
        if interface.port is not None and interface.port not in declared:
            _check(interface.port, "the port", at, "", log)
    for port in machine.ports:
        _check(port.key, "the port", port.position, "", log)


def _check_events(
    machine: Machine, library: InterfaceLibrary, naming: Naming, log: DiagnosticLog
) -> None:
    """The params of the plain events that ``machine`` sends."""
    sent = {item.name: item.type_name for item in machine.interfaces if item.event}
    fields = {name: dict(library.message(kind).fields) for name, kind in sent.items()}
    seen: set[tuple[str, str]] = set()
    for owner in with_threads(machine):
        for item in statements_of(owner):
            if isinstance(item, Emit) and item.interface in fields:
                for field in item.fields:
                    kind = fields[item.interface].get(field.name)
                    if kind is not None and (item.interface, field.name) not in seen:
                        seen.add((item.interface, field.name))
                        check_field(field.name, kind, field.position, naming, log)


def _check_content(machine: Machine, log: DiagnosticLog) -> None:
    for data in machine.data:
        if _check(data.name, "the variable", data.position, "data", log):
            _check_variable(data.name, data.position, log)
    reported: set[tuple[str, Position]] = set()
    for name, what, position, element in _of_states(machine):
        if (name, position) not in reported:  # a state may be named by several elements
            reported.add((name, position))
            _check(name, what, position, element, log)


def _of_states(machine: Machine) -> Iterator[tuple[str, str, Position, str]]:
    for state in machine.states:
        yield state.name, "the state", state.position, "final" if state.final else "state"
        for transition in state.transitions:
            event = transition.event
            if event is not None and event.kind is EventKind.INTERNAL:
                yield event.name, "the event", transition.position, transition.element
    for statement in statements_of(machine):
        match statement:
            case Raise(event=raised, id=identifier):
                element = "send" if statement.external else "raise"
                yield raised, "the event", statement.position, element
                yield identifier, "the id", statement.position, element
            case Cancel(id=identifier):
                yield identifier, "the id", statement.position, "cancel"


def _check_variable(name: str, position: Position, log: DiagnosticLog) -> None:
    """An expression must be able to name it: a location is an expression of ECMAScript."""
    if _says_variable(name):
        return
    words = re.sub(r"\W", "_", name, flags=re.ASCII)
    candidates = (words, f"{words}_", f"_{words}")
    hint = f"write `{next(filter(_says_variable, candidates))}`"
    log.error("bad-name", position, "data", f"no expression can name the variable `{name}`", hint)


def _says_variable(text: str) -> bool:
    if text in _RESERVED:
        return False
    expression = parse_expression(text, Position(""), "", DiagnosticLog())
    return isinstance(expression, Variable) and expression.name == text


def _check(name: str, what: str, position: Position, element: str, log: DiagnosticLog) -> bool:
    """Report ``name`` if it is too long or has characters that cannot be seen; whether it is fine."""
    if len(name) > MAX_NAME:
        message = f"{what} `{_visible(name[:_SHOWN])}…` has {len(name)} characters"
        log.error("bad-name", position, element, message, f"a name has at most {MAX_NAME}")
        return False
    unseen = [letter for letter in name if unicodedata.category(letter) in _UNSEEN]
    if not unseen:
        return True
    first = unseen[0]
    unnamed = "unassigned" if unicodedata.category(first) == "Cn" else "a control character"
    described = unicodedata.name(first, unnamed).lower()
    message = f"{what} `{_visible(name)}` has U+{ord(first):04X}, {described}"
    written = _written(name)
    hint = f"write `{written}`" if written else "write letters, digits and underscores"
    log.error("bad-name", position, element, message, hint)
    return False


def _visible(name: str) -> str:
    r"""``name`` with ``\u202e`` for what cannot be seen, so that a message cannot be falsified."""
    return _mapped(name, lambda letter: letter.encode("unicode_escape").decode("ascii"))


def _written(name: str) -> str:
    """The nearest name that works: separators become underscores, what has no width goes."""
    separated = _mapped(
        name, lambda letter: "_" if unicodedata.category(letter) in _SEPARATORS else ""
    )
    return separated.strip("_ ")


def _mapped(name: Iterable[str], replace: Callable[[str], str]) -> str:
    return "".join(
        replace(letter) if unicodedata.category(letter) in _UNSEEN else letter for letter in name
    )
