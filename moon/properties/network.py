"""Formulas as one network of nodes: equal sub-formulas, of one or of many formulas, are one node.

Formulas are reduced to six kinds first (:func:`moon.properties.formula.reduced`), so that also dual
sub-formulas are shared. Nodes of two kinds, ``once`` and ``since``, remember: each has variables, and
an update rule that brings them to an instant.
"""

from __future__ import annotations

from collections.abc import Iterable
from textwrap import indent
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

NEVER = 1 << 70
"""Later than every stamp; sums with bounds stay later."""

Kind = OneOf["constant", "atom", "not", "and", "once", "since"]


class Node(msgspec.Struct, frozen=True):
    """One node; ``inputs`` are indices of earlier nodes (the list is in topological order)."""

    kind: Kind
    inputs: tuple[int, ...] = ()
    interval: Interval = Interval()
    text: str = ""
    """Of an atom: the predicate's text; of a constant: ``true`` or ``false``."""


class Network(msgspec.Struct, frozen=True):
    """Nodes and which of them are the formulas'."""

    nodes: tuple[Node, ...]
    roots: tuple[int, ...]

    @property
    def atoms(self) -> tuple[str, ...]:
        """The predicates' texts, in order of their nodes."""
        return tuple(node.text for node in self.nodes if node.kind == "atom")

    def reached(self) -> set[int]:
        """The roots, and every node on which one depends."""
        found = set(self.roots)
        for index in range(len(self.nodes) - 1, -1, -1):  # a node comes after its inputs
            if index in found:
                found.update(self.nodes[index].inputs)
        return found

    def cone(self, starts: Iterable[int]) -> list[int]:
        """``starts`` and every node that depends on them, in topological order."""
        reached = set(starts)
        for index, node in enumerate(self.nodes):
            if any(item in reached for item in node.inputs):
                reached.add(index)
        return sorted(reached)


def build_network(formulas: Iterable[Formula], by_polarity: bool = False) -> Network:
    """The network of ``formulas``.

    Args:
        formulas: one root each.
        by_polarity: split every atom by whether its truth helps the formula.
    """
    builder = NetworkBuilder()
    roots = tuple(builder.node(reduced(formula, by_polarity)) for formula in formulas)
    return Network(tuple(builder.nodes), roots)


class NetworkBuilder:
    """Adds nodes, equal ones once."""

    def __init__(self) -> None:
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
                return self.add(Node("since", pair, interval))
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


# -- nodes that remember ----------------------------------------------------------------------
#
# In an update rule ``#`` stands for the node's number, ``<P>`` and ``<Q>`` for its inputs' values, ``<A>``
# and ``<B>`` for its bounds. Each rule is constant work (amortised over the intervals that it drops).

_STATE = {
    "ever": ("l",),
    "lower": ("l",),
    "upper": ("c", "l", "e"),
    "both": ("c", "l", "s", "q"),
    "since": ("s",),
    "since_lower": ("l", "z"),
    "since_upper": ("c", "z", "l", "e"),
    "since_both": ("c", "z", "l", "s", "q"),
}
INITIAL = {
    **{"c": "False", "z": "False", "v": "False", "e": "-1", "q": "deque()"},
    "l": str(NEVER),
    "s": "False",
}


def mode(node: Node) -> str:
    """Which of the update rules a remembering node follows."""
    lower, upper = node.interval.lower, node.interval.upper
    if node.kind == "once":
        if upper is None:
            return "lower" if lower else "ever"
        return "both" if lower else "upper"
    if upper is None:
        return "since_lower" if lower else "since"
    return "since_both" if lower else "since_upper"


def state_names(index: int, node: Node) -> tuple[str, ...]:
    """The variables of a remembering node."""
    return tuple(f"{letter}{index}" for letter in _STATE[mode(node)])


def stays_false(network: Network, root: int) -> bool:
    """Whether the root, once false, stays false: it says that something has never happened."""
    node = network.nodes[root]
    if node.kind == "constant":
        return True
    if node.kind == "and":
        return all(stays_false(network, item) for item in node.inputs)
    if node.kind != "not":
        return False
    inner = network.nodes[node.inputs[0]]
    return inner.kind == "once" and mode(inner) in ("ever", "lower")


def obligations(network: Network) -> list[int]:
    """The nodes that remember whether a root was false at any time: what it says has never happened.

    Not those that other formulas, or other parts of these, look at as well.
    """
    found: list[int] = []
    path: set[int] = set()
    todo = [(root, False) for root in network.roots]
    while todo:
        index, negated = todo.pop()
        node = network.nodes[index]
        if node.kind == "not":
            todo.append((node.inputs[0], not negated))
        elif node.kind == "and" and not negated:
            todo.extend((item, negated) for item in node.inputs)
        elif node.kind == "once" and negated and mode(node) in ("ever", "lower"):
            found.append(index)
        else:
            continue
        path.add(index)
    others = {
        item
        for index in network.reached()
        if index not in path or index in found
        for item in network.nodes[index].inputs
    }
    for index in sorted(path, reverse=True):  # a node comes after its inputs
        if index in others and index not in found:
            others.update(network.nodes[index].inputs)
    return [index for index in found if index not in others]


_SPELLS = """\
if <P>:
    if not c#:
        c# = True
        l# = t
        if q# and q#[-1][1] >= t + <A>:
            s# = q#.pop()[0]
        else:
            s# = t + <A>
            heappush(heap, (s#, #))
elif c#:
    c# = False
    q#.append((s#, (t if t > l# else t + 1) + <B>))
    heappush(heap, (q#[-1][1], #))
"""
"""Where a spell of ``<P>`` begins or ends; ``q#`` keeps from when until when each is in the bounds."""

_IN_BOUNDS = """\
while q# and q#[0][1] <= t:
    q#.popleft()
v# = q#[0][0] <= t if q# else c# and s# <= t
"""
"""Whether one of them is, now."""

UPDATES = {
    "ever": """
if l# == <NEVER> and <P>:
    l# = t
""",
    "lower": """
if l# == <NEVER> and <P>:
    l# = t
    heappush(heap, (t + <A>, #))
v# = t >= l# + <A>
""",
    "upper": """
if <P>:
    if not c#:
        c# = True
        l# = t
    v# = True
else:
    if c#:
        c# = False
        e# = (t if t > l# else t + 1) + <B>
        if e# > t:
            heappush(heap, (e#, #))
    v# = t < e#
""",
    "both": "\n" + _SPELLS + _IN_BOUNDS,
    "since": """
h = <P>
s# = <Q> or (h and s#)
v# = h and s#
""",
    "since_lower": """
if <P>:
    if l# == <NEVER> and (z# or <Q>):
        l# = t
        heappush(heap, (t + <A>, #))
    z# = False
    v# = t >= l# + <A>
else:
    l# = <NEVER>
    z# = <Q>
    v# = False
""",
    "since_upper": """
if <P>:
    if <Q>:
        if not c#:
            c# = True
            l# = t
        v# = True
    else:
        if c#:
            c# = False
            e# = (t if t > l# else t + 1) + <B>
            if e# > t:
                heappush(heap, (e#, #))
        elif z#:
            e# = t + <B>
            if e# > t:
                heappush(heap, (e#, #))
        v# = t < e#
    z# = False
else:
    c# = False
    z# = <Q>
    e# = -1
    v# = False
""",
    "since_both": "\nif <P>:\n"
    + indent(_SPELLS.replace("<P>", "<Q>"), "    ")
    + """    elif z# and <A> < <B>:
        q#.append((t + <A>, t + <B>))
        heappush(heap, (t + <A>, #))
        heappush(heap, (t + <B>, #))
    z# = False
"""
    + indent(_IN_BOUNDS, "    ")
    + """else:
    q#.clear()
    c# = False
    z# = <Q>
    v# = False
""",
}
"""Per mode, what brings a node to ``t``; ``v#`` (or what is read instead) is its value then."""
