"""Transitions of compound states, which a flat machine has once for each state in them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TypeVar

from m2c.diagnostics import Position
from m2c.model.machine import Event, State, Transition

Fault = TypeVar("Fault")


def in_all_copies(
    states: Iterable[State], faults: Callable[[State], Mapping[int, Fault]]
) -> list[tuple[State, Transition, Fault]]:
    """The transitions of ``states`` with a fault, each once; one that is right in a state is left out.

    Args:
        states: of one machine.
        faults: what is wrong with transitions of a state, by their index.
    """
    found: dict[tuple[Position, Event | None], tuple[State, Transition, Fault]] = {}
    right: set[tuple[Position, Event | None]] = set()
    for state in states:
        wrong = faults(state)
        for index, item in enumerate(state.transitions):
            key = (item.position, item.event)
            if index in wrong:
                found.setdefault(key, (state, item, wrong[index]))
            else:
                right.add(key)
    return [one for key, one in found.items() if key not in right]
