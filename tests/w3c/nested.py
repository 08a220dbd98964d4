"""Machines of compound states made at random, and W3C's algorithm on their tree (SCXML, appendix D).

The algorithm is written down as W3C has it, with sets of states and without parallel ones; nothing here
knows that machines are lowered.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Iterator

from tests.w3c.both import probe, say

MOST = 60
"""Microsteps of one macrostep; a machine with more is not used: it may never end."""


class Endless(Exception):
    """The machine does not come to rest."""


class Node:
    """A state, or a history, of the tree."""

    def __init__(self, name: str, parent: Node | None) -> None:
        self.name, self.parent = name, parent
        self.kind = "state"  # final, shallow, deep
        self.inner: list[Node] = []
        self.histories: list[Node] = []
        self.entry: list[Content] = []
        self.exit: list[Content] = []
        self.ways: list[Way] = []
        self.initial: Way | None = None

    def enters(self) -> Way:
        """What leads into it, or from a history that remembers nothing."""
        assert self.initial is not None
        return self.initial

    def around(self) -> list[Node]:
        """What it stands in, from the inside out; the machine is the last."""
        return [] if self.parent is None else [self.parent, *self.parent.around()]

    def all(self) -> Iterator[Node]:
        """The states in it, in document order."""
        for node in self.inner:
            yield node
            yield from node.all()


class Content:
    """Says a number; adds to ``n``; raises an event; says another number in a state."""

    def __init__(self, number: int, adds: int, raises: str, where: str) -> None:
        self.number, self.adds, self.raises, self.where = number, adds, raises, where

    def xml(self) -> str:
        parts = [say(self.number)]
        if self.adds:
            parts.append(f'<assign location="n" expr="n + {self.adds}"/>')
        if self.raises:
            parts.append(f'<raise event="{self.raises}"/>')
        if self.where:
            parts.append(f"<if cond=\"In('{self.where}')\">{say(-self.number)}</if>")
        return "".join(parts)


class Way:
    """A transition; ``remainder``: it holds where that is left of ``n`` by 3; ``where``: in that state."""

    def __init__(self, event: str, target: Node | None, content: list[Content]) -> None:
        self.event, self.target, self.content = event, target, content
        self.remainder: int | None = None
        self.where = ""
        self.internal = False
        self.is_written = True
        self.after_ms = 0

    def to(self) -> Node:
        """Where it leads; it has a target."""
        assert self.target is not None
        return self.target

    def xml(self) -> str:
        tests = [] if self.remainder is None else [f"n % 3 == {self.remainder}"]
        tests += [f"In('{self.where}')"] if self.where else []
        given = {"event": self.event, "cond": " &amp;&amp; ".join(tests)}
        given["target"] = self.target.name if self.target else ""
        given["after"] = f"{self.after_ms}ms" if self.after_ms else ""
        given["type"] = "internal" if self.internal else ""
        written = "".join(f' {key}="{value}"' for key, value in given.items() if value)
        return f"<transition{written}>{''.join(item.xml() for item in self.content)}</transition>"


class Made:
    """A machine made from ``seed``."""

    def __init__(self, seed: int) -> None:
        self._draw = random.Random(seed)
        self._number = 0
        self._names = 0
        self.root = Node("", None)
        self._grow(self.root, self._draw.choice((1, 2, 3)))
        self.nodes = list(self.root.all())
        self.histories = [item for node in self.nodes for item in node.histories]
        for node in self.nodes:
            self._fill(node)
        self.starts_in = self._draw.choice(self.nodes)

    def _is(self, probability: float) -> bool:
        return self._draw.random() < probability

    def _name(self) -> str:
        self._names += 1
        return f"s{self._names}"

    def _grow(self, node: Node, deep: int) -> None:
        for _ in range(self._draw.choice((1, 2, 3))):
            inner = Node(self._name(), node)
            node.inner.append(inner)
            if deep and self._is(0.6):
                self._grow(inner, deep - 1)
                for kind in ("shallow", "deep"):
                    if self._is(0.3):
                        history = Node(self._name(), inner)
                        history.kind = kind
                        inner.histories.append(history)
            elif self._is(0.2) and node.parent is not None:
                inner.kind = "final"

    def _content(self, probability: float = 0.6) -> list[Content]:
        found = []
        while self._is(probability) and len(found) < 2:
            self._number += 1
            where = self._draw.choice(self.nodes).name if self._is(0.2) else ""
            raises = self._draw.choice(("r", "r.x")) if self._is(0.15) else ""
            found.append(Content(self._number, int(self._is(0.5)), raises, where))
        return found

    def _fill(self, node: Node) -> None:
        draw = self._draw
        node.entry, node.exit = self._content(), self._content()
        if node.inner:
            targets = [*node.all(), *node.histories]
            targets += [item for inner in node.all() for item in inner.histories]
            node.initial = Way("", draw.choice(targets), self._content(0.4))
            if self._is(0.3):
                node.initial = Way("", node.inner[0], [])
                node.initial.is_written = False
        for history in node.histories:
            history.initial = Way("", draw.choice(list(node.all())), self._content(0.5))
        if node.kind == "final":
            return
        events = ("a", "b", "a b", "c", "r", "r.x", "*", "done.state", "")
        for _ in range(draw.choice((0, 1, 2, 3))):
            event = draw.choice(events)
            target = draw.choice([*self.nodes, *self.histories]) if self._is(0.8) else None
            way = Way(event, target, self._content())
            way.internal = self._is(0.3)
            if self._is(0.3) or not event:
                way.remainder = draw.choice((0, 1, 2))
            if self._is(0.2):
                way.where = draw.choice(self.nodes).name
            if self._is(0.15):
                self._number += 1
                way.event, way.after_ms = "", 1000 + 7 * self._number
            node.ways.append(way)

    def text(self) -> str:
        """The model."""
        data = '<datamodel><data id="n" type="int32" expr="0"/></datamodel>'
        model = probe(data + "".join(map(self._xml, self.root.inner)))
        return model.replace("<scxml ", f'<scxml initial="{self.starts_in.name}" ', 1)

    def _xml(self, node: Node) -> str:
        tag = "final" if node.kind == "final" else "state"
        parts = []
        for name, content in (("onentry", node.entry), ("onexit", node.exit)):
            parts += [f"<{name}>{item.xml()}</{name}>" for item in content]
        if node.initial is not None and node.initial.is_written:
            parts.append(f"<initial>{node.initial.xml()}</initial>")
        for history in node.histories:
            head = f'<history id="{history.name}" type="{history.kind}">'
            parts.append(f"{head}{history.enters().xml()}</history>")
        ways = [way.xml() for way in node.ways]
        inner = [*ways, *map(self._xml, node.inner)]
        return f'<{tag} id="{node.name}">{"".join([*parts, *inner])}</{tag}>'


class Algorithm:
    """W3C's algorithm on the tree of a machine; ``said``: all numbers."""

    def __init__(self, made: Made) -> None:
        self.said: list[int] = []
        self._order = {node: place for place, node in enumerate(made.root.all())}
        self._root = made.root
        self._n = 0
        self._active: set[Node] = set()
        self._values: dict[Node, Node] = {}
        self._queue: deque[str] = deque()
        self._now_ms = 0
        self._due: dict[Way, int] = {}
        self._enter(Way("", made.starts_in, []), self._root)
        self._complete()

    @property
    def state(self) -> str:
        """The path of the active atomic state."""
        chain = [self._leaf, *self._leaf.around()[:-1]]
        return "/".join(node.name for node in reversed(chain))

    @property
    def _leaf(self) -> Node:
        return next(node for node in self._active if not node.inner)

    def wait(self, milliseconds: int) -> None:
        """Let time pass."""
        end = self._now_ms + milliseconds
        while self._due and min(self._due.values()) <= end:
            way = min(self._due, key=self._due.__getitem__)
            self._now_ms = self._due.pop(way)
            self.take(way)
        self._now_ms = end

    def take(self, event: str | Way) -> None:
        """Send an event from outside; or the delay of a transition is over."""
        found = self._selected(event)
        if found:
            self._step(*found)
        self._complete()

    def _complete(self) -> None:
        for _ in range(MOST):
            found = self._selected("")
            if not found:
                if not self._queue:
                    return
                found = self._selected(self._queue.popleft())
            if found:
                self._step(*found)
        raise Endless

    def _selected(self, event: str | Way) -> tuple[Node, Way] | None:
        for node in (self._leaf, *self._leaf.around()):
            for way in node.ways:
                if self._matches(way, event) and self._holds(way):
                    return node, way
        return None

    @staticmethod
    def _matches(way: Way, event: str | Way) -> bool:
        if way.after_ms or isinstance(event, Way):
            return way is event
        if not event or not way.event:
            return event == way.event
        return any(
            item == "*" or event == item or event.startswith(f"{item}.")
            for item in way.event.split()
        )

    def _holds(self, way: Way) -> bool:
        return (way.remainder is None or self._n % 3 == way.remainder) and (
            not way.where or self._is_in(way.where)
        )

    def _is_in(self, name: str) -> bool:
        return any(node.name == name for node in self._active)

    def _run(self, content: list[Content]) -> None:
        for item in content:
            self.said.append(item.number)
            self._n += item.adds
            if item.raises:
                self._queue.append(item.raises)
            if item.where and self._is_in(item.where):
                self.said.append(-item.number)

    def _step(self, source: Node, way: Way) -> None:
        if way.target is None:
            self._run(way.content)
            return
        target = self._effective(way.target)
        domain = next(node for node in source.around() if node in target.around())
        if way.internal and source.inner and source in target.around():
            domain = source
        leaving = [node for node in self._active if domain in node.around()]
        leaving.sort(key=self._order.__getitem__, reverse=True)
        for node in leaving:
            for history in node.histories:
                kept = (item for item in self._active if node in item.around())
                if history.kind == "shallow":
                    self._values[history] = next(item for item in kept if item.parent is node)
                else:
                    self._values[history] = next(item for item in kept if not item.inner)
        for node in leaving:
            self._run(node.exit)
            for item in node.ways:
                self._due.pop(item, None)
            self._active.remove(node)
        self._run(way.content)
        self._enter(way, domain)

    def _effective(self, node: Node) -> Node:
        if node.kind not in ("shallow", "deep"):
            return node
        kept = self._values.get(node)
        if kept is not None:
            return kept
        return self._effective(node.enters().to())

    def _enter(self, way: Way, domain: Node) -> None:
        entering: set[Node] = set()
        by_default: set[Node] = set()
        default_content: dict[Node, list[Content]] = {}

        def add_descendants(node: Node) -> None:
            if node.kind in ("shallow", "deep"):
                parent, kept = node.around()[0], self._values.get(node)
                if kept is None:
                    default_content[parent] = node.enters().content
                    kept = node.enters().to()
                add_descendants(kept)
                add_ancestors(kept, parent)
                return
            entering.add(node)
            if node.inner:
                by_default.add(node)
                add_descendants(node.enters().to())
                add_ancestors(node.enters().to(), node)

        def add_ancestors(node: Node, end: Node) -> None:
            for inner in node.around():
                if inner is end or inner.parent is None:
                    return
                entering.add(inner)

        add_descendants(way.to())
        add_ancestors(self._effective(way.to()), domain)
        # what is active stays (section 3.13: the entry set has proper descendants of the domain alone)
        for node in sorted(entering - self._active, key=self._order.__getitem__):
            self._active.add(node)
            delays = (item for item in node.ways if item.after_ms)
            self._due.update((item, self._now_ms + item.after_ms) for item in delays)
            self._run(node.entry)
            if node in by_default:
                self._run(node.enters().content)
            self._run(default_content.get(node, []))
            if node.kind == "final" and node.parent is not None:
                self._queue.append(f"done.state.{node.parent.name}")
