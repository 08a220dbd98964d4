"""The nodes that m2c itself runs, as they are written: their ports, and what is around them."""

from __future__ import annotations

import math
import re

import msgspec

from m2c.diagnostics import DiagnosticLog, Position, shortened
from m2c.policy.bound import BoundLeaf
from m2c.policy.plugins import PortValue, referenced_entry, value_of
from m2c.policy.tree import (
    KEEPS_CHILDREN,
    TIMED,
    WAITING,
    LeafKind,
    LeafNode,
    PolicyFile,
)

_MOST_MS = 2**32
"""BehaviorTree.CPP's ports for milliseconds are ``unsigned``."""


class _Port(msgspec.Struct, frozen=True):
    """A port: how its value is kept, the one that it has if none is given, and what it takes."""

    kind: str
    default: bool | int | float
    wanted: str


_PORTS = {
    "TryCatch": {"catch_on_halt": _Port("bool", False, "true or false")},
    "RoundRobin": {"wrap_around": _Port("bool", False, "true or false")},
    "RecoveryNode": {"number_of_retries": _Port("int", 1, "a number of retries, 0 or more")},
    "RateController": {"hz": _Port("double", 10.0, "a rate in Hz, more than 0")},
}
_INDEX = "current_child_idx"
_GO_ON = ("RateController", "SingleTrigger")
"""Nodes that make a difference between going on and starting anew, once they have ended."""


def kept_children(policy: PolicyFile) -> set[Position]:
    """The nodes below ``KEEPS_CHILDREN`` that go on after they have ended."""
    return {
        child.position
        for node in policy.leaves()
        if node.id in KEEPS_CHILDREN
        for child in node.children
        if isinstance(child, LeafNode) and child.id in _GO_ON
    }


def bind_own(node: LeafNode, log: DiagnosticLog) -> BoundLeaf | None:
    """``node``, one of ``TIMED`` or ``CONTROLS``; None after the error ``leaf-port``."""
    inputs: list[PortValue] = []
    outputs: tuple[PortValue, ...] = ()
    if node.id in TIMED:
        inputs.append(_time(node, TIMED[node.id], log))
    elif node.id == "PersistentSequence":
        inputs.append(_index(node, log))
        outputs = (PortValue(key=_INDEX, kind="int", entry=inputs[0].entry),)
    else:
        inputs += [_value(node, key, port, log) for key, port in _PORTS.get(node.id, {}).items()]
    return BoundLeaf(
        name=node.name,
        kind=LeafKind.ACTION,
        position=node.position,
        timed=node.id if node.id in WAITING else "",
        control="" if node.id in WAITING else node.id,
        inputs=tuple(inputs),
        outputs=outputs,
        children=len(node.children),
    )


def _time(node: LeafNode, key: str, log: DiagnosticLog) -> PortValue:
    written = node.get(key)
    entry = referenced_entry(written, key)
    told = re.fullmatch("[0-9]{1,10}", written) is not None and int(written) < _MOST_MS
    if not entry and not told:
        what = f"`{key}` is `{shortened(written, 80)}`" if written else f"`{key}` is missing"
        hint = f'write a number of milliseconds, {key}="500"'
        log.error("leaf-port", node.position, node.element, what, hint)
    return PortValue(key=key, kind="int", entry=entry, value=int(written) if told else 0)


def _index(node: LeafNode, log: DiagnosticLog) -> PortValue:
    written = node.get(_INDEX)
    entry = referenced_entry(written, _INDEX)
    if written and not entry:
        what = f"`{_INDEX}` is `{shortened(written, 80)}`, which is not a blackboard entry"
        hint = f'write {_INDEX}="{{{_INDEX}}}", and <Script code="{_INDEX} := 0"/> before'
        log.error("leaf-port", node.position, node.element, what, hint)
    return PortValue(key=_INDEX, kind="int", entry=entry)


def _value(node: LeafNode, key: str, port: _Port, log: DiagnosticLog) -> PortValue:
    written = node.get(key)
    entry = referenced_entry(written, key)
    value = port.default if entry or not written else value_of(written, port.kind)
    if value is None or not _fits(port.kind, float(value)):
        what = f"`{key}` is `{shortened(written, 80)}`"
        log.error("leaf-port", node.position, node.element, what, port.wanted)
        value = port.default
    return PortValue(key=key, kind=port.kind, entry=entry, value=value)


def _fits(kind: str, value: float) -> bool:
    return 0 < value < math.inf if kind == "double" else value >= 0
