"""A machine's diagram, before it is a picture: states, what they do inside, arrows between them.

A transition without a target, and one that leads back to its own state, is told inside its state, as
UML's internal transitions are; the latter with a sign, since it leaves the state and enters it again.
Transitions between the same two states share an arrow. A compound state has its transitions once, as they
were written, and the states in it inside.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import msgspec

from m2c.diagnostics import Position
from m2c.draw.wording import Part, Phrase, Wording
from m2c.model.machine import ActionThread, History, Machine, State, Target, Transition
from m2c.model.walk import with_inner

AGAIN = "\N{ANTICLOCKWISE OPEN CIRCLE ARROW}"
"""Stands before what leaves a state and enters it again; of an arrow, the compound state it stands in."""
MAX_PHRASES = 16
"""Actions of a label that are told; a longer list is cut, and said to be."""


class Label(msgspec.Struct, frozen=True):
    """What a transition, an entry or an exit says.

    Attributes:
        key: ``t<number>`` of the transition in document order (``t0`` is the first), the same in
            every picture of the machine; "" for entry and exit.
        phrases: event, guard, actions.
        position: of the element in the model.
    """

    key: str
    phrases: tuple[Phrase, ...]
    position: Position


class StateBox(msgspec.Struct, frozen=True):
    """A state, and what happens inside it; or a history, called ``H`` or ``H*``.

    Attributes:
        name: its id.
        final: whether it is a final state.
        labels: entry, exit, transitions that do not lead away.
        parent: the index of the compound state that it stands in; None: in none.
        is_history: whether it is one.
    """

    name: str
    final: bool
    labels: tuple[Label, ...]
    parent: int | None = None
    is_history: bool = False


class Arrow(msgspec.Struct, frozen=True):
    """Transitions from one state to another, by their indices."""

    source: int
    target: int
    labels: tuple[Label, ...]


class Start(msgspec.Struct, frozen=True):
    """Where the machine begins, or the compound state ``parent``: at ``target``."""

    parent: int | None
    target: int
    labels: tuple[Label, ...] = ()


class Diagram(msgspec.Struct, frozen=True):
    """A machine, or the machine of an action's threads; its own beginning is the first of ``starts``."""

    title: str
    states: tuple[StateBox, ...]
    starts: tuple[Start, ...]
    arrows: tuple[Arrow, ...]

    @property
    def compounds(self) -> set[int]:
        """The states in which others stand."""
        return {state.parent for state in self.states if state.parent is not None}

    def is_in(self, state: int, other: int) -> bool:
        """Whether ``state`` stands in ``other``."""
        parent = self.states[state].parent
        return parent is not None and (parent == other or self.is_in(parent, other))


def diagrams_of(machine: Machine) -> tuple[Diagram, ...]:
    """The diagram of ``machine``, and one for each of its action threads."""
    found = [_diagram(machine, machine.name, 0)]
    count = _transitions(machine)
    for thread in machine.threads:
        found.append(_diagram(thread.machine, _thread_title(machine, thread), count))
        count += _transitions(thread.machine)
    return tuple(found)


def transition_keys(machine: Machine) -> dict[str, str]:
    """``file:line:column`` of each transition → its key in the diagram, joined if there are two.

    ``<ros_action_handle_goal_response>`` is two transitions, as is one with two events: their keys are
    joined by a blank.
    """
    keys: dict[str, list[str]] = {}
    for diagram in diagrams_of(machine):
        for labels in (
            *(state.labels for state in diagram.states),
            *(arrow.labels for arrow in diagram.arrows),
        ):
            for label in labels:
                if label.key and label.key not in keys.setdefault(str(label.position), []):
                    keys[str(label.position)].append(label.key)
    return {place: " ".join(found) for place, found in keys.items()}


def _transitions(machine: Machine) -> int:
    return sum(len(state.transitions) for state in with_inner(machine.written))


def _thread_title(machine: Machine, thread: ActionThread) -> str:
    copies = "a thread" if thread.count == 1 else f"{thread.count} threads"
    return f"{machine.name}: {copies} of {thread.interface}"


def _diagram(machine: Machine, title: str, first: int) -> Diagram:
    return _Reading(machine, first).diagram(title)


class _Reading:
    """Reads the states as they were written; transitions are numbered from ``first``."""

    def __init__(self, machine: Machine, first: int) -> None:
        self._machine = machine
        self._words = Wording(machine)
        self._number = first
        self._parents: list[int | None] = []
        self._states: list[State | History] = []
        self._places: dict[str, int] = {}
        self._list(machine.written, None)

    def _list(self, states: Sequence[State], parent: int | None) -> None:
        for state in states:
            own = self._add(state, parent)
            for history in state.histories:
                self._add(history, own)
            self._list(state.states, own)

    def _add(self, state: State | History, parent: int | None) -> int:
        own = self._places[state.name] = len(self._states)
        self._states.append(state)
        self._parents.append(parent)
        return own

    def diagram(self, title: str) -> Diagram:
        machine = self._machine
        boxes: list[StateBox] = []
        starts = [Start(None, self._places[machine.starts_in or machine.initial])]
        arrows: dict[tuple[int, int], list[Label]] = {}
        for index, state in enumerate(self._states):
            if isinstance(state, History):
                called = "H*" if state.deep else "H"
                boxes.append(StateBox(called, False, (), self._parents[index], True))
                target, labels = self._way(state.default)
                arrows.setdefault((index, target), []).extend(labels)
                continue
            if state.initial is not None:
                starts.append(Start(index, *self._way(state.initial)))
            inside = _entry_and_exit(state, self._words)
            for transition in state.transitions:
                key = f"t{self._number}"
                self._number += 1
                for name, label in self._labels(transition, key, index):
                    if name is None or name == state.name:
                        inside.append(label)
                    else:
                        arrows.setdefault((index, self._places[name]), []).append(label)
            boxes.append(StateBox(state.name, state.final, tuple(inside), self._parents[index]))
        return Diagram(
            title,
            tuple(boxes),
            tuple(starts),
            tuple(Arrow(*ends, tuple(labels)) for ends, labels in arrows.items()),
        )

    def _way(self, way: Transition) -> tuple[int, tuple[Label, ...]]:
        """Where the way into a compound state leads, and what is done on it."""
        phrases = tuple(_cut(self._words.actions(way.body)))
        labels = (Label("", phrases, way.position),) if phrases else ()
        return self._places[way.targets[0].state], labels

    def _labels(
        self, transition: Transition, key: str, source: int
    ) -> list[tuple[str | None, Label]]:
        """A label for each target, or one without a target."""
        trigger = self._words.trigger(transition)
        body = self._words.actions(transition.body)
        if not transition.targets:
            return [(None, Label(key, (*trigger, *_cut(body)), transition.position))]
        found: list[tuple[str | None, Label]] = []
        for target in transition.targets:
            content = [*body, *self._words.actions(target.body)]
            phrases = [*trigger, *_chance(target), *_cut(content)]
            if self._is_again(transition, source, self._places[target.state]):
                if phrases and phrases[0].part is Part.EVENT:
                    phrases[0] = Phrase(Part.EVENT, f"{AGAIN} {phrases[0].text}")
                else:
                    phrases.insert(0, Phrase(Part.EVENT, AGAIN))
            found.append((target.state, Label(key, tuple(phrases), transition.position)))
        return found

    def _is_again(self, transition: Transition, source: int, target: int) -> bool:
        """Whether it leaves, and enters again, one of two states in which the other one is."""
        if source in self._chain(target):
            return source == target or not transition.internal
        return target in self._chain(source)

    def _chain(self, index: int | None) -> Iterator[int]:
        """A state, and those that it stands in."""
        while index is not None:
            yield index
            index = self._parents[index]


def _entry_and_exit(state: State, words: Wording) -> list[Label]:
    return [
        Label("", (Phrase(Part.EVENT, word), *_cut(words.actions(body))), state.position)
        for word, body in (("entry", state.on_entry), ("exit", state.on_exit))
        if body
    ]


def _chance(target: Target) -> list[Phrase]:
    if target.probability is None:
        return []
    return [Phrase(Part.GUARD, f"with probability {target.probability:g}")]


def _cut(actions: list[Phrase]) -> list[Phrase]:
    if len(actions) <= MAX_PHRASES:
        return actions
    left = len(actions) - MAX_PHRASES + 1
    return [*actions[: MAX_PHRASES - 1], Phrase(Part.ACTION, f"… and {left} more")]
