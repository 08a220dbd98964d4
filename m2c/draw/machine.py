"""A machine's diagram as a picture."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from m2c.draw import svg
from m2c.draw.diagram import AGAIN, Diagram, Label, StateBox, diagrams_of
from m2c.draw.layers import Link
from m2c.draw.layout import Layout, lay_out, path
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
    inside = [label for one in diagrams for state in one.states for label in state.labels]
    if any(label.phrases[0].text.startswith(AGAIN) for label in inside if label.phrases):
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
            [_text(label, COLUMNS) for label in arrow.labels] for arrow in diagram.arrows
        ]
        self._sizes: list[tuple[float, float]] = []

    def shapes(self) -> tuple[list[str], float, float]:
        """The shapes, and the width and height of the area they take."""
        layout = self._layout()
        parts: list[str] = []
        x, y = layout.corners[0]
        half = _START / 2
        parts.append(
            f'<circle class="dot" cx="{svg.number(x + half + _MARGIN)}" '
            f'cy="{svg.number(y + half + self._top)}" r="{svg.number(half)}"/>'
        )
        moved = _moved(layout, _MARGIN, self._top)
        tip = f"{self._prefix}tip"
        parts.append(svg.line(path(moved, moved.routes[0]), tip=tip))
        for arrow, route in zip(self._diagram.arrows, moved.routes[1:], strict=True):
            keys = " ".join(label.key for label in arrow.labels)
            shape = svg.line(path(moved, route), tip=tip)
            for label in arrow.labels:
                if not label.phrases:  # taken at once and always: the arrow is all there is of it
                    shape = svg.group([shape], "transition", self._name(label.key))
            parts.append(f'<g class="arrow" data-keys="{keys}">{shape}</g>')
        for index, corner in enumerate(moved.corners[1:]):
            parts += self._state(index, *corner)
        for texts, route in zip(self._beside, moved.routes[1:], strict=True):
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
        ends: dict[tuple[int, bool], int] = {}
        for arrow in self._diagram.arrows:
            for end in ((arrow.source, True), (arrow.target, False)):
                ends[end] = ends.get(end, 0) + 1
        sizes = [(_START, _START)]
        for index, state in enumerate(self._diagram.states):
            width, height = self._state_size(state, self._inside[index])
            ports = _PORTS * (1 + ends.get((index, True), 0) + ends.get((index, False), 0))
            if sideways:
                height = max(height, ports / 1.5)
            else:
                width = max(width, ports / 1.5)
            sizes.append((width, height))
        links = [Link(source=0, target=1 + self._diagram.initial)]
        for arrow, texts in zip(self._diagram.arrows, self._beside, strict=True):
            width = max(text.width for text in texts)
            height = sum(text.height for text in texts) + _APART * (len(texts) - 1)
            # room for the line: above it sideways, left of the text downwards
            size = (width + 8, height + 5) if sideways else (width + 14, height + 4)
            filled = size if any(text.lines for text in texts) else None
            links.append(Link(source=1 + arrow.source, target=1 + arrow.target, label=filled))
        return lay_out(sizes, links, sideways), sizes

    def _state_size(self, state: StateBox, inside: Sequence[_Text]) -> tuple[float, float]:
        width = svg.name_width(svg.shortened(state.name, COLUMNS)) + 2 * _PADDING + 4
        height = _HEAD
        if inside:
            width = max(width, max(text.width for text in inside) + 2 * _PADDING)
            height += sum(text.height for text in inside) + _APART * (len(inside) - 1) + 10
        return max(width, 70.0), height + 2

    def _state(self, index: int, x: float, y: float) -> list[str]:
        state, inside = self._diagram.states[index], self._inside[index]
        width, height = self._sizes[index + 1]
        parts = [svg.box(x, y, width, height, "box", 9)]
        if state.final:
            parts.append(svg.box(x + 3, y + 3, width - 6, height - 6, "frame", 7))
        name = svg.shortened(state.name, COLUMNS)
        centre = y + 18 if inside else y + height / 2 + 5
        parts.append(svg.text(x + width / 2, centre, name, "head", "middle"))
        if inside:
            parts.append(svg.rule(x, y + _HEAD, x + width))
        at = y + _HEAD + 4
        for text in inside:
            parts.append(self._words(text, x + _PADDING, at, width - 2 * _PADDING))
            at += text.height + _APART
        return [svg.group(parts, "state")]

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


def _moved(layout: Layout, x: float, y: float) -> Layout:
    routes = tuple(
        msgspec.structs.replace(
            route,
            points=tuple((a + x, b + y) for a, b in route.points),
            label=None if route.label is None else (route.label[0] + x, route.label[1] + y),
        )
        for route in layout.routes
    )
    corners = tuple((a + x, b + y) for a, b in layout.corners)
    return msgspec.structs.replace(layout, corners=corners, routes=routes)
