"""The same diagrams as Mermaid text: ``stateDiagram-v2`` and ``flowchart``.

Mermaid has its own escapes, ``#<code point>;``, and characters that mean something in some places
only: whatever is no letter, digit or harmless sign is escaped everywhere.
"""

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

_HARMLESS = frozenset(" _,=/()+*|!?'")
_OF_TITLES = frozenset(" _,=/()+*!?'-.:")
_COLUMNS = 60
_BREAK = "<br/>"
_SIDE = "side"
"""What the name of a compound state's own node ends in."""
_ARROWS = {Sort.TOPIC: "-.->", Sort.SERVICE: "-->", Sort.ACTION: "==>"}


def machine_as_mermaid(machine: Machine) -> str:
    """The machine as a state diagram; those of its action threads are states that contain it."""
    found = diagrams_of(machine)
    lines = _head(machine.name, "stateDiagram-v2")
    if len(found) == 1:
        return _joined(lines + _states(found[0], "s", "  "))
    for index, diagram in enumerate(found):
        lines += [
            f'  state "{escaped(diagram.title)}" as m{index} {{',
            *_states(diagram, f"m{index}s", "    "),
            "  }",
        ]
    return _joined(lines)


def wiring_as_mermaid(wiring: Wiring) -> str:
    """The wiring as a flowchart; dotted: topics, thin: service calls, thick: actions."""
    names = offer_names(wiring)
    lines = _head(wiring.name, "flowchart LR")
    for index, place in enumerate(wiring.places):
        rows = [place.name, *(f"{o.sort} {names[o.channel]}" for o in place.offers)]
        lines.append(f'  n{index}["{_rows(rows)}"]')
    for wire in wiring.wires:
        if wire.offer is None:
            served = wiring.places[wire.provider].served
            label = " · ".join(names[offer.channel] for offer in served)
            lines.append(f'  n{wire.user} -->|"{escaped(label)}"| n{wire.provider}')
            continue
        ends = (wire.user, wire.provider)
        first, last = ends[::-1] if wire.offer.sort is Sort.TOPIC else ends
        label = escaped(names[wire.offer.channel])
        lines.append(f'  n{first} {_ARROWS[wire.offer.sort]}|"{label}"| n{last}')
    return _joined(lines)


def policy_as_mermaid(name: str, root: Node) -> str:
    """The tree as a flowchart: rounded conditions, square actions."""
    lines = _head(name, "flowchart LR")
    count = 0

    def add(node: Node) -> str:
        nonlocal count
        own = f"n{count}"
        count += 1
        ports = [line for told in node.told for line in svg.folded(told, _COLUMNS)]
        if node.is_leaf and node.kind == LeafKind.CONDITION:
            lines.append(f'  {own}(["{_rows([f"{node.name}?", *ports])}"])')
        elif node.is_leaf and node.kind == LeafKind.ACTION:
            lines.append(f'  {own}["{_rows([node.name, *ports])}"]')
        else:
            words = dict.fromkeys((node.name or node.kind, node.kind))
            lines.append(f'  {own}["{_rows([*words, *ports])}"]')
        for child in node.children:
            at = len(lines)
            below = add(child)
            arrow = '---|"not"|' if child.negated else "---"
            lines.insert(at + 1, f"  {own} {arrow} {below}")
        return own

    add(root)
    return _joined(lines)


def escaped(words: str) -> str:
    """``words`` as Mermaid takes them inside quotes and after colons."""
    return "".join(
        character
        if character in _HARMLESS or (character.isalnum() and character.isascii())
        else f"#{ord(character)};"
        for character in printable(" ".join(words.split()))
    )


def _states(diagram: Diagram, prefix: str, indent: str) -> list[str]:
    lines = _inside(diagram, prefix, indent, None)
    lines.append(f"{indent}[*] --> {prefix}{diagram.starts[0].target}")
    for arrow in diagram.arrows:
        source, target = f"{prefix}{arrow.source}", f"{prefix}{arrow.target}"
        source += _SIDE * diagram.is_in(arrow.target, arrow.source)
        target += _SIDE * diagram.is_in(arrow.source, arrow.target)
        for label in arrow.labels or (None,):
            lines.append(f"{indent}{source} --> {target}{_beside(label)}")
    return lines + _ends(diagram, prefix, indent, None)


def _inside(diagram: Diagram, prefix: str, indent: str, parent: int | None) -> list[str]:
    """What stands directly in ``parent``, and in that.

    A state of a compound one's name tells what happens inside that; arrows from or to the states in it end
    there, as Mermaid draws none between a state and what is in it.
    """
    compounds = diagram.compounds
    own = [index for index, state in enumerate(diagram.states) if state.parent == parent]
    names = {index: f'"{escaped(diagram.states[index].name)}"' for index in own}
    lines = []
    for index in own:
        if index not in compounds:
            lines.append(f"{indent}state {names[index]} as {prefix}{index}")
            continue
        inner = f"{indent}  "
        lines.append(f"{indent}state {names[index]} as {prefix}{index} {{")
        lines += [
            f"{inner}[*] --> {prefix}{start.target}{_beside(*start.labels)}"
            for start in diagram.starts
            if start.parent == index
        ]
        if diagram.states[index].labels or any(
            (arrow.source == index and diagram.is_in(arrow.target, index))
            or (arrow.target == index and diagram.is_in(arrow.source, index))
            for arrow in diagram.arrows
        ):
            lines.append(f"{inner}state {names[index]} as {prefix}{index}{_SIDE}")
        lines += _inside(diagram, prefix, inner, index)
        lines += [*_ends(diagram, prefix, inner, index), f"{indent}}}"]
    for index in own:
        side = _SIDE if index in compounds else ""
        labels = diagram.states[index].labels
        lines += [f"{indent}{prefix}{index}{side}: {_words(label, _COLUMNS)}" for label in labels]
    return lines


def _ends(diagram: Diagram, prefix: str, indent: str, parent: int | None) -> list[str]:
    """What leads from the final states directly in ``parent``."""
    return [
        f"{indent}{prefix}{index} --> [*]"
        for index, state in enumerate(diagram.states)
        if state.final and state.parent == parent
    ]


def _beside(label: Label | None = None) -> str:
    """``label`` beside an arrow."""
    text = "" if label is None else _words(label, _COLUMNS)
    return f": {text}" if text else ""


def _words(label: Label, columns: int) -> str:
    texts = [
        f"/ {line}" if phrase.part is Part.ACTION and not number else line
        for phrase in label.phrases
        for number, line in enumerate(svg.folded(phrase.text, columns))
    ]
    return _rows(texts)


def _rows(texts: Iterable[str]) -> str:
    return _BREAK.join(escaped(text) for text in texts)


def _head(title: str, kind: str) -> list[str]:
    return ["---", f'title: "{_yaml(title)}"', "---", kind]


def _yaml(words: str) -> str:
    """``words`` for a double-quoted scalar (YAML 1.2, 7.3.1), with an escape for every sign.

    Mermaid looks for its directives (``%%{``) and for tags in the text, before and beside YAML's parser.
    """
    return "".join(
        character if character.isalnum() or character in _OF_TITLES else f"\\U{ord(character):08x}"
        for character in printable(" ".join(words.split()))
    )


def _joined(lines: Sequence[str]) -> str:
    return "\n".join(lines) + "\n"
