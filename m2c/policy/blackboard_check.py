"""``BlackboardCheckInt``, a decorator of BehaviorTree.CPP 3 that version 4 lacks, made of nodes that it has.

It looks at each tick whether its two values are equal. While they are, it ticks its child; else it halts the
child, if that is running, and returns ``return_on_mismatch``. That is what ``WhileDoElse`` does.
"""

from __future__ import annotations

import re

import msgspec

from m2c.diagnostics import DiagnosticLog, shortened
from m2c.language.conversion import STATUS_NUMBERS
from m2c.model.xml import Element
from m2c.policy.plugins import referenced_entry
from m2c.policy.tree import BLACKBOARD_CHECK, CONDITIONS, BuiltinNode

_INTEGER = re.compile(r"[+-]?[0-9]{1,10}")
_VALUES = ("value_A", "value_B")
_MISMATCH = "return_on_mismatch"


def blackboard_check(element: Element, node: BuiltinNode, log: DiagnosticLog) -> BuiltinNode:
    """``node``, a ``BlackboardCheckInt`` with its child, as a ``WhileDoElse``.

    Args:
        element: as it is written.
        node: the same as it was read.
        log: gets ``bad-port`` for a value that is neither an integer nor an entry, and for what is no status.
    """
    assert node.tag == BLACKBOARD_CHECK
    ports = dict(node.attributes)
    operands = [_operand(element, key, ports[key], log) for key in _VALUES if key in ports]
    condition = _made(node, "ScriptCondition", code=" == ".join(operands))
    otherwise = _otherwise(element, node, ports.get(_MISMATCH, "FAILURE").strip(), log)
    return msgspec.structs.replace(
        node,
        tag="WhileDoElse",
        attributes=tuple((key, value) for key, value in node.attributes if key in CONDITIONS),
        children=(condition, *node.children, otherwise),
    )


def _operand(element: Element, key: str, written: str, log: DiagnosticLog) -> str:
    """A value as a script has it."""
    text = written.strip()
    if entry := referenced_entry(text, key):
        return entry
    if _INTEGER.fullmatch(text):
        return str(int(text))
    what = f"`{key}` cannot be `{shortened(written, 80)}`"
    log.error("bad-port", element.at(key), element.tag, what, "an integer, or an entry, {…}")
    return "0"


def _otherwise(
    element: Element, node: BuiltinNode, written: str, log: DiagnosticLog
) -> BuiltinNode:
    """The node that returns the status for values that differ: its name, or its number in AS2FM."""
    names = {str(number): name for name, number in STATUS_NUMBERS.items()}
    match names.get(written, written):
        case "SUCCESS":
            return _made(node, "AlwaysSuccess")
        case "FAILURE":
            return _made(node, "AlwaysFailure")
        case "RUNNING":
            always = _made(node, "AlwaysSuccess")
            return msgspec.structs.replace(
                _made(node, "KeepRunningUntilFailure"), children=(always,)
            )
    what = f"`{_MISMATCH}` cannot be `{shortened(written, 80)}`"
    hint = f"one of {', '.join(STATUS_NUMBERS)}, or {', '.join(names)} for them"
    log.error("bad-port", element.at(_MISMATCH), element.tag, what, hint)
    return _made(node, "AlwaysFailure")


def _made(node: BuiltinNode, tag: str, **ports: str) -> BuiltinNode:
    return BuiltinNode(tag=tag, name="", position=node.position, attributes=tuple(ports.items()))
