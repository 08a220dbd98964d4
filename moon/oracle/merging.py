"""One hypothesis for several: what is followed where there are too many to be told apart.

Each hypothesis is replaced by one that allows whatever it allows, and more: whether, when and how often an
event comes that the machine sent itself is left open (``PendingTimer.perhaps``). Two that differ in nothing
but their data become one, in which what differs is unknown. So there are about as many as the machine has
states. That can hide a fault, and never makes one up.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from m2c.model.machine import EventKind
from moon.oracle.state import (
    Goal,
    Hypothesis,
    Obligation,
    PendingTimer,
    QueuedEvent,
    spans,
)
from moon.oracle.unknowns import SCALARS, Unknown, covers, frozen, is_unknown, like, unshared
from transports.actions.rules import Phase


def vague(hypothesis: Hypothesis, since_ns: int) -> Hypothesis:
    """``hypothesis``, without how often and when the events come that the machine sent itself.

    Nor does it say which goals the machine sent before anything was known of it.

    Args:
        hypothesis: what the machine may be doing.
        since_ns: since when such hypotheses are followed, ns.
    """
    made = hypothesis.copy()
    made.vague = max(hypothesis.vague, since_ns)
    left: list[PendingTimer] = []
    perhaps: dict[tuple[Any, ...], PendingTimer] = {}
    for timer in hypothesis.timers:
        if not timer.is_certain or _is_sent(timer):
            _put(perhaps, timer)
        else:
            left.append(timer)
    for queued in hypothesis.queue:
        if queued.event[0] is EventKind.INTERNAL:
            _put(perhaps, _as_timer(queued))
    # a goal that somebody sent before may be the machine's whenever it is heard of
    if hypothesis.free:
        made.goals = tuple(goal for goal in hypothesis.goals if not _is_presumed(goal))
    if perhaps:
        made.timers = (*left, *(perhaps[place] for place in sorted(perhaps)))
        made.queue = tuple(
            queued for queued in hypothesis.queue if queued.event[0] is not EventKind.INTERNAL
        )
    return made


def is_exact(hypothesis: Hypothesis) -> bool:
    """Whether nothing that it says is left open any more."""
    if any(timer.perhaps for timer in hypothesis.timers):
        return False
    values = [
        *(data for _, data in hypothesis.instances),
        *((owed.data, owed.goal) for owed in hypothesis.owed),
        *((queued.message, queued.parts) for queued in hypothesis.queue),
        *(timer.data for timer in hypothesis.timers),
    ]
    return not is_unknown(values)


def _is_presumed(goal: Goal) -> bool:
    """Whether it runs and was perhaps sent by the machine, before anything was known of it."""
    return not goal.served and goal.number < 0 and goal.phase is Phase.RUNNING and not goal.cancel


def _is_sent(timer: PendingTimer) -> bool:
    """Whether it is an event that the machine sent itself."""
    return not timer.period and timer.event[0] is EventKind.INTERNAL


def _as_timer(queued: QueuedEvent) -> PendingTimer:
    return PendingTimer(
        queued.instance, queued.event, queued.low, queued.high, 0, queued.message, "", True
    )


def _place(timer: PendingTimer) -> tuple[Any, ...]:
    return (timer.instance, timer.event, timer.id)


def _put(perhaps: dict[tuple[Any, ...], PendingTimer], timer: PendingTimer) -> None:
    place = _place(timer)
    known = perhaps.get(place)
    perhaps[place] = _either(known, timer) if known is not None else _either(timer, timer)


def _either(first: PendingTimer, second: PendingTimer) -> PendingTimer:
    """What rings whenever one of two may; ``first`` if that is it."""
    data = _value(first.data, second.data, None)
    low, high = min(first.low, second.low), max(first.high, second.high)
    if first.perhaps and data is first.data and (low, high) == (first.low, first.high):
        return first
    return PendingTimer(first.instance, first.event, low, high, 0, data, first.id, True)


def place_of(hypothesis: Hypothesis) -> Any:
    """What two hypotheses must share to become one: all but their data, and what may come perhaps."""
    numbers: dict[int, int] = {}
    return (
        tuple(map(id, hypothesis.pending)),
        tuple([state for state, _ in hypothesis.instances]),
        tuple([_form(owed, numbers) for owed in hypothesis.owed]),
        tuple([queued.key(numbers) for queued in hypothesis.queue]),
        tuple([timer.key(numbers) for timer in hypothesis.timers if not timer.perhaps]),
        hypothesis.waiting,
        tuple([goal.form(numbers) for goal in hypothesis.goals]),
        hypothesis.free,
    )


def _form(owed: Obligation, numbers: dict[int, int]) -> tuple[Any, ...]:
    goal = frozen(owed.goal, numbers)
    return (owed.kind, owed.interface, owed.call, goal, owed.optional, owed.timer, owed.transition)


def joined(
    first: Hypothesis, second: Hypothesis, unknown: Sequence[tuple[Any, ...]]
) -> Hypothesis | None:
    """One for two of the same place; None: ``first`` allows all that ``second`` does.

    Args:
        first: as it was made by this function, or is ``vague``.
        second: another.
        unknown: the data of each instance when nothing is known of it.
    """
    moment = min(first.moment, second.moment)
    if not _differ_in_scalars(first, second) and first.key() == second.key():
        wide = first.merged(second)
    else:
        wide = _with_data(first, second, unknown)
    if wide is None:
        return None
    wide.moment, wide.vague = moment, max(first.vague, second.vague)
    return wide


def _differ_in_scalars(first: Hypothesis, second: Hypothesis) -> bool:
    """Whether their data differ in a scalar: their keys do so, too, and need not be made."""
    for (_, mine), (_, its) in zip(first.instances, second.instances, strict=True):
        for old, new in zip(mine, its, strict=True):
            are_scalars = old.__class__ in SCALARS and new.__class__ in SCALARS
            if old is not new and are_scalars and old != new:
                return True
    return False


def _with_data(
    first: Hypothesis, second: Hypothesis, unknown: Sequence[tuple[Any, ...]]
) -> Hypothesis | None:
    kept: dict[int, int] = {}
    for mine, its in zip(_kept(first), _kept(second), strict=True):
        _note_unknown(mine, its, kept)
    seen = set(kept)
    is_same = second.moment >= first.moment
    instances: list[tuple[int, tuple[Any, ...]]] = []
    for known, (_, its), tops in zip(first.instances, second.instances, unknown, strict=True):
        values = _data(known[1], its, tops, kept, seen)
        is_same = is_same and values is known[1]
        instances.append(known if values is known[1] else (known[0], values))
    owed = []
    for mine, its in zip(first.owed, second.owed, strict=True):
        both = mine.also_from(its).due(min(mine.low, its.low), max(mine.high, its.high))
        both.data = _joined(mine.data, its.data, None, seen)
        is_same = (
            is_same and both.data is mine.data and (both.low, both.high) == (mine.low, mine.high)
        )
        owed.append(both)
    made = first.copy()
    made.instances, made.owed = tuple(instances), tuple(owed)
    made.queue = spans(first.queue, second.queue)
    made.timers = _timers(first.timers, second.timers)
    made.goals = tuple([_goal(*both, seen) for both in zip(first.goals, second.goals, strict=True)])
    is_same = (
        is_same
        and made.queue is first.queue
        and _are_same(made.timers, first.timers)
        and _are_same(made.goals, first.goals)
    )
    return None if is_same else made


def _data(
    first: tuple[Any, ...],
    second: tuple[Any, ...],
    tops: tuple[Any, ...],
    kept: dict[int, int],
    seen: set[int],
) -> tuple[Any, ...]:
    """The data of an instance for those of two; ``first`` if they allow ``second``.

    Args:
        first: of one hypothesis.
        second: of another.
        tops: when nothing is known of them.
        kept: see ``_note_unknown``: in both it is what a goal is called, say.
        seen: see ``_joined``.
    """
    values: list[Any] = []
    is_same = True
    for mine, its, top in zip(first, second, tops, strict=True):
        if mine is its and mine.__class__ in SCALARS:
            values.append(mine)
            continue
        value = mine if kept.get(id(mine)) == id(its) else _joined(mine, its, top, seen)
        is_same = is_same and value is mine
        values.append(value)
    return first if is_same else tuple(values)


def _are_same(made: tuple[Any, ...], before: tuple[Any, ...]) -> bool:
    """Whether all are the very same."""
    return len(made) == len(before) and all(
        mine is its for mine, its in zip(made, before, strict=True)
    )


def _kept(hypothesis: Hypothesis) -> list[Any]:
    """What has to be the same in two of the same place, but for which unknown values they are."""
    return [
        *[owed.goal for owed in hypothesis.owed],
        *[(queued.message, queued.parts) for queued in hypothesis.queue],
        *[timer.data for timer in hypothesis.timers if not timer.perhaps],
        *[goal.name for goal in hypothesis.goals],
    ]


def _note_unknown(first: Any, second: Any, pairs: dict[int, int]) -> None:
    """Add to ``pairs`` the unknown values of ``first``, each with what is in its place in ``second``."""
    if first.__class__ is Unknown:
        pairs[id(first)] = id(second)
    elif first.__class__ is dict:
        for name, item in first.items():
            _note_unknown(item, second[name], pairs)
    elif isinstance(first, list | tuple):
        for mine, its in zip(first, second, strict=True):
            _note_unknown(mine, its, pairs)


def _joined(first: Any, second: Any, top: Any, seen: set[int]) -> Any:
    """A value that allows both, and of which nothing else is a part: ``seen`` are the unknown ones so far."""
    return unshared(_value(first, second, top), seen)


def _goal(first: Goal, second: Goal, seen: set[int]) -> Goal:
    """One goal for two of which nothing differs but the message that it ended with."""
    if first.result is None or second.result is None:
        return first
    message = _joined(first.result[1], second.result[1], None, seen)
    if message is first.result[1]:
        return first
    return first.but(result=(first.result[0], message))


def _timers(
    first: tuple[PendingTimer, ...], second: tuple[PendingTimer, ...]
) -> tuple[PendingTimer, ...]:
    """Of two: those of both that certainly run, and all that perhaps do."""
    certain = zip(
        [timer for timer in first if not timer.perhaps],
        [timer for timer in second if not timer.perhaps],
        strict=True,
    )
    left = [
        mine
        if mine.low <= its.low and mine.high >= its.high
        else mine.due(min(mine.low, its.low), max(mine.high, its.high))
        for mine, its in certain
    ]
    perhaps: dict[tuple[Any, ...], PendingTimer] = {}
    for timer in (*first, *second):
        if timer.perhaps:
            _put(perhaps, timer)
    return (*left, *(perhaps[place] for place in sorted(perhaps)))


def _value(first: Any, second: Any, top: Any) -> Any:
    """What allows both values; ``first`` if it does.

    Args:
        first: a value.
        second: another.
        top: the value of which nothing is known but its type; None: not even that is known.
    """
    if first is second or covers(first, second):
        return first
    if first.__class__ is dict and second.__class__ is dict and first.keys() == second.keys():
        tops = top if top.__class__ is dict and top.keys() == first.keys() else {}
        made = {name: _value(item, second[name], tops.get(name)) for name, item in first.items()}
        return first if all(made[name] is first[name] for name in made) else made
    return like(top)
