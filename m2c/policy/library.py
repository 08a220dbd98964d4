"""BehaviorTree.CPP, called so that nothing in a tree ends the process.

The library halts all nodes of a tree that is thrown away, those that do not run as well, and so runs their
``_onHalted`` scripts in a destructor. A script that fails there ends the process (SIGABRT), and whether it
would cannot be known before. So trees of a policy with such scripts are kept as long as the process lives.
"""

from __future__ import annotations

import ctypes
import re
from collections.abc import Callable
from typing import Any

ON_HALTED = "_onHalted"

LIBRARY_ERRORS = (RuntimeError, ValueError, IndexError, OverflowError, MemoryError)
"""What pybind11 makes of the exceptions of C++."""

_REASONS = {
    "stod": "a number is out of range",
    "bad_function_call": "a script is empty where its value is needed",
}
"""What the library says of some of them, and what is meant."""


_LINE = re.compile(r"Error at line [0-9]+: -> ")


class PolicyError(Exception):
    """BehaviorTree.CPP refuses the tree, or cannot go on with it; the text says why."""


class TreeFactory:
    """Makes the trees of one policy; a ``behaviortreepy.BehaviorTreeFactory`` with its leaves."""

    def __init__(self) -> None:
        import behaviortreepy

        self._factory: Any = behaviortreepy.BehaviorTreeFactory()
        self._keeps = False

    def register(
        self,
        leaf: str,
        tick: Callable[[Any], Any],
        halt: Callable[[Any], None] | None = None,
    ) -> None:
        """Have ``tick`` called for ``leaf``, the name of an element, with its node.

        Args:
            leaf: before any :meth:`load` that names it.
            tick: returns the status.
            halt: called when it is halted; None: it cannot be RUNNING.

        Raises:
            PolicyError: BehaviorTree.CPP has another use for that name.
        """
        try:
            if halt is None:
                self._factory.register_simple_condition(leaf, tick)
            else:
                self._factory.register_simple_stateful_action(leaf, tick, tick, halt)
        except LIBRARY_ERRORS as error:
            raise _refused(error) from error

    def load(self, xml: str) -> None:
        """Take in the trees of ``xml``.

        Raises:
            PolicyError: BehaviorTree.CPP refuses them.
        """
        self._keeps = self._keeps or ON_HALTED in xml
        try:
            self._factory.register_behavior_tree_from_text(xml)
        except LIBRARY_ERRORS as error:
            raise _refused(error) from error

    def create_tree(self, name: str, *board: Any) -> Any:
        """The tree ``name``, a ``behaviortreepy.Tree``; on the blackboard ``board``, if one is given.

        Raises:
            PolicyError: BehaviorTree.CPP refuses it.
        """
        try:
            tree = self._factory.create_tree(name, *board)
        except LIBRARY_ERRORS as error:
            raise _refused(error) from error
        if self._keeps:
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(tree))
        return tree


def halt_tree(tree: Any) -> None:
    """Halt ``tree``, a ``behaviortreepy.Tree``.

    Raises:
        PolicyError: a script of it cannot be run; some of its nodes may not be halted.
    """
    try:
        tree.halt_tree()
    except LIBRARY_ERRORS as error:
        raise PolicyError(f"the tree cannot be halted: {reason_of(error)}") from error


def reason_of(error: BaseException) -> str:
    """What the library says, in one line and without the lines of an XML that nobody wrote."""
    text = _LINE.sub("", " ".join(str(error).split()))
    return _REASONS.get(text, text)


def _refused(error: BaseException) -> PolicyError:
    return PolicyError(f"BehaviorTree.CPP refuses the policy: {reason_of(error)}")
