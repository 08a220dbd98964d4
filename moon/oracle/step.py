"""A macrostep being taken, and the states and transitions that it is taken through."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from m2c.model.diagnostics import Position
from m2c.model.machine import EventKind, OutputKind
from m2c.runtime import ecmascript
from moon.oracle.unknowns import Unknown

FEW = 8
"""A draw among so many numbers is followed number by number."""

EventKey = tuple[EventKind, str]
Action = Callable[["Step"], None]


class Output:
    """Something a machine sends, as the model says it."""

    __slots__ = ("fields", "goal", "interface", "kind", "position", "thread", "transition")

    def __init__(
        self,
        kind: OutputKind,
        interface: str,
        fields: Any,
        goal: Any,
        thread: Any,
        position: Position,
        transition: Position,
    ) -> None:
        self.kind = kind
        self.interface = interface
        self.fields = fields
        self.goal = goal
        self.thread = thread
        self.position = position
        self.transition = transition


class Delayed:
    """A timer that a step starts: an ``after`` transition, or an event sent to oneself."""

    __slots__ = ("data", "delay_s", "event", "id")

    def __init__(self, event: EventKey, delay_s: Any, data: Any, identifier: str) -> None:
        self.event = event
        self.delay_s = delay_s
        self.data = data
        self.id = identifier


class Step:
    """A macrostep being taken: what changes, and what comes of it."""

    __slots__ = (
        "_position",
        "data",
        "effect",
        "internal",
        "message",
        "outputs",
        "parts",
        "scheduled",
        "state",
        "tape",
        "transition",
    )

    def __init__(
        self, state: int, data: tuple[Any, ...], message: Any, parts: Mapping[str, Any], tape: Any
    ) -> None:
        self.state = state
        self.data = list(data)
        self.message = message
        self.parts = parts
        self.tape = tape
        self._position = 0
        self.outputs: list[Output] = []
        self.scheduled: list[Delayed | str] = []
        """In order: what is started, and the ids of what is cancelled."""
        self.internal: deque[tuple[str, Any]] = deque()
        self.transition: Position | None = None
        self.effect: Any = None
        """Kept by who takes this step again and again; see ``moon.oracle.deterministic_successor``."""

    def choose(self, count: int) -> int:
        """Which of ``count`` outcomes this pass follows."""
        if self._position == len(self.tape):
            self.tape.append([0, count])
        pick: int = self.tape[self._position][0]
        self._position += 1
        return pick

    def either(self) -> bool:
        """A condition that can go either way."""
        return self.choose(2) == 0

    def settled(self, value: Any) -> Any:
        """``value``; if it is one of a few numbers, each of them in turn: ranges forget that two
        unknown values are the same one.
        """
        if value.__class__ is not Unknown or not value.integer:
            return value
        count = value.high - value.low + 1
        if not count <= FEW:
            return value
        number = int(value.low) + self.choose(int(count))
        self.replace(value, number)
        return number

    def replace(self, unknown: Unknown, value: Any) -> None:
        """From now on, ``unknown`` is known to be ``value``."""
        data = self.data
        for place, held in enumerate(data):
            if held is unknown:
                data[place] = value


class TransitionProgram:
    """A transition ready to be taken."""

    __slots__ = ("body", "condition", "event", "leaves", "position", "targets")

    def __init__(
        self,
        event: EventKey | None,
        condition: Callable[[Step], bool] | None,
        body: Action | None,
        targets: list[tuple[int, Action | None]],
        position: Position,
    ) -> None:
        self.event = event
        self.condition = condition
        self.body = body
        self.targets = targets
        self.leaves = bool(targets)
        self.position = position


class StateProgram:
    """A state ready to be entered and left."""

    __slots__ = ("by_event", "delays", "enter", "eventless", "internal", "leave", "name", "timers")

    def __init__(self, name: str) -> None:
        self.name = name
        self.enter: Action | None = None
        self.leave: Action | None = None
        self.delays: list[tuple[EventKey, float]] = []
        self.by_event: dict[EventKey, list[TransitionProgram]] = {}
        self.eventless: list[TransitionProgram] = []
        self.internal: list[tuple[str, TransitionProgram]] = []
        self.timers: frozenset[str] = frozenset()


def holds(step: Step, condition: Callable[[Step], bool]) -> bool:
    """Whether ``condition`` holds; one that fails does not, and is an error of the machine's."""
    try:
        return condition(step)
    except ecmascript.ExecutionError:
        step.internal.append(("error.execution", None))
        return False
