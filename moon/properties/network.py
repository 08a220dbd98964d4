"""Formulas as one network of nodes: equal sub-formulas, of one or of many formulas, are one node.

Everything is reduced to six kinds: constants, atoms, ``not``, ``and``, ``once`` and ``since`` (``or``,
``->`` and ``historically`` are their duals), so that also dual sub-formulas are shared.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal as OneOf

import msgspec

from moon.properties.formula import (
    And,
    Constant,
    Formula,
    Historically,
    Implies,
    Interval,
    Not,
    Once,
    Or,
    Predicate,
    Rise,
    Since,
    written_out,
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
        by_polarity: split every atom ``p`` into ``+p`` where its truth helps the formula and ``-p``
            where it harms, so that an unknown value can be taken at its best and at its worst.
        in_steps: time is discrete: ``since`` has its usual meaning.
    """
    builder = NetworkBuilder(by_polarity, in_steps)
    roots = tuple(builder.node(formula, True) for formula in formulas)
    return Network(tuple(builder.nodes), roots)


class NetworkBuilder:
    """Adds nodes, equal ones once."""

    def __init__(self, by_polarity: bool, in_steps: bool = False) -> None:
        self._since_text = IN_STEPS if in_steps else ""
        self.nodes: list[Node] = []
        self._index: dict[Node, int] = {}
        self._known: dict[tuple[int, bool], tuple[Formula, int]] = {}
        self._by_polarity = by_polarity

    def add(self, node: Node) -> int:
        """The index of ``node``."""
        found = self._index.get(node)
        if found is None:
            found = self._index[node] = len(self.nodes)
            self.nodes.append(node)
        return found

    def node(self, formula: Formula, positive: bool) -> int:
        """The index of the node of ``formula``."""
        key = (id(formula), positive)
        known = self._known.get(key)
        if known is None:
            # the formula is kept beside its node: its id stays its own
            known = self._known[key] = (formula, self._node(formula, positive))
        return known[1]

    def _node(self, formula: Formula, positive: bool) -> int:
        match formula:
            case Constant(value=value):
                return self.add(Node("constant", text="true" if value else "false"))
            case Predicate(text=text):
                sign = ("+" if positive else "-") if self._by_polarity else ""
                return self.add(Node("atom", text=sign + text))
            case Not(operand=inner):
                return self.negate(self.node(inner, not positive))
            case And(operands=operands):
                return self.conjoin(self.node(item, positive) for item in operands)
            case Or(operands=operands):
                return self.negate(
                    self.conjoin(self.negate(self.node(item, positive)) for item in operands)
                )
            case Implies(left=left, right=right):
                before = self.node(left, not positive)
                return self.negate(self.conjoin((before, self.negate(self.node(right, positive)))))
            case Once(operand=inner, interval=interval):
                return self.add(Node("once", (self.node(inner, positive),), interval))
            case Historically(operand=inner, interval=interval):
                never = self.negate(self.node(inner, positive))
                return self.negate(self.add(Node("once", (never,), interval)))
            case Rise():
                return self.node(written_out(formula), positive)
            case Since(left=left, right=right, interval=interval):
                pair = (self.node(left, positive), self.node(right, positive))
                return self.add(Node("since", pair, interval, self._since_text))

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
