"""What a policy is: behaviour trees whose leaves name skills. Plain data, no middleware."""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path

import msgspec

from m2c.diagnostics import Position

MANY = 1_000
"""No bound on the number of children."""

ADDRESS = ("service_name", "service_name_tick", "service_name_halt", "interface")
"""Attributes that say where a leaf's skill is: what has one of them is a leaf, declared or not."""
MARK = "isMonitored"
"""How leaves were marked for the earlier monitor; a plugin may have a port of that name."""
MARK_IGNORED = (f"{MARK} is ignored", "moon monitors passively")
"""What is said of it, and why."""


def is_marked(written: str) -> bool:
    """Whether the value of that mark, as it is written, is true."""
    return written.strip().lower() in ("true", "1")


class LeafKind(StrEnum):
    """A condition answers at once; an action may answer RUNNING and can be halted."""

    CONDITION = "condition"
    ACTION = "action"


class Builtin(msgspec.Struct, frozen=True):
    """A node type of BehaviorTree.CPP 4: how many children it takes, which ports it has."""

    least: int
    most: int
    ports: tuple[str, ...] = ()


_CONTROL = Builtin(1, MANY)
_DECORATOR = Builtin(1, 1)
_LEAF = Builtin(0, 0)
_LOOP = Builtin(1, 1, ("queue", "value", "if_empty"))
BLACKBOARD_CHECKS = tuple(f"BlackboardCheck{kind}" for kind in ("Int", "Double", "String", "Bool"))
"""Nodes of version 3 only: see ``m2c.policy.blackboard_check``."""

BUILTINS: dict[str, Builtin] = {
    **dict.fromkeys(
        (
            *("Sequence", "AsyncSequence", "SequenceWithMemory", "ReactiveSequence"),
            *("Fallback", "AsyncFallback", "ReactiveFallback"),
        ),
        _CONTROL,
    ),
    "Parallel": Builtin(1, MANY, ("success_count", "failure_count")),
    "ParallelAll": Builtin(1, MANY, ("max_failures",)),
    "IfThenElse": Builtin(2, 3),
    "WhileDoElse": Builtin(2, 3),
    **{
        f"Switch{cases}": Builtin(
            cases + 1, cases + 1, ("variable", *(f"case_{i}" for i in range(1, cases + 1)))
        )
        for cases in range(2, 7)
    },
    **dict.fromkeys(
        (*("Inverter", "ForceSuccess", "ForceFailure", "KeepRunningUntilFailure"),), _DECORATOR
    ),
    "Repeat": Builtin(1, 1, ("num_cycles",)),
    "RetryUntilSuccessful": Builtin(1, 1, ("num_attempts",)),
    "Delay": Builtin(1, 1, ("delay_msec",)),
    "Timeout": Builtin(1, 1, ("msec",)),
    "RunOnce": Builtin(1, 1, ("then_skip",)),
    "Precondition": Builtin(1, 1, ("if", "else")),
    **dict.fromkeys(BLACKBOARD_CHECKS, Builtin(1, 1, ("value_A", "value_B", "return_on_mismatch"))),
    "SkipUnlessUpdated": Builtin(1, 1, ("entry",)),
    "WaitValueUpdate": Builtin(1, 1, ("entry",)),
    **{f"Loop{kind}": _LOOP for kind in ("Int", "Bool", "Double", "String")},
    "AlwaysSuccess": _LEAF,
    "AlwaysFailure": _LEAF,
    "Script": Builtin(0, 0, ("code",)),
    "ScriptCondition": Builtin(0, 0, ("code",)),
    "SetBlackboard": Builtin(0, 0, ("value", "output_key")),
    "UnsetBlackboard": Builtin(0, 0, ("key",)),
    "WasEntryUpdated": Builtin(0, 0, ("entry",)),
    "Sleep": Builtin(0, 0, ("msec",)),
    "TryCatch": Builtin(2, MANY, ("catch_on_halt",)),
    "PipelineSequence": _CONTROL,
    "RoundRobin": Builtin(1, MANY, ("wrap_around",)),
    "RecoveryNode": Builtin(2, 2, ("number_of_retries",)),
    "NonblockingSequence": _CONTROL,
    "PersistentSequence": Builtin(1, MANY, ("current_child_idx",)),
    "RateController": Builtin(1, 1, ("hz",)),
    "SingleTrigger": _DECORATOR,
}
"""The node types that every policy can use: those of BehaviorTree.CPP 4, those of Nav2 without a robot, and
``BLACKBOARD_CHECKS``."""

TIMED = {"Sleep": "msec", "Delay": "delay_msec", "Timeout": "msec"}
"""Node types that wait, and the port that says how long (ms). BehaviorTree.CPP's own wait by the
system's clock, on a thread that calls the nodes while the tree is not ticked; here they are run by
the transport's clock (``m2c.policy.controls``)."""

CONTROLS = (
    *("TryCatch", "PipelineSequence", "RoundRobin", "RecoveryNode", "NonblockingSequence"),
    *("PersistentSequence", "RateController", "SingleTrigger"),
)
"""Node types that the library here does not have; they are run as those of ``TIMED`` are."""
WAITING = (*TIMED, "RateController")
"""Of all these, those that ask the clock."""
KEEPS_CHILDREN = CONTROLS[1:6]
"""Control nodes that do not reset a child which has ended, as other nodes do: below them a ``RateController``
or a ``SingleTrigger`` goes on, until the control node ends."""

CONDITIONS = (
    *("_skipIf", "_successIf", "_failureIf", "_while"),
    *("_onSuccess", "_onFailure", "_onHalted", "_post"),
)
"""Scripts before and after a tick, which every node can have."""

AUTOREMAP = "_autoremap"
"""Of a sub-tree: its entries are those of the tree around it that have the same names."""


class BuiltinNode(msgspec.Struct, frozen=True, kw_only=True):
    """A control node, decorator or built-in leaf; ``tag`` is its name in BehaviorTree.CPP 4."""

    tag: str
    name: str
    position: Position
    attributes: tuple[tuple[str, str], ...] = ()
    children: tuple[TreeNode, ...] = ()


class SubTreeNode(msgspec.Struct, frozen=True, kw_only=True):
    """A place where the tree ``id`` is put; ``attributes`` remap its ports."""

    id: str
    name: str
    position: Position
    attributes: tuple[tuple[str, str], ...] = ()


class LeafNode(msgspec.Struct, frozen=True, kw_only=True):
    """A leaf as it is written: ``<Action ID= name= …>`` or ``<ID name= …>``.

    ``kind`` is what the file says, None if it does not; ``attributes`` include the defaults that
    ``<TreeNodesModel>`` declares, but not ``ID`` and ``name``, nor ``isMonitored`` of what is no plugin.
    ``children`` are those of a plugin that ticks children (a control node or a decorator); a leaf has none.
    """

    id: str
    name: str
    kind: LeafKind | None
    position: Position
    element: str
    attributes: tuple[tuple[str, str], ...] = ()
    children: tuple[TreeNode, ...] = ()

    def get(self, key: str) -> str:
        """The attribute ``key``, or an empty text."""
        return dict(self.attributes).get(key, "")


TreeNode = BuiltinNode | SubTreeNode | LeafNode


class Tree(msgspec.Struct, frozen=True):
    """One ``<BehaviorTree>``."""

    id: str
    root: TreeNode
    position: Position


class PolicyFile(msgspec.Struct, frozen=True):
    """A policy file: its trees, and which of them is executed."""

    path: Path
    main: str
    trees: tuple[Tree, ...]

    def leaves(self) -> Iterator[LeafNode]:
        """Every leaf and every plugin that stands in a tree, in document order."""
        for tree in self.trees:
            yield from (node for node in nodes_of(tree.root) if isinstance(node, LeafNode))


def nodes_of(node: TreeNode) -> Iterator[TreeNode]:
    """``node`` and all below it in its tree."""
    yield node
    if not isinstance(node, SubTreeNode):
        for child in node.children:
            yield from nodes_of(child)
