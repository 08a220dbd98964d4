"""Elements of a policy that may be plugins, where its system is not known."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator

from m2c.model.xml import Element
from m2c.policy.declared import MODEL
from m2c.policy.tree import BUILTINS

EXPLICIT = ("Action", "Condition", "Control", "Decorator")
"""Elements whose type is their ``ID``."""
_ALIKE = 0.8
"""From here on a name is that of a control node misspelt (``difflib``'s measure, from 0 to 1)."""


def perhaps_plugins(elements: Iterable[Element]) -> dict[str, bool]:
    """The elements that may be plugins of a system, and whether they have children here.

    What is almost called as a control node is that node misspelt.

    Args:
        elements: of a policy, with those of the files that it includes.
    """
    found: dict[str, bool] = {}
    for element in _nodes(elements):
        is_explicit = element.tag in EXPLICIT
        tag = element.get("ID") if is_explicit else element.tag
        if is_explicit and not element.children:
            continue  # a leaf, whoever answers it
        near = difflib.get_close_matches(tag, (*BUILTINS, "SubTree"), 1, _ALIKE)
        if tag and not near:
            found[tag] = found.get(tag, True) and bool(element.children)
    return found


def _nodes(elements: Iterable[Element]) -> Iterator[Element]:
    for tree in elements:
        if tree.tag != MODEL:
            yield from _below(tree)


def _below(element: Element) -> Iterator[Element]:
    for child in element.children:
        yield child
        yield from _below(child)
