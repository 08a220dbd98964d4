"""The states that are searched: what a machine may be doing, one hypothesis each, and what it owes.

A hypothesis is (configuration, datamodel, inputs not yet taken, outputs still owed); design, section 6.
Hypotheses are values: nothing in them changes once they are made. Goals of actions, served or sent, are
part of them.
"""

from __future__ import annotations

from typing import Any

from m2c.diagnostics import Position
from m2c.model.machine import OutputKind
from moon.oracle.calls import Call
from moon.oracle.steps import Output
from moon.oracle.trace_events import EventKey, TraceEvent
from moon.oracle.unknowns import SCALARS, Unknown, frozen
from transports.actions.rules import Act, Phase, Stamp, after, forgotten

ANY_CALL: Call = ("", -1, 0)
"""Whose response is owed when the request came before the oracle looked."""

Instances = tuple[tuple[int, tuple[Any, ...]], ...]
"""State and datamodel of the machine and of each of its action threads."""

MAX_BEFORE = 4
"""So many configurations from which a step led to the same one are kept, for explanations."""


class Obligation:
    """An output that must be seen next.

    Attributes:
        low, high: the step that owes it was taken between these times (ns).
        call: whose response it is.
        goal: hex id of its goal, a goal's number where the id is not known yet, or Unknown.
        optional: whether it may not have been sent at all.
        timer: the timer that caused the step, whose phase the output shows.
        before: what the machine was before the step, for explanations: each possibility.
    """

    __slots__ = (
        "before",
        "call",
        "data",
        "goal",
        "high",
        "interface",
        "kind",
        "low",
        "optional",
        "position",
        "timer",
        "transition",
    )

    def __init__(
        self,
        kind: OutputKind,
        interface: str,
        data: Any,
        low: int,
        high: int,
        position: Position,
        transition: Position,
        call: Call | None = None,
        goal: Any = None,
        optional: bool = False,
        timer: TimerKey | None = None,
        before: tuple[Instances, ...] = (),
    ) -> None:
        self.kind = kind
        self.interface = interface
        self.data = data
        self.low = low
        self.high = high
        self.position = position
        self.transition = transition
        self.call = call
        self.goal = goal
        self.optional = optional
        self.timer = timer
        self.before = before

    def also_from(self, other: Obligation) -> Obligation:
        """The same output, that may be owed from where ``other`` of the same key is, too."""
        others = tuple(item for item in other.before if item not in self.before)
        if not others or len(self.before) >= MAX_BEFORE:
            return self
        made = self.due(self.low, self.high)
        made.before = (*self.before, *others)[:MAX_BEFORE]
        return made

    def due(self, low: int, high: int) -> Obligation:
        """The same output, of a step taken between ``low`` and ``high``."""
        return Obligation(
            self.kind,
            self.interface,
            self.data,
            low,
            high,
            self.position,
            self.transition,
            self.call,
            self.goal,
            self.optional,
            self.timer,
            self.before,
        )

    def key(self, numbers: dict[int, int]) -> tuple[Any, ...]:
        """What two owed outputs must share to be the same; ``numbers``: see ``frozen``."""
        data, goal = frozen(self.data, numbers), frozen(self.goal, numbers)
        return (self.kind, self.interface, data, self.call, goal, self.optional)


TimerKey = tuple[int, EventKey]


class PendingTimer:
    """A timer that runs: a periodic one, an ``after`` transition or a delayed event.

    Attributes:
        instance: whose it is (0: the machine; 1…: its action threads).
        event: what happens when it is due.
        low, high: it is due between these times (ns).
        period: ns; 0 for once.
        data: of a delayed event.
        id: by which it is cancelled.
        perhaps: whether it rings between these times as often as it likes, or not at all: what stands for
            timers of which it is not known how many there are.
        optional: whether it rings once between these times, or not at all: it may have rung before, in a
            state in which that has no effect.
    """

    __slots__ = ("data", "event", "high", "id", "instance", "low", "optional", "perhaps", "period")

    def __init__(
        self,
        instance: int,
        event: EventKey,
        low: int,
        high: int,
        period: int = 0,
        data: Any = None,
        identifier: str = "",
        perhaps: bool = False,
        optional: bool = False,
    ) -> None:
        self.instance = instance
        self.event = event
        self.low = low
        self.high = high
        self.period = period
        self.data = data
        self.id = identifier
        self.perhaps = perhaps
        self.optional = optional

    @property
    def is_certain(self) -> bool:
        """Whether it rings between these times."""
        return not self.perhaps and not self.optional

    def key(self, numbers: dict[int, int]) -> tuple[Any, ...]:
        """What two timers must share to be the same; ``numbers``: see ``frozen``."""
        data = frozen(self.data, numbers)
        return (self.instance, self.event, self.id, data, self.perhaps, self.optional)

    def due(self, low: int, high: int) -> PendingTimer:
        """The same timer, due between ``low`` and ``high``."""
        return PendingTimer(
            self.instance,
            self.event,
            low,
            high,
            self.period,
            self.data,
            self.id,
            self.perhaps,
            self.optional,
        )

    def as_optional(self) -> PendingTimer:
        """The same timer, which may have rung already, without effect."""
        made = self.due(self.low, self.high)
        made.optional = True
        return made

    def not_before(self, limit: int) -> PendingTimer:
        """The same periodic timer, without the times that were over before ``limit``."""
        if self.high >= limit:
            return self
        missed = ((limit - self.high - 1) // self.period + 1) * self.period
        return self.due(self.low + missed, self.high + missed)


class QueuedEvent:
    """An event that the machine sent itself, on its executor's queue."""

    __slots__ = ("event", "high", "instance", "low", "message", "parts")

    def __init__(
        self,
        instance: int,
        event: EventKey,
        message: Any,
        parts: dict[str, Any],
        low: int,
        high: int,
    ) -> None:
        self.instance = instance
        self.event = event
        self.message = message
        self.parts = parts
        self.low = low
        self.high = high

    def key(self, numbers: dict[int, int]) -> tuple[Any, ...]:
        """What two events must share to be the same; ``numbers``: see ``frozen``."""
        message, parts = frozen(self.message, numbers), frozen(self.parts, numbers)
        return (self.instance, self.event, message, parts)

    def due(self, low: int, high: int) -> QueuedEvent:
        """The same event, sent between ``low`` and ``high``."""
        return QueuedEvent(self.instance, self.event, self.message, self.parts, low, high)


class Goal:
    """A goal that the machine serves or sent.

    Attributes:
        number: as the oracle counts them; below 0 for one from before it looked.
        name: as the model counts them; Unknown where goals may have come before the oracle looked.
        id: hex id; "" where it is not known yet.
        phase: where it stands; one that the machine sent is new until it is accepted.
        stamp: when it was accepted, as the server told its client; None: not known.
        seen: whether its end was observed.
        result: (kind, message) of its end.
        cancel: whether it is to be cancelled once it is accepted; None: perhaps.
    """

    __slots__ = (
        "_key",
        "cancel",
        "id",
        "interface",
        "name",
        "number",
        "phase",
        "result",
        "seen",
        "served",
        "stamp",
    )

    def __init__(
        self,
        interface: str,
        served: bool,
        number: int,
        identifier: str,
        phase: Phase,
        result: tuple[OutputKind, Any] | None = None,
        seen: bool = False,
        cancel: bool | None = False,
        stamp: Stamp | None = None,
        name: Any = None,
    ) -> None:
        self.interface = interface
        self.served = served
        self.number = number
        self.id = identifier
        self.phase = phase
        self.result = result
        self.seen = seen
        self.cancel = cancel
        self.stamp = stamp
        self.name = number if name is None else name
        self._key: tuple[Any, ...] | None = None

    def but(self, **changes: Any) -> Goal:
        """The same goal with ``changes``."""
        fields = {
            "identifier": self.id,
            "phase": self.phase,
            "result": self.result,
            "seen": self.seen,
            "cancel": self.cancel,
            "stamp": self.stamp,
            "name": self.name,
            **changes,
        }
        return Goal(self.interface, self.served, self.number, **fields)

    def is_same(self, other: Goal) -> bool:
        """Whether ``other`` is this goal, at some time."""
        return (
            self.number == other.number
            and self.served is other.served
            and self.interface == other.interface
        )

    def key(self, numbers: dict[int, int]) -> tuple[Any, ...]:
        """What two goals must share to be the same; ``numbers``: see ``frozen``."""
        if self.result is None:
            return self.form(numbers)
        return (*self.form(numbers), frozen(self.result[1], numbers))

    def form(self, numbers: dict[int, int]) -> tuple[Any, ...]:
        """The same without the message that it ended with."""
        if self.name.__class__ is Unknown:
            return (*self._fixed_key(), frozen(self.name, numbers))
        return self._fixed_key()

    def _fixed_key(self) -> tuple[Any, ...]:
        if self._key is None:
            self._key = (
                self.interface,
                self.served,
                self.number,
                self.id,
                self.phase,
                self.seen,
                self.cancel,
                self.stamp,
                None if self.result is None else self.result[0],
            )
        return self._key


class Hypothesis:
    """One thing that the machine may be doing.

    Attributes:
        instances: (state, datamodel) of the machine and of each of its action threads.
        owed: outputs that must come next, in order.
        pending: messages that may not have been taken yet, in order of their stamps.
        queue: events that it sent itself and has not taken yet, in order.
        timers: timers that run.
        waiting: (interface, call) of requests not answered, in order.
        goals: goals served or sent, not forgotten.
        counts: how many goals each action interface has had: ((served, interface), number)…
        moment: the last step was taken at this time at the earliest (ns).
        free: whether requests and goals from before the oracle looked may be under way.
        vague: since when (ns) it stands for several of which there were too many (``merging``); 0: it does
            not.
    """

    __slots__ = (
        "_key",
        "counts",
        "free",
        "goals",
        "instances",
        "moment",
        "owed",
        "pending",
        "queue",
        "timers",
        "vague",
        "waiting",
    )

    def __init__(
        self,
        instances: Instances,
        owed: tuple[Obligation, ...] = (),
        pending: tuple[TraceEvent, ...] = (),
        queue: tuple[QueuedEvent, ...] = (),
        timers: tuple[PendingTimer, ...] = (),
        waiting: tuple[tuple[str, Call], ...] = (),
        goals: tuple[Goal, ...] = (),
        counts: tuple[tuple[tuple[bool, str], int], ...] = (),
        free: bool = False,
        moment: int = 0,
        vague: int = 0,
    ) -> None:
        self.instances = instances
        self.owed = owed
        self.pending = pending
        self.queue = queue
        self.timers = timers
        self.waiting = waiting
        self.goals = goals
        self.counts = counts
        self.free = free
        self.moment = moment
        self.vague = vague
        self._key: Any = None

    def key(self) -> Any:
        """What two hypotheses must share to be one; times of timers are left out."""
        if self._key is None:
            numbers: dict[int, int] = {}
            self._key = (
                tuple(map(id, self.pending)) if self.pending else (),
                _data_key(self.instances, numbers),
                tuple(owed.key(numbers) for owed in self.owed) if self.owed else (),
                tuple(event.key(numbers) for event in self.queue) if self.queue else (),
                tuple(timer.key(numbers) for timer in self.timers) if self.timers else (),
                self.waiting,
                tuple(goal.key(numbers) for goal in self.goals) if self.goals else (),
                self.free,
            )
        return self._key

    def forget_key(self) -> None:
        """It was changed."""
        self._key = None

    def copy(self) -> Hypothesis:
        """A hypothesis to be changed before anybody else sees it."""
        return Hypothesis(
            self.instances,
            self.owed,
            self.pending,
            self.queue,
            self.timers,
            self.waiting,
            self.goals,
            self.counts,
            self.free,
            self.moment,
            self.vague,
        )

    def but(self, **changes: Any) -> Hypothesis:
        """The same, with ``changes``."""
        made = self.copy()
        for name, value in changes.items():
            setattr(made, name, value)
        return made

    def with_pending(self, pending: tuple[TraceEvent, ...]) -> Hypothesis:
        """The same, with other messages under way."""
        made = self.copy()
        made.pending = pending
        return made

    def with_owed(self, owed: tuple[Obligation, ...]) -> Hypothesis:
        """The same, owing something else."""
        made = self.copy()
        made.owed = owed
        return made

    def with_timers(self, timers: tuple[PendingTimer, ...]) -> Hypothesis:
        """The same, with other timers."""
        made = self.copy()
        made.timers = timers
        return made

    def merged(self, other: Hypothesis) -> Hypothesis | None:
        """One hypothesis for both of one key: whichever times either allows. None: self has all."""
        sooner = other.moment < self.moment
        if not sooner and not self.timers and not self.queue and not self.owed:
            return None
        timers = spans(self.timers, other.timers)
        queue = spans(self.queue, other.queue)
        owed = spans(self.owed, other.owed)
        same = timers is self.timers and queue is self.queue and owed is self.owed
        if same and not sooner:
            return None
        made = self.copy()
        made.owed, made.queue, made.timers = owed, queue, timers
        made.moment = min(self.moment, other.moment)
        made.vague = max(self.vague, other.vague)
        return made.also_from(other)

    def also_from(self, other: Hypothesis) -> Hypothesis:
        """The same; what it owes may be owed from where ``other`` of the same key does, too."""
        if not self.owed:
            return self
        owed = tuple(mine.also_from(its) for mine, its in zip(self.owed, other.owed, strict=True))
        if all(mine is before for mine, before in zip(owed, self.owed, strict=True)):
            return self
        return self.with_owed(owed)

    def allows(self, other: Hypothesis) -> bool:
        """Whether the timers of ``other``, which has the same key, can ring when this one's can, too."""
        mine, theirs = self.timers, other.timers
        return all(
            a.low <= b.low and a.high >= b.high for a, b in zip(mine, theirs, strict=True)
        ) and all(
            a.low <= b.low and a.high >= b.high
            for a, b in zip(self.queue, other.queue, strict=True)
        )


Timed = Any
"""An ``Obligation``, ``PendingTimer`` or ``QueuedEvent``: mypyc cannot compile a
function over a variable of those types."""


def spans(mine: tuple[Timed, ...], theirs: tuple[Timed, ...]) -> tuple[Timed, ...]:
    """``mine``, each with all the times that its like in ``theirs`` allows; ``mine`` if it has."""
    if all(a.low <= b.low and a.high >= b.high for a, b in zip(mine, theirs, strict=True)):
        return mine
    made: list[Any] = []
    for first, second in zip(mine, theirs, strict=True):
        made.append(first.due(min(first.low, second.low), max(first.high, second.high)))
    return tuple(made)


def _data_key(instances: Instances, numbers: dict[int, int]) -> Any:
    for _, data in instances:
        for value in data:
            # arrays, structures, unknown values; 0.0 is not -0.0
            if value.__class__ not in SCALARS or (value.__class__ is float and not value):
                return frozen(instances, numbers)
    return instances


def distinct(made: list[Hypothesis]) -> list[Hypothesis]:
    """Each hypothesis once."""
    if len(made) <= 1:
        return made
    found: dict[Any, Hypothesis] = {}
    for hypothesis in made:
        put_in(found, hypothesis)
    return list(found.values())


def put_in(found: dict[Any, Hypothesis], made: Hypothesis) -> None:
    """``made`` among those ``found``: one of its key has the times of both."""
    key = made.key()
    before = found.get(key)
    found[key] = made if before is None else before.merged(made) or before.also_from(made)


# --- goals ----------------------------------------------------------------------------------------

_ACTS = {
    OutputKind.ACCEPT_GOAL: Act.ACCEPT,
    OutputKind.REJECT_GOAL: Act.REJECT,
    OutputKind.FEEDBACK: Act.FEEDBACK,
    OutputKind.SUCCEED: Act.SUCCEED,
    OutputKind.ABORT: Act.ABORT,
    OutputKind.CANCEL: Act.CANCEL,
}


def goal_called(hypothesis: Hypothesis, interface: str, goal_id: str, served: bool) -> Goal | None:
    """The goal of ``interface`` with this id, served or sent; None if that is "": it is not known then."""
    for goal in hypothesis.goals if goal_id else ():
        if goal.served is served and goal.id == goal_id and goal.interface == interface:
            return goal
    return None


def goal_allows(made: Hypothesis, goal: Goal, output: Output) -> bool:
    """Whether the goal's phase lets the output leave (``transports.actions.rules``); it is changed then."""
    phase = after(goal.phase, _ACTS[output.kind])
    if phase is None:
        return False
    if phase is Phase.REJECTED:
        made.goals = tuple(g for g in made.goals if g is not goal)
    elif phase is Phase.ENDED:
        change_goal(made, goal, phase=phase, result=(output.kind, output.fields))
    elif phase is not goal.phase:
        change_goal(made, goal, phase=phase)
    return True


def change_goal(made: Hypothesis, goal: Goal, **changes: Any) -> None:
    """Change ``goal`` of a hypothesis that is being made."""
    made.goals = tuple(g.but(**changes) if g is goal else g for g in made.goals)


def with_goal_changed(hypothesis: Hypothesis, goal: Goal, **changes: Any) -> Hypothesis:
    """``hypothesis`` with ``goal`` changed."""
    made = hypothesis.copy()
    made.goals = tuple(g.but(**changes) if g.is_same(goal) else g for g in made.goals)
    return made


MOST_GOALS = 2**31 - 1
"""No node has more in its life."""


def any_goal() -> Unknown:
    """How a model may name a goal of which nothing is known."""
    return Unknown(1, MOST_GOALS, integer=True)


def adopt_goal(
    hypothesis: Hypothesis, interface: str, goal_id: str, served: bool, phase: Phase
) -> tuple[Hypothesis, Goal]:
    """``hypothesis`` with a goal from before the oracle looked; it is older than all others.

    ``goal_id``: "" where it is not known.
    """
    unnamed = min([g.number for g in hypothesis.goals if not g.id and g.number < 0], default=0)
    number = -1 - int(goal_id, 16) if goal_id else unnamed - 1
    goal = Goal(interface, served, number, goal_id, phase, name=any_goal())
    made = hypothesis.copy()
    made.goals = (goal, *hypothesis.goals)
    return made, goal


def add_goal(made: Hypothesis, interface: str, goal_id: str, served: bool) -> Goal:
    """A further goal of a hypothesis that is being made, numbered as the node numbers them."""
    counts = dict(made.counts)
    number = counts.get((served, interface), 0) + 1
    counts[served, interface] = number
    name = any_goal() if made.free else number
    goal = Goal(interface, served, number, goal_id, Phase.NEW, name=name)
    made.counts = tuple(sorted(counts.items()))
    gone = set(forgotten(_ended(made, interface))) if served else set()
    if gone:
        kept = (g for g in made.goals if not (g.served and g.id in gone))
        made.goals = (*kept, goal)
    else:
        made.goals = (*made.goals, goal)
    return goal


def _ended(hypothesis: Hypothesis, interface: str) -> list[str]:
    """Ids of the goals of ``interface`` that were served and have ended."""
    return [
        goal.id
        for goal in hypothesis.goals
        if goal.served and goal.phase is Phase.ENDED and goal.interface == interface
    ]


def goal_to_cancel(made: Hypothesis, interface: str, number: Any) -> Goal | None:
    """The goal that a cancel request means; without a number, the last one sent."""
    sent = [g for g in made.goals if not g.served and g.interface == interface]
    if number.__class__ is not Unknown and not number:
        last = dict(made.counts).get((False, interface), 0)
        return next((g for g in sent if g.number == last), None)
    return next((g for g in sent if is_named(g, number)), None)


def perhaps_cancel(made: Hypothesis, interface: str) -> None:
    """A cancel request of a hypothesis that is being made may mean any goal that is not accepted yet."""
    made.goals = tuple(
        goal.but(cancel=None)
        if not (goal.served or goal.cancel)
        and goal.interface == interface
        and goal.phase is Phase.NEW
        else goal
        for goal in made.goals
    )


def served_goal(made: Hypothesis, output: Output) -> Goal | None:
    """The goal that an output of the machine names."""
    for goal in made.goals:
        if goal.served and goal.interface == output.interface and is_named(goal, output.goal):
            return goal
    return None


def is_named(goal: Goal, name: Any) -> bool:
    """Whether ``name`` is certainly that of ``goal``: the same number, or the same unknown one."""
    if goal.name is name:
        return True
    return Unknown not in (goal.name.__class__, name.__class__) and bool(goal.name == name)
