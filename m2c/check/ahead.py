"""What can still follow a transition: outputs, and responses to the request that it took.

Each question is answered for all states at once, by walking backwards from the transitions that
answer it, so that the work grows with the machine and not with its square.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from m2c.check.paths import open_branches, possible_targets, takable
from m2c.model.machine import (
    Block,
    Emit,
    Event,
    EventKind,
    Foreach,
    If,
    Machine,
    OutputKind,
    State,
    Statement,
    Transition,
)
from m2c.model.walk import emits_of

_Place = tuple[str, bool]
"""A state, and whether a later request is being processed that has no response yet."""


class Ahead:
    """The future of one machine; answers are kept, as many transitions ask the same."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.takable = {state.name: takable(state) for state in machine.states}
        self._states = {state.name: state for state in machine.states}
        self._outputs: dict[str, dict[str, set[OutputKind]]] = {}
        self._answering: dict[str, set[_Place]] = {}

    def outputs(self, state: State, transition: Transition, interface: str) -> set[OutputKind]:
        """What can be sent on ``interface`` once ``transition`` is taken, by action threads too."""
        if interface not in self._outputs:
            self._outputs[interface] = self._outputs_of(interface)
        known = self._outputs[interface]
        found = self._sent_by_threads(interface)
        for after, statements in self.steps(state, transition):
            found |= _sent(statements, interface) | known[after.name]
        return found

    def responds(self, state: State, transition: Transition, service: str) -> bool:
        """Whether some path answers the request to ``service`` that ``transition`` takes.

        A response answers the request being processed, else the oldest one that waits (docs/decisions,
        2). So while a later request is being processed, the first response is that one's.
        """
        if OutputKind.RESPONSE in self._sent_by_threads(service):
            return True
        if service not in self._answering:
            self._answering[service] = self._answering_places(service)
        answering = self._answering[service]
        return any(
            _most_responses(statements, service) or (after.name, False) in answering
            for after, statements in self.steps(state, transition)
        )

    def _outputs_of(self, interface: str) -> dict[str, set[OutputKind]]:
        """By state, what can be sent on ``interface`` from there on."""
        found: dict[str, set[OutputKind]] = {name: set() for name in self._states}
        before: dict[str, list[str]] = {}
        for name, state in self._states.items():
            for transition in self.takable[name]:
                for after, statements in self.steps(state, transition):
                    found[name] |= _sent(statements, interface)
                    before.setdefault(after.name, []).append(name)
        pending = list(self._states)
        while pending:
            name = pending.pop()
            for earlier in before.get(name, ()):
                if not found[name] <= found[earlier]:
                    found[earlier] |= found[name]
                    pending.append(earlier)
        return found

    def _answering_places(self, service: str) -> set[_Place]:
        """The places from which some path answers a request to ``service`` that waits."""
        request = Event(EventKind.REQUEST, service)
        found: set[_Place] = set()
        before: dict[_Place, list[_Place]] = {}
        for name, state in self._states.items():
            for transition in self.takable[name]:
                for after, statements in self.steps(state, transition):
                    responses = _most_responses(statements, service)
                    for other in (False, True):
                        for processing in _during(transition, request, other):
                            if responses > processing:
                                found.add((name, other))
                            # a response may stand in a branch that is not taken: both are followed
                            for still in {processing, processing and not responses}:
                                before.setdefault((after.name, still), []).append((name, other))
        return _closure(found, before)

    def _sent_by_threads(self, interface: str) -> set[OutputKind]:
        sent = (item for thread in self.machine.threads for item in emits_of(thread.machine))
        return {kind for kind, name in sent if name == interface}

    def steps(
        self, state: State, transition: Transition
    ) -> Iterator[tuple[State, tuple[Statement, ...]]]:
        """Each way ``transition`` can go: the state it ends in, and the statements that run."""
        if not transition.targets:
            yield state, transition.body
        for target in possible_targets(transition):
            after = self._states[target.state]
            yield after, (*state.on_exit, *transition.body, *target.body, *after.on_entry)


def _closure(found: Iterable[_Place], before: Mapping[_Place, list[_Place]]) -> set[_Place]:
    """``found`` and every place from which one of it is reached."""
    closed = set(found)
    pending = list(closed)
    while pending:
        for earlier in before.get(pending.pop(), ()):
            if earlier not in closed:
                closed.add(earlier)
                pending.append(earlier)
    return closed


def _during(transition: Transition, request: Event, other: bool) -> set[bool]:
    """Whether a later request is being processed once ``transition`` is taken."""
    if transition.event is None:
        return {other}
    if transition.event.kind is EventKind.INTERNAL:  # raised in the same run to completion, or sent
        return {other, False}
    return {transition.event == request}


def _sent(statements: tuple[Statement, ...], interface: str) -> set[OutputKind]:
    """What ``statements`` can send on ``interface``."""
    return {
        item.kind
        for item in _open(statements)
        if isinstance(item, Emit) and item.interface == interface
    }


def _open(statements: tuple[Statement, ...]) -> Iterator[Statement]:
    """Every statement that can run."""
    for statement in statements:
        yield statement
        if isinstance(statement, If):
            for body in open_branches(statement):
                yield from _open(body)
        elif isinstance(statement, Block | Foreach):
            yield from _open(statement.body)


_ROUNDS = 1_000
"""So many elements an array has, or more: it can answer every request that waits."""


def _most_responses(statements: tuple[Statement, ...], service: str) -> int:
    """The most responses of ``service`` that ``statements`` can send."""
    most = 0
    for statement in statements:
        if isinstance(statement, If):
            bodies = open_branches(statement)
            most += max((_most_responses(body, service) for body in bodies), default=0)
        elif isinstance(statement, Foreach):
            most += _ROUNDS * _most_responses(statement.body, service)
        elif isinstance(statement, Block):
            most += _most_responses(statement.body, service)
        elif isinstance(statement, Emit):
            most += statement.kind is OutputKind.RESPONSE and statement.interface == service
    return most
