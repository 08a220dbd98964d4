"""Attributes that are no ports: which of them BehaviorTree.CPP reads, and which it ignores.

A name that begins with ``_`` is no port's. The library reads its own (``CONDITIONS``, and ``_autoremap`` of a
sub-tree) and ignores all others, so editors keep there what is theirs.
"""

from __future__ import annotations

import difflib

from m2c.diagnostics import DiagnosticLog
from m2c.model.xml import Element
from m2c.policy.tree import AUTOREMAP, BUILTINS, CONDITIONS
from m2c.suggestions import nearest

_OF_ROOT = ("main_tree_to_execute", "BTCPP_format")
_OF_TREE = ("ID", "name")
_ALIKE = 0.8
"""From here on a name is that of a script misspelt (``difflib``'s measure, from 0 to 1)."""


def is_ignored(
    element: Element, written: str, log: DiagnosticLog, known: tuple[str, ...] = CONDITIONS
) -> bool:
    """Whether BehaviorTree.CPP ignores the attribute ``written`` of ``element``.

    Args:
        element: of a tree.
        written: the attribute's name.
        log: gets the warning ``ignored-attribute`` if it looks as if it should have a meaning.
        known: the names with ``_`` that mean something there.
    """
    if not written.startswith("_") or written in known:
        return False
    near = difflib.get_close_matches(written, known, 1, _ALIKE)
    if near:
        _warn(element, written, f"did you mean {near[0]}?", log)
    elif written == AUTOREMAP:
        _warn(element, written, "only a <SubTree> has it", log)
    return True


def check_tree_attributes(element: Element, log: DiagnosticLog) -> None:
    """Report what a ``<BehaviorTree>`` cannot have: ``unknown-attribute``, and ``ignored-attribute``."""
    for written in element.attributes:
        if written in CONDITIONS:
            _warn(element, written, "write it on the tree's root node", log)
        elif written not in _OF_TREE and not is_ignored(element, written, log, ()):
            what = f"a tree has no `{written}`"
            hint = _where(element, written)
            log.error("unknown-attribute", element.at(written), element.tag, what, hint)


def _where(element: Element, written: str) -> str:
    """What to do with an attribute that a tree does not have."""
    if written in _OF_ROOT:
        return "write it on <root>"
    root = next((BUILTINS[child.tag] for child in element.all(*BUILTINS)), None)
    if root is not None and written in root.ports:
        return "write it on the tree's root node"
    near = nearest(written, _OF_TREE)
    return near if near.startswith("did you mean") else "remove it; a tree has ID"


def _warn(element: Element, written: str, hint: str, log: DiagnosticLog) -> None:
    what = f"BehaviorTree.CPP ignores `{written}` here"
    log.warning("ignored-attribute", element.at(written), element.tag, what, hint)
