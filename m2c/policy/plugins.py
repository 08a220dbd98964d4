"""What a plugin of a policy may be given: the values of its ports, and children."""

from __future__ import annotations

import difflib
import json
import math
import re
from typing import Any

import msgspec

from m2c.diagnostics import DiagnosticLog, shortened
from m2c.language.conversion import ExecutionError
from m2c.language.datatypes import ANY, FLOATS, INTEGER_RANGES, DataType, Primitive, describe
from m2c.language.numerals import decimal, integer
from m2c.language.values import convert, zero
from m2c.model.machine import EventKind, InterfaceKind, Machine, OutputKind
from m2c.model.naming import absolute
from m2c.model.walk import emits_of, events_of, ports_read, with_threads
from m2c.policy.tree import ADDRESS, MARK, LeafNode
from m2c.suggestions import nearest

CHILDREN_COUNT = "CHILDREN_COUNT"
"""The input port by which a control node learns how many children it has (AS2FM)."""

_REFERENCE = re.compile(r"\{\s*(=|@?[A-Za-z_][\w.]*)\s*\}")
_ZEROS: dict[str, bool | int | float | str] = {"bool": False, "int": 0, "double": 0.0, "string": ""}
_JSON = "json:"
"""How BehaviorTree.CPP marks a value that is JSON; elsewhere than at a leaf, ``{…}`` would name an entry."""
_MAX_SHOWN = 200
"""Characters of a value that a message repeats."""
_CHILD_EVENTS = (EventKind.BT_CHILD_STATUS, EventKind.BT_CHILD_HALTED)
_CHILD_OUTPUTS = (OutputKind.BT_TICK_CHILD, OutputKind.BT_HALT_CHILD)


class PortValue(msgspec.Struct, frozen=True, kw_only=True):
    """What one port of one plugin is given.

    Attributes:
        key: the port.
        kind: how its value is kept on the blackboard: ``bool``, ``int``, ``double``, ``string``, or for a
            structure or an array ``json``: a string, its JSON.
        type: of a structure or an array; None for other kinds.
        entry: the blackboard entry it is connected to; empty if it has a value of its own.
        value: that value (its JSON where that is the kind); with an entry that ``may_be_missing``, the
            value meanwhile.
        may_be_missing: whether the port can be read while its entry does not exist.
    """

    key: str
    kind: str
    type: DataType | None = None
    entry: str = ""
    value: bool | int | float | str = ""
    may_be_missing: bool = False


def referenced_entry(written: str, key: str) -> str:
    """The blackboard entry that ``{entry}`` names (``{=}``: the port's own name); "" if none."""
    match = _REFERENCE.fullmatch(written)
    if match is None:
        return ""
    return key if match[1] == "=" else match[1]


def has_children(plugin: Machine) -> bool:
    """Whether ``plugin`` ticks or halts children: a control node or a decorator."""
    return bool(_named_children(plugin))


def check_children(node: LeafNode, plugin: Machine, log: DiagnosticLog) -> None:
    """Report ``child-count``: a child that ``plugin`` names by its number is not there."""
    count = len(node.children)
    named = {int(name) for name in _named_children(plugin) if name.isascii() and name.isdigit()}
    missing = sorted(number for number in named if number >= count)
    if missing:
        what = f"{count} children, but `{plugin.name}` ticks child {missing[0]}"
        hint = f"children are numbered from 0: it takes {max(named) + 1}"
        log.error("child-count", node.position, node.element, what, hint)


def _named_children(plugin: Machine) -> set[str]:
    """The children that ``plugin`` ticks, halts or hears: numbers, or variables that have one."""
    return {event.name for event in events_of(plugin) if event.kind in _CHILD_EVENTS} | {
        name for kind, name in emits_of(plugin) if kind in _CHILD_OUTPUTS
    }


def port_values(
    node: LeafNode, plugin: Machine, written: dict[str, str], log: DiagnosticLog
) -> tuple[tuple[PortValue, ...], tuple[PortValue, ...]] | None:
    """The input and output ports of ``plugin`` as ``written`` in ``node``; None after an error.

    Rules reported: ``leaf-port``, ``ignored-attribute``.
    """
    channels = {item.port for item in plugin.interfaces if item.kind is not InterfaceKind.TIMER}
    rates = {item.port for item in plugin.interfaces if item.kind is InterfaceKind.TIMER}
    fixed = {
        **dict.fromkeys(rates, "a timer's rate"),
        **dict.fromkeys(channels, "a channel's name"),
    }
    read = {key for owner in with_threads(plugin) for key in ports_read(owner)}
    read_back = read - {port.key for port in plugin.ports if not port.output}
    inputs: list[PortValue] = []
    outputs: list[PortValue] = []
    known = {port.key for port in plugin.ports} | {CHILDREN_COUNT}
    for port in plugin.ports:
        text = written.get(port.key)
        kind = _kept_as(port.type)
        structured = port.type if kind == "json" else None
        problem: tuple[str, str] | None = None
        entry = referenced_entry(text, port.key) if text is not None else ""
        if port.key == CHILDREN_COUNT and not port.output:
            inputs.append(PortValue(key=port.key, kind="int", value=len(node.children)))
            continue
        if text is None and port.optional:
            continue
        if text is None:
            example = "{…}" if port.output else "…"
            problem = (
                f"the port `{port.key}` of `{plugin.name}` is not given",
                f'write {port.key}="{example}"',
            )
            others = [key for key, _ in node.attributes if key not in known]
            if near := difflib.get_close_matches(port.key, others, 1):
                problem = (
                    problem[0],
                    f"`{near[0]}` is none of its ports: did you mean `{port.key}`?",
                )
        elif kind is None:
            problem = (
                f"the port `{port.key}` of `{plugin.name}` has type {describe(port.type)}",
                "a port is a bool, a number, a string, a structure or an array",
            )
        elif port.output and not entry:
            problem = (
                f"the output port `{port.key}` is `{text}`, which is not a blackboard entry",
                f'write {port.key}="{{{port.key}}}"',
            )
        elif entry and port.key in fixed:
            problem = (
                f"`{port.key}` is the blackboard entry `{text}`",
                f"`{plugin.name}` takes {fixed[port.key]} from it: write it out",
            )
        if problem is None and kind is not None and text is not None:
            if port.output:
                output = PortValue(key=port.key, kind=kind, type=structured, entry=entry)
                outputs.append(output)
                if port.key in read_back:
                    empty = _ZEROS[kind] if structured is None else json_of(zero(structured))
                    inputs.append(msgspec.structs.replace(output, value=empty, may_be_missing=True))
                continue
            wanted = f"the port has type {describe(port.type)}"
            value = "" if entry or structured else value_of(text, kind)
            if structured is not None and not entry:
                value = json_text(text)
                try:
                    convert(value_of_json(value), structured)
                except (ValueError, ExecutionError) as error:
                    value, wanted = None, f"{wanted}, as JSON: {error}"
            if port.key in channels:
                value = absolute(text)
            is_rate = port.key in rates and isinstance(value, int | float)
            if value is not None and not (is_rate and not 0 < float(value) < math.inf):
                inputs.append(
                    PortValue(key=port.key, kind=kind, type=structured, entry=entry, value=value)
                )
                continue
            if is_rate:
                wanted = f"`{plugin.name}` takes a timer's rate from it: a number greater than 0"
            problem = (f"`{port.key}` is `{shortened(text, _MAX_SHOWN)}`", wanted)
        assert problem is not None
        log.error("leaf-port", node.position, node.element, *problem)
        return None
    for key, text in node.attributes:
        if key in known or key.startswith("_"):
            continue
        what = f"`{plugin.name}` has no port `{key}`"
        hint = nearest(key, sorted(known - {CHILDREN_COUNT}))
        if referenced_entry(text, key):
            log.error("leaf-port", node.position, node.element, what, hint)
            return None
        if key not in (*ADDRESS, MARK):
            log.warning("ignored-attribute", node.position, node.element, what, hint)
    return tuple(inputs), tuple(outputs)


def _kept_as(kind: DataType) -> str | None:
    if not isinstance(kind, Primitive):
        return "json"
    if kind.name in INTEGER_RANGES:
        return "int"
    if kind.name in FLOATS or kind.name == "number":
        return "double"
    if kind.name == "bool":
        return "bool"
    return "string" if kind.name == "string" or kind == ANY else None


def value_of(text: str, kind: str) -> bool | int | float | str | None:
    """``text`` as a value of ``kind``; None if it is none."""
    match kind:
        case "bool":
            return {"true": True, "1": True, "false": False, "0": False}.get(text.lower())
        case "string":
            return text
        case _:
            return integer(text) if kind == "int" else decimal(text)


def json_text(written: str) -> str:
    """The JSON of a port's value as it is written, with or without BehaviorTree.CPP's ``json:``."""
    return written.strip().removeprefix(_JSON)


def marked(written: str) -> str:
    """``written``, a value that BehaviorTree.CPP reads: an object has its mark, or it would name an entry."""
    text = written.strip()
    if not text.startswith("{") or not text.endswith("}") or referenced_entry(text, ""):
        return written
    try:
        value_of_json(text)
    except ValueError:
        return written
    return _JSON + text


def json_of(value: object) -> str:
    """The JSON of ``value``, a message or plain data; ``NaN`` and ``Infinity`` where JSON has no number."""
    return json.dumps(msgspec.to_builtins(value), separators=(",", ":"), ensure_ascii=False)


def value_of_json(text: str) -> Any:
    """The plain data that :func:`json_of` wrote.

    Raises:
        ValueError: ``text`` is no JSON.
    """
    try:
        return json.loads(text)
    except RecursionError as error:
        raise ValueError("too many objects and arrays inside each other") from error
