"""Draws the lab tour's behaviour tree and its wiring, from the example's own models.

Run it after a change of the models: ``python docs/images/lab_tour.py``. A test holds the committed
pictures to what it draws.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from xml.etree import ElementTree

import msgspec

from m2c.model import DiagnosticLog, load
from m2c.model.machine import InterfaceKind, Machine

HERE = Path(__file__).parent
EXAMPLE = HERE.parents[1] / "examples" / "lab_tour"
STYLE = """\
  <style>
    .box{fill:#fff;stroke:#333;stroke-width:1.4} .tool{fill:#e8eef7;stroke:#1f3f77;stroke-width:1.6}
    .line{stroke:#333;stroke-width:1.4;fill:none} .topic{stroke-dasharray:2 3}
    .action{stroke-width:3.2} .small{font-size:11px;fill:#444} .head{font-weight:bold}
  </style>
  <defs>
    <marker id="a" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8" \
markerUnits="userSpaceOnUse" orient="auto"><path d="M0,0 L8,4 L0,8 z" fill="#333"/></marker>
  </defs>
"""


def picture(width: int, height: int, parts: Iterable[str]) -> str:
    """An SVG of so many units."""
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        'font-family="Helvetica, Arial, sans-serif" font-size="13">\n'
    )
    paper = f'  <rect width="{width}" height="{height}" fill="#fff"/>\n'
    return head + STYLE + paper + "".join(f"  {part}\n" for part in parts) + "</svg>\n"


def box(x: float, y: float, width: float, height: float, kind: str, corner: float = 4) -> str:
    """A box with corners of radius ``corner``."""
    size = f'width="{width:g}" height="{height:g}"'
    return f'<rect class="{kind}" x="{x:g}" y="{y:g}" {size} rx="{corner:g}"/>'


def text(x: float, y: float, words: str, kind: str = "", anchor: str = "start") -> str:
    """A line of text; ``y`` is its base line."""
    style = f'class="{kind}" ' if kind else ""
    place = f' text-anchor="{anchor}"' if anchor != "start" else ""
    return f'<text {style}x="{x:g}" y="{y:g}"{place}>{escape(words)}</text>'


# -- the tree ---------------------------------------------------------------------------------

COLUMNS = (16, 216, 416, 636)
"""Left edges of the control nodes by depth; leaves stand in the last column."""
WIDE, LEAF_WIDE, ROW = 156, 196, 42


class Node(msgspec.Struct):
    """A node of the tree: ``kind`` is what the picture calls it; ``y`` its middle."""

    kind: str
    name: str
    negated: bool
    children: list[Node]
    y: float = 0


def read_tree(policy: Path) -> Node:
    """The main tree of a policy, its sub-trees put in place."""
    root = ElementTree.parse(policy).getroot()
    trees = {tree.get("ID", ""): tree[0] for tree in root.iter("BehaviorTree")}

    def read(element: ElementTree.Element, name: str = "", negated: bool = False) -> Node:
        match element.tag:
            case "SubTree":
                called = element.get("ID", "")
                return read(trees[called], called)
            case "Inverter":
                return read(element[0], negated=not negated)
        shown = name or element.get("name", "")
        kind = element.tag.lower() if element.tag in ("Condition", "Action") else element.tag
        return Node(kind, shown, negated, [read(child) for child in element])

    return read(trees[root.get("main_tree_to_execute", "")], "Tour")


def draw_tree(root: Node) -> str:
    """The tree from left to right; a reader sees what is ticked first at the top."""
    parts: list[str] = []
    rows = 0

    def place(node: Node) -> None:
        nonlocal rows
        for child in node.children:
            place(child)
        if node.children:
            node.y = (node.children[0].y + node.children[-1].y) / 2
        else:
            node.y = 48 + rows * ROW
            rows += 1

    def draw(node: Node, depth: int) -> None:
        x = COLUMNS[depth] if node.children else COLUMNS[-1]
        if not node.children:
            condition = node.kind == "condition"
            corner = 16 if condition else 4
            parts.append(box(x, node.y - 16, LEAF_WIDE, 32, "box" if condition else "tool", corner))
            parts.append(text(x + 14, node.y + 5, node.name + ("?" if condition else "")))
            return
        parts.append(box(x, node.y - 19, WIDE, 38, "box"))
        parts.append(text(x + 10, node.y - 3, node.name, "head"))
        sign = "→" if node.kind.endswith("Sequence") else "?"
        parts.append(text(x + 10, node.y + 12, f"{sign} {node.kind}", "small"))
        middle = x + WIDE + 22
        for child in node.children:
            end = COLUMNS[depth + 1] if child.children else COLUMNS[-1]
            parts.append(
                f'<path class="line" d="M{x + WIDE:g},{node.y:g} H{middle:g} V{child.y:g} H{end:g}"/>'
            )
            if child.negated:
                parts.append(box(end - 42, child.y - 10, 34, 20, "box", 10))
                parts.append(text(end - 25, child.y + 4, "not", "small", "middle"))
            draw(child, depth + 1)

    place(root)
    draw(root, 0)
    height = 48 + rows * ROW
    legend = (
        "→ Sequence: one after the other, until one fails · ? Fallback: until one succeeds · "
        "Reactive: from the first at every tick"
    )
    parts.append(text(16, 18, legend, "small"))
    parts.append(text(COLUMNS[-1], height - 4, "rounded: condition · square: action", "small"))
    return picture(COLUMNS[-1] + LEAF_WIDE + 16, height + 6, parts)


# -- the wiring -------------------------------------------------------------------------------

SKILLS_X, SKILL_WIDE, SKILL_ROW = 116, 210, 38
COMPONENTS_X, COMPONENT_WIDE, PORT_ROW = 600, 244, 22
ORDER = (
    *("BatteryComponent", "NotifyUserComponent", "BlackboardComponent"),
    *("SchedulerComponent", "NavigationComponent", "PeopleDetectorComponent"),
)
"""The components from top to bottom, so that few lines cross."""
KINDS = {
    InterfaceKind.PUBLISHER: "topic",
    InterfaceKind.SERVER: "service",
    InterfaceKind.ACTION_SERVER: "action",
}
USES = {
    InterfaceKind.SUBSCRIBER: "topic",
    InterfaceKind.CLIENT: "service",
    InterfaceKind.ACTION_CLIENT: "action",
}


def draw_wiring(machines: Sequence[Machine]) -> str:
    """Skills, components and the channels between them."""
    parts: list[str] = []
    ports: dict[str, float] = {}
    parts.append(text(COMPONENTS_X, 18, "components", "head"))
    top = 30.0
    for machine in sorted(of_kind(machines, "Component"), key=lambda one: ORDER.index(one.name)):
        offers = [one for one in machine.interfaces if one.kind in KINDS]
        height = 30 + len(offers) * PORT_ROW
        parts.append(box(COMPONENTS_X, top, COMPONENT_WIDE, height, "box"))
        parts.append(text(COMPONENTS_X + 12, top + 19, machine.name, "head"))
        for row, interface in enumerate(offers):
            y = top + 36 + row * PORT_ROW
            last = interface.channel.rpartition("/")[2]
            ports[interface.channel] = y
            parts.append(text(COMPONENTS_X + 12, y + 4, f"{KINDS[interface.kind]} {last}"))
        top += height + 16
    skills = sorted(of_kind(machines, "Skill"), key=lambda one: average(used(one, ports)))
    parts.append(text(SKILLS_X, 18, "skills", "head"))
    heights = {machine.name: 30 + row * SKILL_ROW for row, machine in enumerate(skills)}
    bottom = max(top, 30 + len(skills) * SKILL_ROW)
    for machine in skills:
        y = heights[machine.name]
        parts.append(box(SKILLS_X, y, SKILL_WIDE, 28, "tool"))
        parts.append(text(SKILLS_X + 10, y + 18, machine.name.removesuffix("Skill")))
        served = [
            one.channel.rpartition("/")[2]
            for one in machine.interfaces
            if one.kind is InterfaceKind.SERVER
        ]
        parts.append(
            text(SKILLS_X + SKILL_WIDE - 8, y + 18, " · ".join(served), "small", anchor="end")
        )
        lines = sorted(
            (ports[one.channel], USES[one.kind]) for one in machine.interfaces if one.kind in USES
        )
        for index, (target, kind) in enumerate(lines):
            start = y + 28 * (index + 1) / (len(lines) + 1)
            parts.append(connection(start, target, kind))
        parts.append(arrow(80, y + 14, SKILLS_X))
    parts.append(box(16, 30, 64, bottom - 46, "box"))
    middle = (30 + bottom - 16) / 2
    parts.append(text(48, middle - 6, "policy", "head", "middle"))
    parts.append(text(48, middle + 12, "ticks,", "small", "middle"))
    parts.append(text(48, middle + 26, "halts", "small", "middle"))
    parts += legend(bottom + 8)
    return picture(COMPONENTS_X + COMPONENT_WIDE + 16, int(bottom) + 22, parts)


def of_kind(machines: Sequence[Machine], ending: str) -> list[Machine]:
    """The machines whose names end so."""
    return [machine for machine in machines if machine.name.endswith(ending)]


def used(machine: Machine, ports: dict[str, float]) -> list[float]:
    """The heights of the channels that a skill uses; one that uses none comes last."""
    return [ports[one.channel] for one in machine.interfaces if one.kind in USES] or [1e6]


def average(values: Sequence[float]) -> float:
    """Their mean."""
    return sum(values) / len(values)


def arrow(start: float, y: float, end: float) -> str:
    """A horizontal arrow."""
    return f'<path class="line" marker-end="url(#a)" d="M{start:g},{y:g} H{end:g}"/>'


def connection(start: float, target: float, kind: str) -> str:
    """A line between a skill and a channel; its arrow is where messages or requests arrive."""
    left, right = SKILLS_X + SKILL_WIDE, COMPONENTS_X
    points = [(left, start), (left + 110, start), (right - 110, target), (right, target)]
    if kind == "topic":
        points.reverse()
    first, *others = (f"{x:g},{y:g}" for x, y in points)
    return f'<path class="line {kind}" marker-end="url(#a)" d="M{first} C{" ".join(others)}"/>'


def legend(y: float) -> list[str]:
    """What the lines mean."""
    parts: list[str] = []
    for x, kind, words in (
        (116, "topic", "topic"),
        (216, "service", "service call"),
        (356, "action", "action: goal, feedback, result, cancel"),
    ):
        parts.append(f'<path class="line {kind}" d="M{x},{y:g} H{x + 36}"/>')
        parts.append(text(x + 44, y + 4, words, "small"))
    return parts


def pictures() -> dict[str, str]:
    """Every picture of the lab tour: file name → SVG."""
    system = load([EXAMPLE / "system.xml"], DiagnosticLog())
    assert system is not None
    return {
        "lab_tour_tree.svg": draw_tree(read_tree(EXAMPLE / "policy.xml")),
        "lab_tour_wiring.svg": draw_wiring(system.nodes),
    }


if __name__ == "__main__":
    for name, content in pictures().items():
        (HERE / name).write_text(content, encoding="utf-8")
