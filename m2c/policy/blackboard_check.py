"""``BlackboardCheckInt`` and its like: decorators of BehaviorTree.CPP 3, made of nodes of version 4.

One looks at each tick whether its two values are equal. While they are, it ticks its child; else it halts the
child, if that is running, and returns ``return_on_mismatch``. That is what ``WhileDoElse`` does.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import msgspec

from m2c.diagnostics import DiagnosticLog, shortened
from m2c.language.conversion import STATUS_NUMBERS
from m2c.language.numerals import decimal
from m2c.model.xml import Element
from m2c.policy.plugins import referenced_entry
from m2c.policy.tree import CONDITIONS, BuiltinNode

_INTEGER = re.compile(r"[+-]?[0-9]{1,10}")
_VALUES = ("value_A", "value_B")
_MISMATCH = "return_on_mismatch"


def _integer(text: str) -> str:
    return str(int(text)) if _INTEGER.fullmatch(text) else ""


def _number(text: str) -> str:
    value = decimal(text)
    return "" if value is None or not math.isfinite(value) else repr(value)


def _text(text: str) -> str:
    return "" if "'" in text else f"'{text}'"


def _flag(text: str) -> str:
    return {"true": "true", "1": "true", "false": "false", "0": "false"}.get(text.lower(), "")


_KINDS: dict[str, tuple[Callable[[str], str], str]] = {
    "BlackboardCheckInt": (_integer, "an integer"),
    "BlackboardCheckDouble": (_number, "a number"),
    "BlackboardCheckString": (_text, "a text without '"),
    "BlackboardCheckBool": (_flag, "true or false"),
}
"""Of each: a value as a script has it, "" for what is none; what a value is."""


def blackboard_check(element: Element, node: BuiltinNode, log: DiagnosticLog) -> BuiltinNode:
    """``node``, one of ``BLACKBOARD_CHECKS`` with its child, as a ``WhileDoElse``.

    Args:
        element: as it is written.
        node: the same as it was read.
        log: gets ``bad-port`` for a value that is neither of the kind nor an entry, and what is no status.
    """
    ports = dict(node.attributes)
    operands = [
        _operand(element, node.tag, key, ports[key], log) for key in _VALUES if key in ports
    ]
    condition = _made(node, "ScriptCondition", code=" == ".join(operands))
    otherwise = _otherwise(element, node, ports.get(_MISMATCH, "FAILURE").strip(), log)
    return msgspec.structs.replace(
        node,
        tag="WhileDoElse",
        attributes=tuple((key, value) for key, value in node.attributes if key in CONDITIONS),
        children=(condition, *node.children, otherwise),
    )


def _operand(element: Element, tag: str, key: str, written: str, log: DiagnosticLog) -> str:
    """A value as a script has it."""
    text = written.strip()
    if entry := referenced_entry(text, key):
        return entry
    as_script, kind = _KINDS[tag]
    if value := as_script(text):
        return value
    what = f"`{key}` cannot be `{shortened(written, 80)}`"
    log.error("bad-port", element.at(key), element.tag, what, f"{kind}, or an entry, {{…}}")
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
