"""Ports of the built-in nodes: what BehaviorTree.CPP finds only when it ticks them is found before.

It checks the form of a value when it loads a tree, but not whether the value is there, nor whether it makes
sense; what is missing then ends the run, or the process.
"""

from __future__ import annotations

from m2c.diagnostics import DiagnosticLog, shortened
from m2c.language.numerals import integer
from m2c.model.xml import Element
from m2c.policy.plugins import referenced_entry
from m2c.policy.tree import BLACKBOARD_CHECKS

_STATUSES = ("SUCCESS", "FAILURE", "SKIPPED", "RUNNING")
_REQUIRED = {
    "Repeat": ("num_cycles",),
    "RetryUntilSuccessful": ("num_attempts",),
    **{f"Switch{cases}": ("variable",) for cases in range(2, 7)},
    "Script": ("code",),
    "ScriptCondition": ("code",),
    "Precondition": ("if",),
    **dict.fromkeys(BLACKBOARD_CHECKS, ("value_A", "value_B")),
    "SetBlackboard": ("value", "output_key"),
    "PersistentSequence": ("current_child_idx",),
    "UnsetBlackboard": ("key",),
    **dict.fromkeys(("SkipUnlessUpdated", "WaitValueUpdate", "WasEntryUpdated"), ("entry",)),
    **{f"Loop{kind}": ("queue",) for kind in ("Int", "Bool", "Double", "String")},
}
_STATUS_PORTS = {
    ("Precondition", "else"),
    *((f"Loop{kind}", "if_empty") for kind in ("Int", "Bool", "Double", "String")),
}
_NAME_PORTS = {("UnsetBlackboard", "key")}
_COUNT_PORTS = {
    ("Parallel", "success_count"),
    ("Parallel", "failure_count"),
    ("ParallelAll", "max_failures"),
}


_TEXT_PORTS = {
    ("SetBlackboard", "value"),
    ("Script", "code"),
    *((f"Switch{cases}", "variable") for cases in range(2, 7)),
    *((f"Switch{cases}", f"case_{case}") for cases in range(2, 7) for case in range(1, cases + 1)),
    *((f"Loop{kind}", "queue") for kind in ("Int", "Bool", "Double", "String")),
}


def is_not_given(tag: str, key: str, value: str) -> bool:
    """Whether the port ``key`` counts as not given: it is empty, and for it an empty text is no value."""
    return not value.strip() and (tag, key) not in _TEXT_PORTS


def check_ports(element: Element, tag: str, ports: dict[str, str], log: DiagnosticLog) -> None:
    """Report ``missing-attribute`` and ``bad-port``.

    Args:
        element: the node as it is written.
        tag: what version 4 calls it.
        ports: what it is given, by version 4's names.
        log: where faults go.
    """
    for key in _REQUIRED.get(tag, ()):
        if key not in ports:
            what = f"the attribute `{key}` is missing"
            log.error("missing-attribute", element.position, element.tag, what)
    for key, value in ports.items():
        refers = value.startswith("{")
        if (tag, key) in _STATUS_PORTS and not refers and value not in _STATUSES:
            _bad(element, key, value, f"one of {', '.join(_STATUSES)}", log)
        if (tag, key) in _NAME_PORTS and refers:
            hint = f'the entry\'s name is written out, {key}="…"'
            _bad(element, key, value, hint, log)
        count = integer(value) if (tag, key) in _COUNT_PORTS else None
        if count is not None and count > len(element.children):
            many = len(element.children)
            there = "1 child" if many == 1 else f"{many} children"
            _bad(element, key, value, f"{tag} has {there} here", log)


def bare_entry(element: Element, key: str, value: str, log: DiagnosticLog) -> str:
    """The name of the entry that ``value`` writes as ``{name}``, with the warning ``braced-entry``.

    BehaviorTree.CPP would take the name from that entry; nobody means that, and AS2FM wants the braces.
    """
    name = referenced_entry(value, key)
    if not name:
        return value
    what = f"`{key}` is `{value}`: the entry `{name}` is set"
    hint = f'BehaviorTree.CPP wants the name without braces, {key}="{name}"'
    log.warning("braced-entry", element.at(key), element.tag, what, hint)
    return name


def _bad(element: Element, key: str, value: str, hint: str, log: DiagnosticLog) -> None:
    at = element.at(key) if key in element.attributes else element.position
    log.error("bad-port", at, element.tag, f"`{key}` cannot be `{shortened(value, 80)}`", hint)
