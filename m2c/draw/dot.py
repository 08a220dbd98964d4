"""The same diagrams in Graphviz' DOT language."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from m2c.draw import svg
from m2c.draw.diagram import Diagram, Label, diagrams_of
from m2c.draw.policy import Node
from m2c.draw.wiring import Sort, Wiring, offer_names
from m2c.draw.wording import Part
from m2c.model.machine import Machine
from m2c.policy.tree import LeafKind
from m2c.printable import printable

_COLUMNS = 46
_LOOK = (
    '  node [fontname="Helvetica", fontsize=11, shape=box];',
    '  edge [fontname="Courier", fontsize=9, arrowsize=0.7];',
)
_STYLES = {Sort.TOPIC: "dotted", Sort.SERVICE: "solid", Sort.ACTION: "bold"}


def machine_as_dot(machine: Machine) -> str:
    """The machine's states as nodes; those of its action threads in clusters of their own.

    A compound state is a cluster. A node in it has its name and what happens inside; its transitions leave
    from there.
    """
    found = diagrams_of(machine)
    lines = _head("machine", machine.name)
    lines += ["  compound=true;"] if any(diagram.compounds for diagram in found) else []
    lines += _states(found[0], "s", "  ")
    for index, diagram in enumerate(found[1:], 1):
        lines += [f"  subgraph cluster{index} {{", f"    label={quoted(diagram.title)};"]
        lines += [*_states(diagram, f"m{index}s", "    "), "  }"]
    return _joined([*lines, "}"])


def wiring_as_dot(wiring: Wiring) -> str:
    """Nodes and channels; dotted: topics, thin: service calls, bold: actions."""
    names = offer_names(wiring)
    lines = [*_head("wiring", wiring.name), "  rankdir=LR;"]
    for index, place in enumerate(wiring.places):
        rows = [place.name, *(f"{o.sort} {names[o.channel]}" for o in place.offers)]
        style = ", style=dashed" if place.role == "outside" else ""
        lines.append(f"  n{index} [label={quoted(*rows)}{style}];")
    for wire in wiring.wires:
        if wire.offer is None:
            served = wiring.places[wire.provider].served
            label = " · ".join(names[offer.channel] for offer in served)
            lines.append(f"  n{wire.user} -> n{wire.provider} [label={quoted(label)}];")
            continue
        look = f"label={quoted(names[wire.offer.channel])}, style={_STYLES[wire.offer.sort]}"
        back = ", dir=back" if wire.offer.sort is Sort.TOPIC else ""
        lines.append(f"  n{wire.user} -> n{wire.provider} [{look}{back}];")
    return _joined([*lines, "}"])


def policy_as_dot(name: str, root: Node) -> str:
    """The tree; rounded conditions, square actions."""
    lines = [*_head("policy", name), "  rankdir=LR; ordering=out;"]
    count = 0

    def add(node: Node) -> str:
        nonlocal count
        own = f"n{count}"
        count += 1
        rows: Iterable[str] = dict.fromkeys((node.name or node.kind, node.kind))
        style = ""
        if node.is_leaf and node.kind == LeafKind.CONDITION:
            rows, style = [f"{node.name}?"], ", style=rounded"
        elif node.is_leaf and node.kind == LeafKind.ACTION:
            rows = [node.name]
        ports = [line for told in node.told for line in svg.folded(told, _COLUMNS)]
        lines.append(f"  {own} [label={quoted(*rows, *ports)}{style}];")
        for child in node.children:
            below = add(child)
            label = ' [label="not"]' if child.negated else ""
            lines.append(f"  {own} -> {below}{label};")
        return own

    add(root)
    return _joined([*lines, "}"])


def quoted(*rows: str) -> str:
    """``rows`` as one DOT string, each a line."""
    inside = "\\n".join(_escaped(row) for row in rows)
    return f'"{inside}"'


def _escaped(words: str) -> str:
    # Graphviz replaces HTML entities in every string, and what follows a backslash (\N: the node's name)
    shown = printable(words).replace("&", "&amp;")
    return shown.replace("\\", "\\\\").replace('"', '\\"')


def _head(kind: str, title: str) -> list[str]:
    """The beginning: every name in the language is ours, the models' stand in labels."""
    return [f'digraph "{kind}" {{', *_LOOK, f"  label={quoted(title)}; labelloc=t;"]


def _states(diagram: Diagram, prefix: str, indent: str) -> list[str]:
    lines = _inside(diagram, prefix, indent, None)
    for number, start in enumerate(diagram.starts):
        source = f"start{number or ''}"
        for label in start.labels or (None,):
            lines.append(indent + _edge(diagram, prefix, source, start.target, label))
    for arrow in diagram.arrows:
        for label in arrow.labels or (None,):
            lines.append(indent + _edge(diagram, prefix, arrow.source, arrow.target, label))
    return lines


def _inside(diagram: Diagram, prefix: str, indent: str, parent: int | None) -> list[str]:
    """What stands directly in ``parent``, and in that."""
    lines = [
        f"{indent}{prefix}start{number or ''} "
        '[shape=circle, style=filled, fillcolor=black, width=0.15, label=""];'
        for number, start in enumerate(diagram.starts)
        if start.parent == parent
    ]
    compounds = diagram.compounds
    for index, state in enumerate(diagram.states):
        if state.parent != parent:
            continue
        rows = "".join(_words(label) for label in state.labels)
        inside = f"\\n{rows}" if rows else ""
        shown = f'"{_escaped(state.name)}{inside}"'
        own = f"{prefix}{index}"
        if index in compounds:
            lines += [f"{indent}subgraph cluster{own} {{", f'{indent}  style=rounded; label="";']
            lines.append(f"{indent}  {own} [label={shown}, shape=plain];")
            lines += [*_inside(diagram, prefix, f"{indent}  ", index), f"{indent}}}"]
        elif state.is_history:
            lines.append(f"{indent}{own} [label={shown}, shape=circle];")
        else:
            around = ", peripheries=2" if state.final else ""
            lines.append(f"{indent}{own} [label={shown}, style=rounded{around}];")
    return lines


def _edge(
    diagram: Diagram, prefix: str, source: int | str, target: int, label: Label | None
) -> str:
    """An edge; at a compound state it ends at the cluster, if its other end is not inside."""
    look = [] if label is None else [f'label="{_words(label)}"']
    for key, one, other in (("ltail", source, target), ("lhead", target, source)):
        is_inside = isinstance(other, int) and isinstance(one, int) and diagram.is_in(other, one)
        if one in diagram.compounds and not is_inside:
            look.append(f"{key}=cluster{prefix}{one}")
    shown = f" [{', '.join(look)}]" if look else ""
    return f"{prefix}{source} -> {prefix}{target}{shown};"


def _words(label: Label) -> str:
    texts = [
        f"/ {line}" if phrase.part is Part.ACTION and not number else line
        for phrase in label.phrases
        for number, line in enumerate(svg.folded(phrase.text, _COLUMNS))
    ]
    return "".join(f"{_escaped(text)}\\l" for text in texts)


def _joined(lines: Sequence[str]) -> str:
    return "\n".join(lines) + "\n"
