"""Entries of the blackboard that are read and that nothing sets: reading one ends the run.

Trees see each other's entries in many ways, so an entry counts as set if anything in the policy may set an
entry of that name; what is left is never there.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from m2c.diagnostics import DiagnosticLog
from m2c.policy.plugins import referenced_entry
from m2c.policy.tree import (
    CONDITIONS,
    BuiltinNode,
    LeafNode,
    PolicyFile,
    SubTreeNode,
    TreeNode,
    nodes_of,
)
from m2c.suggestions import nearest

_SCRIPTS = {("Script", "code"), ("ScriptCondition", "code"), ("Precondition", "if")}
_READ = {
    ("Parallel", "success_count"),
    ("Parallel", "failure_count"),
    ("ParallelAll", "max_failures"),
    ("Repeat", "num_cycles"),
    ("RetryUntilSuccessful", "num_attempts"),
    ("Sleep", "msec"),
    ("Delay", "delay_msec"),
    ("Timeout", "msec"),
    ("TryCatch", "catch_on_halt"),
    ("RoundRobin", "wrap_around"),
    ("RecoveryNode", "number_of_retries"),
    ("RateController", "hz"),
    ("PersistentSequence", "current_child_idx"),
}
"""Ports without whose value their nodes cannot go on; others have one of their own then."""
_TEXTS = re.compile(r"""'[^']*'|"[^"]*\"""")
_NAME = re.compile(r"@?[A-Za-z_]\w*")
_ASSIGNED = re.compile(r"(@?[A-Za-z_]\w*)\s*:=")
_WORDS = ("true", "false")


def check_entries(policy: PolicyFile, log: DiagnosticLog) -> None:
    """Report ``unset-entry``: no script, port or sub-tree of ``policy`` can set what a node reads."""
    nodes = [node for tree in policy.trees for node in nodes_of(tree.root)]
    known = {name for node in nodes for name in _may_set(node)}
    for node in nodes:
        for key, name in _reads(node):
            if name.lstrip("@") not in known:
                element = node.element if isinstance(node, LeafNode) else _tag(node)
                what = f"`{key}` reads the entry `{name}`, which nothing in the policy sets"
                near = nearest(name, known)
                hint = f'set it before, <Script code="{name} := …"/>'
                hint = near if near.startswith("did you mean") else hint
                log.error("unset-entry", node.position, element, what, hint)
                break


def _tag(node: TreeNode) -> str:
    return node.tag if isinstance(node, BuiltinNode) else "SubTree"


def _scripts(node: TreeNode) -> Iterator[tuple[str, str]]:
    """The scripts of a node, without the texts in them, by the attribute where they stand."""
    for key, value in node.attributes:
        if key in CONDITIONS or (isinstance(node, BuiltinNode) and (node.tag, key) in _SCRIPTS):
            yield key, _TEXTS.sub("''", value)


def _may_set(node: TreeNode) -> Iterator[str]:
    for _, script in _scripts(node):
        yield from (name.lstrip("@") for name in _ASSIGNED.findall(script))
    for key, value in node.attributes:
        entry = referenced_entry(value, key).lstrip("@")
        match node:
            case BuiltinNode(tag="SetBlackboard") if key == "output_key":
                yield value.strip().lstrip("@")
            case BuiltinNode(tag=tag) if tag.startswith("Loop") and key == "value" and entry:
                yield entry
            case SubTreeNode() if not key.startswith("_"):
                yield key
                if entry:
                    yield entry
            case LeafNode() if entry and (node.id, key) not in _READ:
                yield entry  # a plugin may write it


def _reads(node: TreeNode) -> Iterator[tuple[str, str]]:
    for key, script in _scripts(node):
        written = set(_ASSIGNED.findall(script))
        for found in _NAME.finditer(script):
            name = found[0]
            if name not in _WORDS and name not in written and not _is_number(script, found.start()):
                yield key, name
    tag = node.id if isinstance(node, LeafNode) else _tag(node)
    for key, value in node.attributes:
        entry = referenced_entry(value, key)
        if entry and (tag, key) in _READ:
            yield key, entry


def _is_number(script: str, start: int) -> bool:
    """Whether the name at ``start`` is the end of a number, as in ``0xFF`` or ``1e3``."""
    return start > 0 and (script[start - 1].isdigit() or script[start - 1] == ".")
