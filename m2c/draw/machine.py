"""A machine's diagram as a picture."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import msgspec

from m2c.draw import svg
from m2c.draw.diagram import AGAIN, Diagram, Label, StateBox, diagrams_of
from m2c.draw.layers import Link
from m2c.draw.layout import Layout, path
from m2c.draw.nested import lay_out_nested
from m2c.draw.wording import Part
from m2c.model.machine import Machine

COLUMNS = 44
"""Characters of a line of code; longer ones are folded."""
_INSIDE_COLUMNS = 46
_TITLE_COLUMNS = 120
_MARGIN = 18.0
_TITLE = 30.0
_BETWEEN = 26.0
_HEAD = 26.0
"""Height of a state's name."""
_PADDING = 10.0
_START = 12.0
"""Diameter of the initial state's dot."""
_HISTORY = 26.0
"""Diameter of a history's circle."""
_PORTS = 15.0
"""Side of a state for each arrow that ends there."""
_APART = 4.0
"""Between labels that share an arrow, or a state."""
_WANTED = (1180.0, 820.0)
"""A screen's width and height: of the two directions, the one that fits it better is taken."""
_LEGEND = (
    f"{AGAIN} leaves the state and enters it again · every other line inside a state stays in it"
)

_CLASSES = {
    Part.EVENT: "code event",
    Part.GUARD: "code guard",
    Part.ACTION: "code action-text",
}


class _Text(msgspec.Struct, frozen=True):
    """A label in lines: (class, text)."""

    label: Label
    lines: tuple[tuple[str, str], ...]

    @property
    def width(self) -> float:
        return max((svg.code_width(text) for _, text in self.lines), default=0.0)

    @property
    def height(self) -> float:
        return len(self.lines) * svg.LINE


def draw_machine(machine: Machine, prefix: str = "") -> svg.Picture:
    """The state machine diagrams of ``machine`` and of its action threads, one below the other.

    Args:
        machine: the model.
        prefix: of every id, so that several pictures can stand in a page. A transition's group has
            the class ``transition`` and the id ``<prefix><key>``, as :func:`transition_keys` has it (a
            transition with several targets: ``<prefix><key>-1`` for the second, and so on). Its
            arrow has the class ``arrow`` and the keys of all that share it in ``data-keys``.

    Raises:
        TooLargeError: it has more states and transitions than can be shown.
    """
    parts: list[str] = []
    width, top = 0.0, _MARGIN
    used: dict[str, int] = {}
    diagrams = diagrams_of(machine)
    for diagram in diagrams:
        title = svg.shortened(diagram.title, _TITLE_COLUMNS)
        parts.append(svg.text(_MARGIN, top + 14, title, "head"))
        top += _TITLE
        shapes, area_width, area_height = _Drawing(diagram, prefix, used, top).shapes()
        parts += shapes
        width = max(width, area_width, svg.name_width(title))
        top += area_height + _BETWEEN
    labels = [
        label
        for one in diagrams
        for found in (
            *(state.labels for state in one.states),
            *(arrow.labels for arrow in one.arrows),
        )
        for label in found
        if label.phrases
    ]
    if any(label.phrases[0].text.startswith(AGAIN) for label in labels):
        parts.append(svg.text(_MARGIN, top, _LEGEND, "small"))
        width = max(width, svg.name_width(_LEGEND, 11, bold=False))
        top += 8
    else:
        top -= _BETWEEN - _MARGIN
    return svg.Picture(width + 2 * _MARGIN, top + 4, tuple(parts))


class _Drawing:
    """One diagram, at ``top``."""

    def __init__(self, diagram: Diagram, prefix: str, used: dict[str, int], top: float) -> None:
        self._diagram = diagram
        self._prefix = prefix
        self._used = used
        self._top = top
        self._inside = [
            [_text(label, _INSIDE_COLUMNS) for label in state.labels] for state in diagram.states
        ]
        self._beside = [
            [_text(label, COLUMNS) for label in labels]
            for labels in (
                *(start.labels for start in diagram.starts),
                *(arrow.labels for arrow in diagram.arrows),
            )
        ]
        self._sizes: list[tuple[float, float]] = []
        """Of the starts, and of the states."""

    def shapes(self) -> tuple[list[str], float, float]:
        """The shapes, and the width and height of the area they take."""
        layout = self._layout().moved(_MARGIN, self._top)
        diagram, count = self._diagram, len(self._diagram.starts)
        parts: list[str] = []
        for index in sorted(diagram.compounds):
            parts += self._compound(index, *layout.corners[count + index], layout.sideways)
        half = _START / 2
        tip = f"{self._prefix}tip"
        for (x, y), route in zip(layout.corners, layout.routes[:count], strict=False):
            parts.append(
                f'<circle class="dot" cx="{svg.number(x + half)}" '
                f'cy="{svg.number(y + half)}" r="{svg.number(half)}"/>'
            )
            parts.append(svg.line(path(layout, route), tip=tip))
        for arrow, route in zip(diagram.arrows, layout.routes[count:], strict=True):
            keys = " ".join(label.key for label in arrow.labels if label.key)
            shape = svg.line(path(layout, route), tip=tip)
            for label in arrow.labels:
                if label.key and not label.phrases:  # taken at once and always: it is all arrow
                    shape = svg.group([shape], "transition", self._name(label.key))
            parts.append(f'<g class="arrow" data-keys="{keys}">{shape}</g>')
        for index, corner in enumerate(layout.corners[count:]):
            if index not in diagram.compounds:
                parts += self._state(index, *corner)
        for texts, route in zip(self._beside, layout.routes, strict=True):
            if route.label is not None:
                parts += self._label(texts, layout.sideways, *route.label)
        return parts, layout.width, layout.height

    def _layout(self) -> Layout:
        """Sideways or downwards, whichever can be shown larger."""
        found = [self._laid_out(sideways=False)]
        if not found[0][0].large:
            found.insert(0, self._laid_out(sideways=True))
        scales = [min(_WANTED[0] / one.width, _WANTED[1] / one.height, 1.0) for one, _ in found]
        layout, self._sizes = found[scales.index(max(scales))]
        return layout

    def _laid_out(self, sideways: bool) -> tuple[Layout, list[tuple[float, float]]]:
        diagram, count = self._diagram, len(self._diagram.starts)
        ends = Counter(
            end for arrow in diagram.arrows for end in ((arrow.source, True), (arrow.target, False))
        )
        sizes = [(_START, _START)] * count
        for index, state in enumerate(diagram.states):
            width, height = self._state_size(state, self._inside[index])
            ports = _PORTS * (1 + ends[index, True] + ends[index, False])
            if state.is_history or index in diagram.compounds:
                pass  # a side of a compound state is as long as all that ends there needs
            elif sideways:
                height = max(height, ports / 1.5)
            else:
                width = max(width, ports / 1.5)
            sizes.append((width, height))
        parents = [
            None if parent is None else count + parent
            for parent in (
                *(start.parent for start in diagram.starts),
                *(state.parent for state in diagram.states),
            )
        ]
        ways = [
            *((number, count + start.target) for number, start in enumerate(diagram.starts)),
            *((count + arrow.source, count + arrow.target) for arrow in diagram.arrows),
        ]
        links = []
        for (source, target), texts in zip(ways, self._beside, strict=True):
            width = max((text.width for text in texts), default=0.0)
            height = sum(text.height for text in texts) + _APART * (len(texts) - 1)
            # room for the line: above it sideways, left of the text downwards
            size = (width + 8, height + 5) if sideways else (width + 14, height + 4)
            filled = size if any(text.lines for text in texts) else None
            links.append(Link(source=source, target=target, label=filled))
        return lay_out_nested(parents, sizes, links, sideways)

    def _state_size(self, state: StateBox, inside: Sequence[_Text]) -> tuple[float, float]:
        if state.is_history:
            return _HISTORY, _HISTORY
        width = svg.name_width(svg.shortened(state.name, COLUMNS)) + 2 * _PADDING + 4
        height = _HEAD
        if inside:
            width = max(width, max(text.width for text in inside) + 2 * _PADDING)
            height += sum(text.height for text in inside) + _APART * (len(inside) - 1) + 10
        return max(width, 70.0), height + 2

    def _state(self, index: int, x: float, y: float) -> list[str]:
        state, inside = self._diagram.states[index], self._inside[index]
        width, height = self._sizes[len(self._diagram.starts) + index]
        if state.is_history:
            parts = [svg.box(x, y, width, height, "box", _HISTORY / 2)]
            parts.append(svg.text(x + width / 2, y + height / 2 + 5, state.name, "", "middle"))
            return [svg.group(parts, "history")]
        parts = [svg.box(x, y, width, height, "box", 9)]
        if state.final:
            parts.append(svg.box(x + 3, y + 3, width - 6, height - 6, "frame", 7))
        centre = y + 18 if inside else y + height / 2 + 5
        parts += self._head(state, inside, x, y, width, centre)
        return [svg.group(parts, "state")]

    def _compound(self, index: int, x: float, y: float, sideways: bool) -> list[str]:
        """Its box, and its head: above what is inside, or left of that."""
        state, inside = self._diagram.states[index], self._inside[index]
        width, height = self._sizes[len(self._diagram.starts) + index]
        parts = [svg.box(x, y, width, height, "box", 9)]
        wide = width if sideways else self._state_size(state, inside)[0]
        parts += self._head(state, inside, x, y, wide, y + 18)
        return [svg.group(parts, "compound")]

    def _head(
        self,
        state: StateBox,
        inside: Sequence[_Text],
        x: float,
        y: float,
        width: float,
        base: float,
    ) -> list[str]:
        """A state's name, on the line ``base``, and what happens inside it."""
        name = svg.shortened(state.name, COLUMNS)
        parts = [svg.text(x + width / 2, base, name, "head", "middle")]
        if inside:
            parts.append(svg.rule(x, y + _HEAD, x + width))
        at = y + _HEAD + 4
        for text in inside:
            parts.append(self._words(text, x + _PADDING, at, width - 2 * _PADDING))
            at += text.height + _APART
        return parts

    def _label(self, texts: Sequence[_Text], sideways: bool, x: float, y: float) -> list[str]:
        parts = []
        at = y if sideways else y + 2
        width = max(text.width for text in texts)
        for text in texts:
            if not text.lines:
                continue
            parts.append(self._words(text, x + (4 if sideways else 8), at, width))
            at += text.height + _APART
        return parts

    def _words(self, text: _Text, x: float, y: float, width: float) -> str:
        """A label, with a ground that can be coloured to highlight it."""
        shapes = [svg.box(x - 3, y, width + 6, text.height, "ground", 3)]
        for row, (kind, words) in enumerate(text.lines):
            shapes.append(svg.text(x, y + 11 + row * svg.LINE, words, kind))
        key = text.label.key
        if not key:
            return svg.group(shapes, "entry")
        return svg.group(shapes, "transition", self._name(key))

    def _name(self, key: str) -> str:
        """An id for a transition's next element."""
        count = self._used[key] = self._used.get(key, -1) + 1
        return f"{self._prefix}{key}" + (f"-{count}" if count else "")


def _text(label: Label, columns: int) -> _Text:
    lines = [
        (_CLASSES[phrase.part], folded)
        for phrase in label.phrases
        for folded in svg.folded(phrase.text, columns)
    ]
    return _Text(label, tuple(lines))
