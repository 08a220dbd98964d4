"""A machine's diagram, before it is a picture: states, what they do inside, arrows between them.

A transition without a target, and one that leads back to its own state, is told inside its state, as
UML's internal transitions are; the latter with a sign, since it leaves the state and enters it again.
Transitions between the same two states share an arrow.
"""

from __future__ import annotations

import msgspec

from m2c.diagnostics import Position
from m2c.draw.wording import Part, Phrase, Wording
from m2c.model.machine import ActionThread, Machine, State, Target, Transition

AGAIN = "\N{ANTICLOCKWISE OPEN CIRCLE ARROW}"
"""Stands before what leaves a state and enters it again."""
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
    """A state, and what happens inside it."""

    name: str
    final: bool
    labels: tuple[Label, ...]


class Arrow(msgspec.Struct, frozen=True):
    """Transitions from one state to another, by their indices."""

    source: int
    target: int
    labels: tuple[Label, ...]


class Diagram(msgspec.Struct, frozen=True):
    """A machine, or the machine of an action's threads."""

    title: str
    states: tuple[StateBox, ...]
    initial: int
    arrows: tuple[Arrow, ...]


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
    return sum(len(state.transitions) for state in machine.states)


def _thread_title(machine: Machine, thread: ActionThread) -> str:
    copies = "a thread" if thread.count == 1 else f"{thread.count} threads"
    return f"{machine.name}: {copies} of {thread.interface}"


def _diagram(machine: Machine, title: str, first: int) -> Diagram:
    words = Wording(machine)
    places = {state.name: index for index, state in enumerate(machine.states)}
    boxes: list[StateBox] = []
    arrows: dict[tuple[int, int], list[Label]] = {}
    number = first
    for index, state in enumerate(machine.states):
        inside = _entry_and_exit(state, words)
        for transition in state.transitions:
            key = f"t{number}"
            number += 1
            for target, label in _labels(transition, key, state, words):
                if target is None or target == state.name:
                    inside.append(label)
                else:
                    arrows.setdefault((index, places[target]), []).append(label)
        boxes.append(StateBox(state.name, state.final, tuple(inside)))
    return Diagram(
        title,
        tuple(boxes),
        places[machine.initial],
        tuple(Arrow(*ends, tuple(labels)) for ends, labels in arrows.items()),
    )


def _entry_and_exit(state: State, words: Wording) -> list[Label]:
    return [
        Label("", (Phrase(Part.EVENT, word), *_cut(words.actions(body))), state.position)
        for word, body in (("entry", state.on_entry), ("exit", state.on_exit))
        if body
    ]


def _labels(
    transition: Transition, key: str, state: State, words: Wording
) -> list[tuple[str | None, Label]]:
    """A label for each target, or one without a target."""
    trigger = words.trigger(transition)
    body = words.actions(transition.body)
    if not transition.targets:
        return [(None, Label(key, (*trigger, *_cut(body)), transition.position))]
    found: list[tuple[str | None, Label]] = []
    for target in transition.targets:
        phrases = [*trigger, *_chance(target), *_cut([*body, *words.actions(target.body)])]
        if target.state == state.name:
            if phrases and phrases[0].part is Part.EVENT:
                phrases[0] = Phrase(Part.EVENT, f"{AGAIN} {phrases[0].text}")
            else:
                phrases.insert(0, Phrase(Part.EVENT, AGAIN))
        found.append((target.state, Label(key, tuple(phrases), transition.position)))
    return found


def _chance(target: Target) -> list[Phrase]:
    if target.probability is None:
        return []
    return [Phrase(Part.GUARD, f"with probability {target.probability:g}")]


def _cut(actions: list[Phrase]) -> list[Phrase]:
    if len(actions) <= MAX_PHRASES:
        return actions
    left = len(actions) - MAX_PHRASES + 1
    return [*actions[: MAX_PHRASES - 1], Phrase(Part.ACTION, f"… and {left} more")]
