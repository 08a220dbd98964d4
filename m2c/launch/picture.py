"""The policy's tree as a picture: each leaf with its last status and how long it took to answer."""

from __future__ import annotations

import collections
import time

import msgspec
from lxml import etree
from rich.console import Group, RenderableType
from rich.text import Text
from rich.tree import Tree

from m2c.model.xml_writing import read_back
from m2c.policy.bound import child_tree
from m2c.policy.program import Leaf, Policy
from m2c.policy.runner import LeafTick, TreeTick
from m2c.printable import printable

RATE_WINDOW = 20
"""Ticks over which the rate is measured."""

_STYLES = {
    "SUCCESS": "green",
    "FAILURE": "red",
    "RUNNING": "yellow",
    "HALTED": "magenta",
}


class _Seen(msgspec.Struct, frozen=True):
    """What is drawn; replaced as a whole, because another thread draws."""

    tick: TreeTick = msgspec.field(default_factory=TreeTick)
    leaves: dict[str, tuple[int, LeafTick]] = msgspec.field(default_factory=dict)
    rate_hz: float = 0.0


class TreePicture:
    """Draws ``policy``; sub-trees are unfolded where they stand."""

    def __init__(self, policy: Policy) -> None:
        self._main = policy.main
        self._leaves = {leaf.id: leaf for leaf in policy.leaves}
        self._trees = {tree.get("ID", ""): tree[0] for tree in read_back(policy.xml)}
        self._times: collections.deque[float] = collections.deque(maxlen=RATE_WINDOW)
        self._seen = _Seen()

    def show(self, tick: TreeTick) -> None:
        """Take a tick in; ``render`` shows it."""
        self._times.append(time.monotonic())
        span = self._times[-1] - self._times[0]
        rate_hz = (len(self._times) - 1) / span if span > 0 else 0.0
        leaves = {**self._seen.leaves, **{leaf.name: (tick.tick, leaf) for leaf in tick.leaves}}
        self._seen = _Seen(tick, leaves, rate_hz)

    def render(self) -> RenderableType:
        """The picture as it is now."""
        seen = self._seen
        if not seen.tick.tick:
            return Text("")
        head = Text.assemble(
            ("tick ", "dim"),
            str(seen.tick.tick),
            "  ",
            (printable(seen.tick.status), _STYLES.get(seen.tick.status, "")),
            (f"  {seen.rate_hz:.1f} ticks/s" if seen.rate_hz else "", "dim"),
        )
        tree = Tree(_shown(self._main, style="bold"), guide_style="dim")
        self._add(tree, self._trees[self._main], seen)
        return Group(head, tree)

    def _add(self, above: Tree, element: etree._Element, seen: _Seen) -> None:
        leaf = self._leaves.get(element.tag)
        if leaf is not None:
            branch = above.add(self._leaf(leaf, seen))
            for number in range(leaf.children):
                self._add(branch, self._trees[child_tree(leaf.id, number)], seen)
            return
        if element.tag == "SubTree":
            name = element.get("ID", "")
            self._add(above.add(_shown(name, style="bold")), self._trees[name], seen)
            return
        name = element.get("name", "")
        branch = above.add(_shown(f"{element.tag} {name}".strip(), style="cyan"))
        for child in element:
            self._add(branch, child, seen)

    def _leaf(self, leaf: Leaf, seen: _Seen) -> Text:
        number, last = seen.leaves.get(leaf.name, (0, None))
        if last is None:
            return _shown(leaf.name, style="dim")
        now = number == seen.tick.tick
        text = _shown(leaf.name, style="" if now else "dim")
        style = _STYLES.get(last.status, "")
        text.append(f"  {printable(last.status)}", style=style if now else f"dim {style}")
        if last.duration_us:
            text.append(f"  {last.duration_us / 1000:.2f} ms", style="dim")
        if not now:
            text.append(f"  in tick {number}", style="dim")
        return text


def _shown(words: str, style: str) -> Text:
    """A name of the policy's: rich takes no markup from a text, but hands a terminal what is in it."""
    return Text(printable(words), style=style)
