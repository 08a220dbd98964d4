"""Formulas as one network of nodes: equal sub-formulas, of one or of many formulas, are one node.

Formulas are reduced to six kinds first (:func:`moon.properties.formula.reduced`), so that also dual
sub-formulas are shared.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal as OneOf

import msgspec

from moon.properties.formula import (
    And,
    Constant,
    Formula,
    Interval,
    Not,
    Once,
    Predicate,
    Since,
    reduced,
)

IN_STEPS = "steps"
"""The text of ``since`` nodes that have their usual meaning in discrete time."""

Kind = OneOf["constant", "atom", "not", "and", "once", "since"]


class Node(msgspec.Struct, frozen=True):
    """One node; ``inputs`` are indices of earlier nodes (the list is in topological order)."""

    kind: Kind
    inputs: tuple[int, ...] = ()
    interval: Interval = Interval()
    text: str = ""
    """Of an atom: the predicate's text; of a constant: ``true`` or ``false``; of ``since``: the rule."""


class Network(msgspec.Struct, frozen=True):
    """Nodes and which of them are the formulas'."""

    nodes: tuple[Node, ...]
    roots: tuple[int, ...]

    @property
    def atoms(self) -> tuple[str, ...]:
        """The predicates' texts, in order of their nodes."""
        return tuple(node.text for node in self.nodes if node.kind == "atom")

    def cone(self, starts: Iterable[int]) -> list[int]:
        """``starts`` and every node that depends on them, in topological order."""
        reached = set(starts)
        for index, node in enumerate(self.nodes):
            if any(item in reached for item in node.inputs):
                reached.add(index)
        return sorted(reached)


def build_network(
    formulas: Iterable[Formula], by_polarity: bool = False, in_steps: bool = False
) -> Network:
    """The network of ``formulas``.

    Args:
        formulas: one root each.
        by_polarity: split every atom by whether its truth helps the formula.
        in_steps: time is discrete: ``since`` has its usual meaning.
    """
    builder = NetworkBuilder(in_steps)
    roots = tuple(builder.node(reduced(formula, by_polarity)) for formula in formulas)
    return Network(tuple(builder.nodes), roots)


class NetworkBuilder:
    """Adds nodes, equal ones once."""

    def __init__(self, in_steps: bool = False) -> None:
        self._since_text = IN_STEPS if in_steps else ""
        self.nodes: list[Node] = []
        self._index: dict[Node, int] = {}
        self._known: dict[int, tuple[Formula, int]] = {}

    def add(self, node: Node) -> int:
        """The index of ``node``."""
        found = self._index.get(node)
        if found is None:
            found = self._index[node] = len(self.nodes)
            self.nodes.append(node)
        return found

    def node(self, formula: Formula) -> int:
        """The index of the node of ``formula``, which is reduced."""
        known = self._known.get(id(formula))
        if known is None:
            # the formula is kept beside its node: its id stays its own
            known = self._known[id(formula)] = (formula, self._node(formula))
        return known[1]

    def _node(self, formula: Formula) -> int:
        match formula:
            case Constant(value=value):
                return self.add(Node("constant", text="true" if value else "false"))
            case Predicate(text=text):
                return self.add(Node("atom", text=text))
            case Not(operand=inner):
                return self.negate(self.node(inner))
            case And(operands=operands):
                return self.conjoin(map(self.node, operands))
            case Once(operand=inner, interval=interval):
                return self.add(Node("once", (self.node(inner),), interval))
            case Since(left=left, right=right, interval=interval):
                pair = (self.node(left), self.node(right))
                return self.add(Node("since", pair, interval, self._since_text))
        raise TypeError(f"not reduced: {formula!r}")

    def negate(self, index: int) -> int:
        """The node that is true where ``index`` is not."""
        node = self.nodes[index]
        if node.kind == "not":
            return node.inputs[0]
        if node.kind == "constant":
            return self.add(Node("constant", text="false" if node.text == "true" else "true"))
        return self.add(Node("not", (index,)))

    def conjoin(self, inputs: Iterable[int]) -> int:
        """The node that is true where all ``inputs`` are."""
        kept: set[int] = set()
        for index in inputs:
            node = self.nodes[index]
            if node.kind == "constant":
                if node.text == "false":
                    return index
            elif node.kind == "and":
                kept.update(node.inputs)
            else:
                kept.add(index)
        if any(
            self.nodes[index].kind == "not" and self.nodes[index].inputs[0] in kept
            for index in kept
        ):
            return self.add(Node("constant", text="false"))
        if not kept:
            return self.add(Node("constant", text="true"))
        return kept.pop() if len(kept) == 1 else self.add(Node("and", tuple(sorted(kept))))
