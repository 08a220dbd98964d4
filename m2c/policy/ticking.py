"""Ticking trees of BehaviorTree.CPP, and what the things that its leaves are run by have in common."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

from m2c.language.conversion import ExecutionError
from m2c.language.datatypes import DataType, describe
from m2c.language.values import convert
from m2c.model.xml_writing import read_back
from m2c.policy.bound import child_tree
from m2c.policy.library import LIBRARY_ERRORS, PolicyError, TreeFactory, halt_tree, reason_of
from m2c.policy.plugins import PortValue, json_of, json_text, value_of_json
from m2c.policy.ticks import LeafTick

if TYPE_CHECKING:
    from m2c.policy.program import Policy

STATUS_CODES = {0: "SUCCESS", 1: "FAILURE", 2: "RUNNING"}
"""The ``status`` of a tick's response."""

NODE_STATUSES = (*STATUS_CODES.values(), "SKIPPED")
"""With what a node can end a tick: one that is skipped is to its parent as if it were not there."""

MAX_WAKE_UPS = 1_000
"""How often one tick follows a node of the tree that asks to be ticked again at once (a Repeat
without end asks always); the next tick goes on."""

TreeNode = Any
"""``behaviortreepy.TreeNode``: the node of the tree that is ticked."""


class RunsLeaf(Protocol):
    """What ticks one leaf (all places where it stands), on the thread that ticks the tree.

    It notes in ``record`` what no call shows.
    """

    def tick(self, node: TreeNode, record: LeafTick) -> str:
        """SUCCESS, FAILURE or RUNNING; SKIPPED where its only child is."""
        ...

    def halt(self, node: TreeNode, record: LeafTick) -> None:
        """Stop what is RUNNING."""
        ...


_MISSING = "Missing key"
"""What BehaviorTree.CPP says of an entry that does not exist."""


class PortError(Exception):
    """A value cannot be read from or written to the blackboard; the text names port and entry."""


QUIET_NODES = frozenset(
    {
        *("root", "BehaviorTree", "SubTree", "TreeNodesModel", "Action", "Condition"),
        *("Sequence", "ReactiveSequence", "Fallback", "ReactiveFallback"),
        *("Parallel", "ParallelAll", "IfThenElse", "WhileDoElse", "Switch2", "Switch3"),
        *("Inverter", "ForceSuccess", "ForceFailure", "AlwaysSuccess", "AlwaysFailure"),
    }
)
"""Elements whose nodes never ask to be ticked again (``emitWakeUpSignal`` of BehaviorTree.CPP 4)."""


def may_wake(policy: Policy) -> bool:
    """Whether a node of ``policy`` may ask to be ticked again at once. To ask the tree costs a wait
    of the operating system (60 µs and more), at every tick that is RUNNING.
    """
    leaves = {leaf.id for leaf in policy.leaves}
    return not {node.tag for node in read_back(policy.xml).iter()} <= QUIET_NODES | leaves


def tick_tree(tree: Any, wakes: bool = True) -> str:
    """Tick ``tree`` once, and again at once while one of its nodes asks for it.

    Args:
        tree: a ``behaviortreepy.Tree``.
        wakes: whether any of its nodes may ask (see :func:`may_wake`).

    Raises:
        PolicyError: BehaviorTree.CPP cannot go on, for instance with a script.
    """
    try:
        status = tree.tick_exactly_once()
        for _ in range(MAX_WAKE_UPS):
            if not wakes or status.name != "RUNNING" or not tree.sleep(0):
                break
            status = tree.tick_exactly_once()
    except LIBRARY_ERRORS as error:
        raise PolicyError(f"the tree cannot be ticked: {reason_of(error)}") from error
    return str(status.name)


_KEPT_VALUES = 32
"""Structures and arrays that are kept as they were read last: a leaf reads its ports at every tick."""


def read_port(port: PortValue, node: TreeNode) -> Any:
    """The value of an input port, from the blackboard that ``node`` sees.

    Returns:
        A bool, int, float or string; plain data (dicts and lists) for a structure or an array.

    Raises:
        PortError: the entry does not exist and must, or is not of the port's type.
    """
    value = _read(port, node)
    if port.type is None:
        return value
    try:
        return _structured(value, port.type)
    except (ValueError, ExecutionError) as error:
        where = f"the blackboard entry `{port.entry}`" if port.entry else f"`{value}`"
        raise PortError(
            f"its port `{port.key}` cannot be read from {where} as {describe(port.type)}: {error}"
        ) from error


def _read(port: PortValue, node: TreeNode) -> Any:
    if not port.entry:
        return port.value
    board = node.config().blackboard
    try:
        value: bool | int | float | str = getattr(board, f"get_{_held(port)}")(port.entry)
    except LIBRARY_ERRORS as error:
        if port.may_be_missing and _MISSING in str(error):
            return port.value
        raise PortError(
            f"its port `{port.key}` cannot be read from the blackboard entry `{port.entry}` "
            f"as {_held(port)}: {error}"
        ) from error
    return value


@functools.lru_cache(_KEPT_VALUES)
def _structured(text: str, kind: DataType) -> Any:
    return convert(value_of_json(json_text(text)), kind)


def _held(port: PortValue) -> str:
    """As what BehaviorTree.CPP holds it."""
    return "string" if port.kind == "json" else port.kind


_CONVERT: dict[str, Callable[[Any], Any]] = {
    "int": int,
    "double": float,
    "bool": bool,
    "string": str,
    "json": json_of,
}


def write_port(port: PortValue, value: object, node: TreeNode) -> str:
    """Write an output port to the blackboard that ``node`` sees.

    Returns:
        What was written, as text (see :func:`written_value`).

    Raises:
        PortError: the value does not fit the entry.
    """
    board = node.config().blackboard
    try:
        converted = _CONVERT[port.kind](value)
        getattr(board, f"set_{_held(port)}")(port.entry, converted)
    except (*LIBRARY_ERRORS, TypeError) as error:
        reason = str(error).partition("\n")[0]
        raise PortError(
            f"its port `{port.key}` cannot write {value!r} to the blackboard entry "
            f"`{port.entry}` as {_held(port)}: {reason}"
        ) from error
    return str(converted).lower() if port.kind == "bool" else str(converted)


def written_value(port: PortValue, text: str) -> object:
    """The value that :func:`write_port` wrote to ``port``, from its text.

    Raises:
        ValueError: no value of the port's kind has this text.
    """
    if port.kind == "json":
        return value_of_json(text)
    if port.kind != "bool":
        return _CONVERT[port.kind](text)
    if text not in ("true", "false"):
        raise ValueError(f"{text!r} is no bool")
    return text == "true"


class Nesting:
    """Trees in the nodes of trees, all ticked on one thread.

    Args:
        factory: knows the trees.

    Attributes:
        above: the nodes with children of their own that are ticked or halted now, each with the child.
        retries: how often nodes went back to a child in this tick.
    """

    def __init__(self, factory: TreeFactory) -> None:
        self.factory = factory
        self.above: list[tuple[Children, int]] = []
        self.retries = 0


class Children:
    """The children of one node that BehaviorTree.CPP takes for a leaf: a tree for each.

    They share the blackboard of the node, as children do.

    Args:
        nesting: of all the trees that are ticked with it.
        leaf: the id of the node's leaf.
        count: how many children it has.
        node: the node.
    """

    def __init__(self, nesting: Nesting, leaf: str, count: int, node: TreeNode) -> None:
        board = node.config().blackboard
        self._trees = [
            nesting.factory.create_tree(child_tree(leaf, number), board) for number in range(count)
        ]
        self._running: set[int] = set()
        self._kept: dict[int, Callable[[], None]] = {}
        self._nesting = nesting
        self._above = nesting.above
        self.node = node

    def __len__(self) -> int:
        return len(self._trees)

    def is_running(self, number: int) -> bool:
        """Whether the last tick of a child said so, and it was not halted since."""
        return number in self._running

    def tick(self, number: int) -> str:
        """Tick one child.

        Raises:
            PolicyError: BehaviorTree.CPP cannot go on with it.
        """
        self._above.append((self, number))
        try:
            status = tick_tree(self._trees[number])
        finally:
            self._above.pop()
        (self._running.add if status == "RUNNING" else self._running.discard)(number)
        return status

    def may_go_back(self) -> bool:
        """Whether a node may tick a child again in this tick: nodes in one another would for ever."""
        self._nesting.retries += 1
        return self._nesting.retries <= MAX_WAKE_UPS

    def keep(self, begin_anew: Callable[[], None]) -> None:
        """Their node has ended, and goes on until the one around it halts it, which calls ``begin_anew``."""
        around, number = self._above[-1]
        around._kept[number] = begin_anew

    def halt(self, number: int) -> None:
        """Halt one child, if it is running, and have it start anew in any case.

        Raises:
            PolicyError: a script of it cannot be run.
        """
        begin_anew = self._kept.pop(number, None)
        if begin_anew is not None:
            begin_anew()
        if number in self._running:
            self._running.discard(number)
            self._above.append((self, number))
            try:
                halt_tree(self._trees[number])
            finally:
                self._above.pop()

    def halt_all(self) -> None:
        """Halt those that are running: a node that has ended leaves none of its children running."""
        for number in sorted({*self._running, *self._kept}):
            self.halt(number)
