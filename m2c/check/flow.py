"""Flow: states nobody reaches, transitions that never run, loops that never end."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from functools import partial

from m2c.check.answers import check_answers
from m2c.check.copies import in_all_copies
from m2c.check.paths import reachable, shadows, truth
from m2c.check.responses import check_responses
from m2c.check.unused import check_interfaces
from m2c.diagnostics import DiagnosticLog, Position
from m2c.language.expressions import Expression
from m2c.model.machine import EventKind, Machine, State, Transition
from m2c.model.walk import with_inner

_OF_THREADS = frozenset(
    {
        EventKind.THREAD_START,
        EventKind.CANCEL,
        EventKind.MESSAGE,
        EventKind.TIMER,
        EventKind.AFTER,
        EventKind.INTERNAL,
    }
)
"""What reaches an action thread; messages and cancel requests after they have reached the machine."""


def check_flow(machine: Machine, log: DiagnosticLog) -> None:
    """Warn of what a machine can never do.

    Rules: ``unreachable-state``, ``shadowed-transition``, ``never-taken``, ``eventless-cycle``,
    ``thread-event``, those of :func:`m2c.check.answers.check_answers`, of
    :func:`m2c.check.responses.check_responses` and of :func:`m2c.check.unused.check_interfaces`.
    """
    _check_states(machine, log)
    check_answers(machine, log)
    check_responses(machine, log)
    check_interfaces(machine, log)
    for thread in machine.threads:  # its interfaces belong to the machine around it
        _check_states(thread.machine, log)
        _check_events(thread.machine, log)


def _check_states(machine: Machine, log: DiagnosticLog) -> None:
    names = reachable(machine)
    reached = {state.position for state in machine.states if state.name in names}
    found: list[tuple[Position, Callable[[], None]]] = [
        (state.position, partial(_report_unreached, state, machine, log))
        for state in _unreached(machine.written, reached)
    ]
    for _, item, cond in in_all_copies(machine.states, _never):
        found.append((item.position, partial(_report_never, item, cond, log)))
    for _, item, before in in_all_copies(machine.states, shadows):
        found.append((item.position, partial(_report_shadowed, item, before, log)))
    for _, report in sorted(found, key=lambda one: one[0]):
        report()
    _check_eventless_cycles(machine, log)


def _never(state: State) -> dict[int, Expression]:
    """The conditions of transitions of ``state`` that never hold, by index."""
    conditions = enumerate(item.cond for item in state.transitions)
    return {index: cond for index, cond in conditions if cond and truth(cond) is False}


def _report_unreached(state: State, machine: Machine, log: DiagnosticLog) -> None:
    what = f"state `{state.name}` cannot be reached from `{machine.initial}`"
    log.warning("unreachable-state", state.position, "state", what)


def _report_never(transition: Transition, cond: Expression, log: DiagnosticLog) -> None:
    what, hint = (
        "never taken: its condition never holds",
        "correct the condition, or remove the transition",
    )
    log.warning("never-taken", cond.position, transition.element, what, hint)


def _unreached(states: Iterable[State], reached: Collection[Position]) -> Iterator[State]:
    """Those of ``states`` of which nothing is ``reached``, and those inside the others."""
    for state in states:
        inside = [inner for inner in with_inner((state,)) if not inner.states]
        if not any(inner.position in reached for inner in inside):
            yield state
        elif state.states:
            yield from _unreached(state.states, reached)


def _check_events(thread: Machine, log: DiagnosticLog) -> None:
    """Report the events of an action thread that never reach it."""
    for state in thread.states:
        for transition in state.transitions:
            if transition.event is not None and transition.event.kind not in _OF_THREADS:
                what = "an action thread does not get this"
                hint = "it gets thread starts, cancel requests, messages and timers; handle it in the machine"
                log.error("thread-event", transition.position, transition.element, what, hint)


def _report_shadowed(transition: Transition, before: Transition, log: DiagnosticLog) -> None:
    place = f"{before.position.line}:{before.position.column}"
    if before.event is None:
        what = f"the transition at {place} waits for no event and always holds"
        hint = "give that one an event or a condition, or remove this one"
    else:
        same = "the same event" if before.event == transition.event else "its event too"
        what = f"the transition at {place} takes {same} and has no condition"
        hint = "put it before that one, or give that one a condition"
    what = f"never taken: {what}"
    log.warning("shadowed-transition", transition.position, transition.element, what, hint)


def _check_eventless_cycles(machine: Machine, log: DiagnosticLog) -> None:
    """A cycle of eventless transitions that always hold, and come before all that may, never ends."""
    following: dict[str, Transition] = {}
    for state in machine.states:
        eventless = (item for item in state.transitions if item.event is None)
        transition = next((item for item in eventless if truth(item.cond) is not False), None)
        if transition is not None and truth(transition.cond):
            following[state.name] = transition
    reported: set[str] = set()
    for start in following:
        path: list[str] = []
        name = start
        while name in following and name not in path:
            path.append(name)
            targets = following[name].targets
            name = targets[0].state if len(targets) == 1 else ("" if targets else name)
        if name in path and name not in reported:
            cycle = path[path.index(name) :]
            reported.update(cycle)
            names = " -> ".join([*cycle, cycle[0]])
            log.warning(
                "eventless-cycle",
                following[name].position,
                following[name].element,
                f"endless eventless transitions: {names}",
                "wait for an event, or add a condition",
            )
