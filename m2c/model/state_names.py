"""The ids of a machine's states: who is called what, what may be named, and what stands in what."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from m2c.diagnostics import DiagnosticLog, shortened
from m2c.language.expressions import InState
from m2c.model.xml import Element
from m2c.suggestions import nearest

STATES = ("state", "final", "parallel", "history")
"""Elements that a transition may name; parallel states are refused where they stand."""
_MAX_SHOWN = 80
"""Characters of a name that an error repeats."""


class StateNames:
    """The states of the machine ``root``; faults of those who name them go to ``log``."""

    def __init__(self, root: Element, log: DiagnosticLog) -> None:
        self._log = log
        elements = list(_in(root, ("state", "final"), ("state",)))
        self._names = dict(zip(map(id, elements), _names(elements), strict=True))
        self._known = set(self._all_in(root))
        self._has_parallel = any(True for _ in _in(root, ("parallel",), STATES))
        self._taken: set[str] = set()
        self._aimed_at = set(_aimed_at(root))

    def of(self, element: Element) -> str:
        """The id of a state."""
        return self._names[id(element)]

    def take(self, name: str, element: Element) -> None:
        """Report as ``duplicate-state`` what is called as another one before it."""
        if name in self._taken:
            what, hint = f"a second state is called `{name}`", "state ids are unique in a machine"
            self._log.error("duplicate-state", element.position, element.tag, what, hint)
        self._taken.add(name)

    def is_aimed_at(self, name: str) -> bool:
        """Whether something leads to ``name``."""
        return name in self._aimed_at

    def check(
        self, target: str, element: Element, attribute: str, what: str = "the target state"
    ) -> bool:
        """Whether ``target`` is the id of one state; else reports it."""
        if not target or target in self._known:
            return bool(target)
        at, several = element.at(attribute), target.split()
        if len(several) > 1:
            if self._has_parallel and self._known.issuperset(several):
                return False  # the <parallel> is refused where it stands
            told = f"{len(several)} states are named, which can be active together in a <parallel> only"
            hint = "parallel states are not part of the language: name one state"
            self._log.error("unsupported-element", at, element.tag, told, hint)
            return False
        told = f"{what} `{shortened(target, _MAX_SHOWN)}` does not exist"
        self._log.error("unknown-target", at, element.tag, told, nearest(target, self._known))
        return False

    def check_asked(self, asked: InState) -> None:
        """Report ``In('state')`` of a state that does not exist."""
        if asked.state not in self._known:
            what = f"the state `{shortened(asked.state, _MAX_SHOWN)}` does not exist"
            hint = nearest(asked.state, self._known)
            self._log.error("unknown-target", asked.position, "", what, hint)

    def check_inside(
        self, parent: Element, target: str, element: Element, attribute: str, has_history: bool
    ) -> None:
        """Report ``target`` if it is none of the states inside ``parent``, or of its histories."""
        if not self.check(target, element, attribute, "the state"):
            return
        names = set(self._all_in(parent, STATES if has_history else STATES[:-1]))
        if target not in names:
            name = self._names.get(id(parent), "")
            what = f"`{shortened(target, _MAX_SHOWN)}` is not a state inside `{name}`"
            hint = nearest(target, names) or "name a state inside it"
            self._log.error("unknown-target", element.at(attribute), element.tag, what, hint)

    def _all_in(self, parent: Element, tags: Sequence[str] = STATES) -> Iterator[str]:
        for item in _in(parent, tags, STATES):
            yield self._names.get(id(item)) or item.get("id")


def _in(parent: Element, tags: Sequence[str], into: Sequence[str]) -> Iterator[Element]:
    """The elements ``tags`` in ``parent`` and in the elements ``into`` in it, in document order."""
    for child in parent.children:
        if child.tag in tags:
            yield child
        if child.tag in into:
            yield from _in(child, tags, into)


def _aimed_at(element: Element) -> Iterator[str]:
    """Every value of ``element``, and of what is in it, that may be the id of a state."""
    yield from (element.get(name) for name in ("target", "initial", "accept", "reject"))
    if element.tag == "target":
        yield element.get("id")
    for child in element.children:
        yield from _aimed_at(child)


def _names(elements: Sequence[Element]) -> list[str]:
    """The ids of states; one without an id gets ``state2`` if it is the second (W3C SCXML 3.14)."""
    taken = {element.get("id") for element in elements}
    names: list[str] = []
    for place, element in enumerate(elements, 1):
        name = element.get("id") or f"{element.tag}{place}"
        while not element.get("id") and name in taken:
            name += "_"
        names.append(name)
    return names
