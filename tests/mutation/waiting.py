"""Responses that nobody waits for: they are not sent, so they may as well not be there.

A response answers the request being processed, else the oldest one that waits; with none it is dropped
(docs/decisions/0002). For each place where a response is sent, the numbers of requests that can be
waiting there are found by following every transition from the initial state, whatever its condition
(so too many are found rather than too few). Where it is only ever 0, nothing is sent.
"""

from __future__ import annotations

from collections.abc import Iterable

from msgspec.structs import replace

from m2c.model.machine import Block as Nested
from m2c.model.machine import (
    Emit,
    EventKind,
    Foreach,
    If,
    InterfaceKind,
    Machine,
    OutputKind,
    State,
    Statement,
    Transition,
)
from tests.mutation.places import Block, flat, swapped

UNAWAITED = "a response that nobody waits for is not sent"
"""The argument, in words."""

_MANY = 8
"""So many requests or more: counts are exact below."""

Path = tuple[str | int, ...]
Counts = frozenset[int]


def without_unawaited_responses(machine: Machine) -> Machine:
    """``machine`` without the responses that never find a request, and without its tree."""
    machine = flat(machine)
    for interface in machine.interfaces:
        if interface.kind is InterfaceKind.SERVER:
            machine = _Waiting(machine, interface.name).stripped()
    return machine


class _Waiting:
    """How many requests of one service can be waiting at each response to it."""

    def __init__(self, machine: Machine, service: str) -> None:
        self._machine = machine
        self._service = service
        self._states = {state.name: state for state in machine.states}
        self._seen: dict[Path, set[int]] = {}
        self._explore()

    def _explore(self) -> None:
        start = self._run(self._machine.on_start, ("start",), frozenset({0}))
        start = self._enter(self._machine.initial, start)
        reached: dict[str, Counts] = {}
        pending = [(self._machine.initial, start)]
        while pending:
            name, counts = pending.pop()
            fresh = counts - reached.get(name, frozenset())
            if not fresh:
                continue
            reached[name] = reached.get(name, frozenset()) | fresh
            state = self._states[name]
            for index, transition in enumerate(state.transitions):
                pending += self._take(state, index, transition, fresh)

    def _take(
        self, state: State, index: int, transition: Transition, counts: Counts
    ) -> list[tuple[str, Counts]]:
        event = transition.event
        if event is not None and (event.kind, event.name) == (EventKind.REQUEST, self._service):
            counts = frozenset(min(count + 1, _MANY) for count in counts)
        place: Path = (state.name, index)
        if transition.targets:
            counts = self._run(state.on_exit, (state.name, "exit"), counts)
        counts = self._run(transition.body, place, counts)
        if not transition.targets:
            return [(state.name, counts)]
        found = []
        for number, target in enumerate(transition.targets):
            after = self._run(target.body, (*place, "target", number), counts)
            found.append((target.state, self._enter(target.state, after)))
        return found

    def _enter(self, name: str, counts: Counts) -> Counts:
        return self._run(self._states[name].on_entry, (name, "entry"), counts)

    def _run(self, block: Iterable[Statement], place: Path, counts: Counts) -> Counts:
        for index, statement in enumerate(block):
            here = (*place, index)
            if isinstance(statement, If):
                branches = [
                    self._run(body, (*here, number), counts)
                    for number, (_, body) in enumerate(statement.branches)
                ]
                certain = any(condition is None for condition, _ in statement.branches)
                counts = frozenset().union(*branches, () if certain else counts)
            elif isinstance(statement, Nested | Foreach):
                counts = self._run(statement.body, here, counts)
            elif self._answers(statement):
                self._seen.setdefault(here, set()).update(counts)
                counts = frozenset(after for count in counts for after in _answered(count))
        return counts

    def _answers(self, statement: Statement) -> bool:
        return (
            isinstance(statement, Emit)
            and statement.kind is OutputKind.RESPONSE
            and statement.interface == self._service
        )

    # --- leaving them out --------------------------------------------------------------------------

    def stripped(self) -> Machine:
        """The machine without the responses that only ever find nobody."""
        return replace(
            self._machine,
            on_start=self._stripped(self._machine.on_start, ("start",)),
            states=tuple(self._stripped_state(item) for item in self._machine.states),
        )

    def _stripped_state(self, state: State) -> State:
        transitions = state.transitions
        for index, transition in enumerate(transitions):
            place: Path = (state.name, index)
            targets = transition.targets
            for number, target in enumerate(targets):
                body = self._stripped(target.body, (*place, "target", number))
                targets = swapped(targets, number, replace(target, body=body))
            changed = replace(
                transition, body=self._stripped(transition.body, place), targets=targets
            )
            transitions = swapped(transitions, index, changed)
        return replace(
            state,
            on_entry=self._stripped(state.on_entry, (state.name, "entry")),
            on_exit=self._stripped(state.on_exit, (state.name, "exit")),
            transitions=transitions,
        )

    def _stripped(self, block: Block, place: Path) -> Block:
        found: list[Statement] = []
        for index, statement in enumerate(block):
            here = (*place, index)
            if isinstance(statement, If):
                branches = tuple(
                    (condition, self._stripped(body, (*here, number)))
                    for number, (condition, body) in enumerate(statement.branches)
                )
                found.append(replace(statement, branches=branches))
            elif isinstance(statement, Nested | Foreach):
                found.append(replace(statement, body=self._stripped(statement.body, here)))
            elif self._seen.get(here) != {0}:
                found.append(statement)
        return tuple(found)


def _answered(count: int) -> tuple[int, ...]:
    """How many wait after one was answered."""
    return (_MANY - 1, _MANY) if count == _MANY else (max(count - 1, 0),)
