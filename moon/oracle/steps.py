"""A macrostep of a machine while it is taken: what changes, and what comes of it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from m2c.diagnostics import Position
from m2c.language.conversion import ExecutionError
from m2c.model.machine import OutputKind
from moon.oracle.trace_events import EventKey
from moon.oracle.unknowns import SCALARS, Unknown, filled_in, is_unknown, renamed

FEW = 8
"""A draw among so many numbers is followed number by number."""

QUEUED_OUTPUTS = (OutputKind.START_THREAD, OutputKind.THREAD_FREE)
"""Outputs that the node queues as events of the machine or of its threads."""

_NO_ANSWERS: dict[int, list[tuple[Any, ...]]] = {}
"""Of a step that asks nothing; never changed."""


class TooOpenError(Exception):
    """A step has more outcomes than can be followed."""


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

    def renamed(self, found: dict[int, tuple[Unknown, Any]]) -> Output:
        """The same with other unknown values; see ``Step.renamed``."""
        return Output(
            self.kind,
            self.interface,
            renamed(self.fields, found),
            renamed(self.goal, found),
            renamed(self.thread, found),
            self.position,
            self.transition,
        )


class Delayed:
    """A timer that a step starts: an ``after`` transition, or an event sent to oneself."""

    __slots__ = ("data", "delay_s", "event", "id")

    def __init__(self, event: EventKey, delay_s: Any, data: Any, identifier: str) -> None:
        self.event = event
        self.delay_s = delay_s
        self.data = data
        self.id = identifier

    def renamed(self, found: dict[int, tuple[Unknown, Any]]) -> Delayed:
        """The same with other unknown values; see ``Step.renamed``."""
        return Delayed(self.event, renamed(self.delay_s, found), renamed(self.data, found), self.id)


class Step:
    """A macrostep being taken: what changes, and what comes of it."""

    __slots__ = (
        "_answers",
        "_known",
        "_position",
        "asked",
        "data",
        "effect",
        "element",
        "internal",
        "length",
        "message",
        "outputs",
        "parts",
        "places",
        "scheduled",
        "state",
        "tape",
        "tested",
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
        self._known: dict[Any, tuple[tuple[Any, ...], Any]] | None = None
        """What was found of unknown values: by the question, these values, and the answer."""
        self._answers: dict[int, list[tuple[Any, ...]]] = _NO_ANSWERS
        """The questions whose answer is an unknown value, by its identity."""
        self.length = 0
        """How many eventless transitions and internal events it has had."""
        self.outputs: list[Output] = []
        self.scheduled: list[Delayed | Output | str] = []
        """In order: what is started, outputs that are events of its own parts, and the ids of what is
        cancelled.
        """
        self.internal: deque[tuple[str, Any]] = deque()
        self.transition: Position | None = None
        """The last transition taken, of those on internal events too; None: nothing has changed."""
        self.tested: dict[int, bool | None] = {}
        """What conditions came to since the last transition was taken; None: they failed."""
        self.asked = 0
        """How often a condition was evaluated whose outcome is not among these."""
        self.element: Any = None
        """What the innermost loop is at, as it begins its next round."""
        self.places: tuple[int, ...] = ()
        """The indices that the functions of ``Array.from`` are called with, the outermost first."""
        self.effect: Any = None
        """Kept by who takes this step again and again; see ``moon.oracle.search.Effect``."""

    def renamed(self, found: dict[int, tuple[Unknown, Any]]) -> Step:
        """The same step of other unknown values: what is to be taken from it, once it is over.

        Args:
            found: for each unknown value that it began with, by identity, the one that takes its place.
        """
        made = Step(
            self.state, tuple([renamed(value, found) for value in self.data]), None, {}, None
        )
        made.transition, made.length = self.transition, self.length
        for output in self.outputs:
            made.outputs.append(output.renamed(found))
        for item in self.scheduled:
            made.scheduled.append(item if isinstance(item, str) else item.renamed(found))
        return made

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

    def whether(self, question: str, *values: Any) -> bool:
        """A condition on ``values`` that can go either way; asked again, it goes the same way."""
        return bool(self.found(question, values, self.either))

    def found(self, question: str, values: tuple[Any, ...], find: Callable[[], Any]) -> Any:
        """What ``find`` made of the first ``question`` on the same ``values``, some of them unknown."""
        place: list[Any] = [question]
        for value in values:
            if value.__class__ is Unknown:
                place.append(id(value))
            elif value.__class__ in SCALARS:
                place += (value.__class__, repr(value))
            else:
                return find()  # it may change
        known = self._known
        if known is None:
            known = self._known = {}
            self._answers = {}
        key = tuple(place)
        if key not in known:
            answer = find()
            known[key] = (values, answer)
            self._note_answer(key, answer)
        return known[key][1]

    def _note_answer(self, key: tuple[Any, ...], answer: Any) -> None:
        if answer.__class__ is Unknown:
            self._answers.setdefault(id(answer), []).append(key)

    def enumerated(self, value: Any) -> Any:
        """``value``; if it is one of a few numbers, each of them in turn: ranges forget that two
        unknown values are the same one.
        """
        if value.__class__ is not Unknown:
            return value
        if value.options:
            if len(value.options) > FEW or is_unknown(value.options):
                return value
            number = value.options[self.choose(len(value.options))]
        else:
            count = value.high - value.low + 1
            if not value.integer or not count <= FEW:
                return value
            number = int(value.low) + self.choose(int(count))
        self.replace(value, number)
        return number

    def every(self, evaluate: Callable[[Step], Any], most: int) -> tuple[list[Any], bool]:
        """What ``evaluate`` can give here, each way that chance can go, and whether it may fail.

        This step is as before: what was found of values on the way is forgotten. More than ``most`` values
        are one of which nothing is known.
        """
        tape: list[list[int]] = []
        found: list[Any] = []
        fails = False
        for _ in range(most):
            trial = Step(self.state, tuple(self.data), self.message, self.parts, tape)
            trial.places = self.places
            try:
                found.append(evaluate(trial))
            except ExecutionError:
                fails = True
            while tape and tape[-1][0] + 1 == tape[-1][1]:
                tape.pop()
            if not tape:
                return found, fails
            tape[-1][0] += 1
        return [Unknown(anything=True)], True

    def replace(self, unknown: Unknown, value: Any) -> None:
        """From now on, ``unknown`` is known to be ``value``: also in what the step has sent before."""
        found = {id(unknown): (unknown, value)}
        self.data = [filled_in(held, found) for held in self.data]
        self.message = filled_in(self.message, found)
        for output in self.outputs:
            output.fields = filled_in(output.fields, found)
            output.goal = filled_in(output.goal, found)
            output.thread = filled_in(output.thread, found)
        for index, (name, data) in enumerate(self.internal):
            self.internal[index] = (name, filled_in(data, found))
        for item in self.scheduled:
            if isinstance(item, Delayed):
                item.data = filled_in(item.data, found)
        if self._known is not None:
            for key in self._answers.pop(id(unknown), ()):
                self._known[key] = (self._known[key][0], value)
                self._note_answer(key, value)
