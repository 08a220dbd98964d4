"""Trees that halt as AS2FM's do, in place of BehaviorTree.CPP's: to show that a result differs for this alone.

A node of BehaviorTree.CPP that ends, or that waits for one of its children, halts those others that are running.
AS2FM's halts all others, whether they have started or not.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import behaviortreepy
import pytest

from m2c.policy.plugin_leaf import PluginLeaf
from m2c.policy.ticks import LeafTick

SUCCESS, FAILURE, RUNNING = (
    behaviortreepy.NodeStatus.SUCCESS,
    behaviortreepy.NodeStatus.FAILURE,
    behaviortreepy.NodeStatus.RUNNING,
)
_OPPOSITE = {SUCCESS: FAILURE, FAILURE: SUCCESS}
_GOES_ON_AFTER = {
    "Sequence": SUCCESS,
    "ReactiveSequence": SUCCESS,
    "Fallback": FAILURE,
    "ReactiveFallback": FAILURE,
}


def use_trees(monkeypatch: pytest.MonkeyPatch, halts_all: bool) -> None:
    """Have policies run by the trees of this module.

    Args:
        monkeypatch: undoes it.
        halts_all: whether children that are not running are halted, too, as in AS2FM.
    """
    monkeypatch.setattr(behaviortreepy, "BehaviorTreeFactory", lambda: _Factory(halts_all))
    if halts_all:  # a leaf that was never ticked may be halted

        def halt(leaf: PluginLeaf, node: Any, record: LeafTick) -> None:
            leaf._place_of(node).halt(record)

        monkeypatch.setattr(PluginLeaf, "halt", halt)


class _Factory:
    """What the policy runner needs of a ``behaviortreepy.BehaviorTreeFactory``."""

    def __init__(self, halts_all: bool) -> None:
        self._halts_all = halts_all
        self._leaves: dict[str, tuple[Callable[[Any], Any], Callable[[Any], None]]] = {}
        self._xml = ""

    def register_simple_stateful_action(
        self, name: str, start: Callable[..., Any], _: object, halt: Callable[..., None]
    ) -> None:
        self._leaves[name] = (start, halt)

    def register_simple_condition(self, name: str, tick: Callable[[Any], Any]) -> None:
        self._leaves[name] = (tick, lambda _: None)

    def register_behavior_tree_from_text(self, xml: str) -> None:
        self._xml = xml

    def create_tree(self, name: str) -> _Tree:
        found = ElementTree.fromstring(self._xml).find(f"BehaviorTree[@ID='{name}']")
        assert found is not None
        return _Tree(self._node(found[0]))

    def _node(self, element: ElementTree.Element) -> _Node:
        children = [self._node(child) for child in element]
        if element.tag in self._leaves:
            return _Leaf(*self._leaves[element.tag])
        if element.tag in _GOES_ON_AFTER:
            remembers = not element.tag.startswith("Reactive")
            return _Row(children, _GOES_ON_AFTER[element.tag], remembers, self._halts_all)
        match element.tag:
            case "AlwaysSuccess":
                return _Constant(SUCCESS)
            case "AlwaysFailure":
                return _Constant(FAILURE)
            case "Inverter":
                return _Inverter(children[0])
            case "Repeat":
                return _Repeat(children[0], int(element.attrib["num_cycles"]), self._halts_all)
        raise NotImplementedError(element.tag)


class _Tree:
    """What the policy runner needs of a ``behaviortreepy.Tree``."""

    def __init__(self, root: _Node) -> None:
        self._root = root

    def tick_exactly_once(self) -> Any:
        return self._root.tick()

    def sleep(self, _: float) -> bool:
        return False


class _Node:
    """A node of a tree; ``is_running``: its last tick said so, and it was not halted since."""

    is_running = False

    def tick(self) -> Any:
        status = self._tick()
        self.is_running = status is RUNNING
        return status

    def halt(self) -> None:
        self.is_running = False
        self._halt()

    def _tick(self) -> Any:
        raise NotImplementedError

    def _halt(self) -> None:
        pass


class _Leaf(_Node):
    def __init__(self, tick: Callable[[Any], Any], halt: Callable[[Any], None]) -> None:
        self._ticked, self._halted = tick, halt
        self._node = SimpleNamespace(config=lambda: SimpleNamespace(blackboard=None))

    def _tick(self) -> Any:
        return self._ticked(self._node)

    def _halt(self) -> None:
        self._halted(self._node)


class _Constant(_Node):
    def __init__(self, status: Any) -> None:
        self._status = status

    def _tick(self) -> Any:
        return self._status


class _Inverter(_Node):
    def __init__(self, child: _Node) -> None:
        self._child = child

    def _tick(self) -> Any:
        status = self._child.tick()
        return _OPPOSITE.get(status, status)

    def _halt(self) -> None:
        self._child.halt()


class _Row(_Node):
    """A sequence or a fallback, reactive (it begins anew with each tick) or not."""

    def __init__(
        self, children: list[_Node], goes_on_after: Any, remembers: bool, halts_all: bool
    ) -> None:
        self._children = children
        self._goes_on_after = goes_on_after
        self._remembers = remembers
        self._halts_all = halts_all
        self._at = 0

    def _tick(self) -> Any:
        self._at = self._at if self._remembers else 0
        status = self._goes_on_after
        while self._at < len(self._children):
            status = self._children[self._at].tick()
            if status is not self._goes_on_after:
                break
            self._at += 1
        if status is not RUNNING:
            self._halt()
        elif not self._remembers:
            self._halt_but(self._children[self._at])
        return status

    def _halt(self) -> None:
        self._at = 0
        self._halt_but(None)

    def _halt_but(self, running: _Node | None) -> None:
        for child in self._children:
            if child is not running and (self._halts_all or child.is_running):
                child.halt()


class _Repeat(_Node):
    def __init__(self, child: _Node, cycles: int, halts_all: bool) -> None:
        self._child = child
        self._cycles = cycles
        self._halts_all = halts_all
        self._done = 0

    def _tick(self) -> Any:
        while self._done < self._cycles:
            status = self._child.tick()
            if status is RUNNING:
                return RUNNING
            if self._halts_all:
                self._child.halt()
            if status is FAILURE:
                self._done = 0
                return FAILURE
            self._done += 1
        self._done = 0
        return SUCCESS

    def _halt(self) -> None:
        self._done = 0
        if self._halts_all or self._child.is_running:
            self._child.halt()
