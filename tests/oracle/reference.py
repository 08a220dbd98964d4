"""When a trace conforms to a machine, decided by trying everything. For tests, and small traces.

What is asked is whether the machine *can* have done what was heard (design, section 6):

* The **inputs** of a machine are the messages on topics it subscribes to, the requests it received,
  the responses (or errors) it received, and the ticks of its timers. It takes them one at a time;
  each take is a run to completion, which owes outputs in order.
* The **outputs** are what it published, called and answered itself. The n-th output heard is the
  n-th one owed: same kind, channel and data. The outputs of one take are out before the next input
  is taken; a machine that still owes something takes nothing.
* Every take happens at one moment, and the moments go forward. What the machine heard with its own
  ears (requests, responses) is taken when it is stamped. A message is taken at its stamp or up to
  ``latency_ns`` later; so is tick ``k`` of a timer, whose stamp is ``start_ns + k * period``, give
  or take ``tolerance_ns``; but a machine that was busy then, owing outputs, takes them as soon as
  these are out. Whatever had to be taken before the moment of judging, ``end_ns``, has been taken.
* A machine that did nothing for longer than ``latency_ns`` may have stood still (``stands_still``): what was
  due in that time is taken up to ``latency_ns`` after it did something again, and ticks may be skipped.
* How far a tick may be from its time may add up (``adds_up``): then tick ``k`` may be ``k`` times as far.
* An output is heard after the moment of its take, and no later than ``deadline_ns`` after it; one
  that is never heard is not overdue at ``end_ns``.
* Messages of one channel and source are taken in the order of their stamps; so is all that the
  machine heard with its own ears, whatever the channel.
* A delayed event is due its delay after the moment of the take that began it, give or take ``tolerance_ns`` and
  :data:`DRIFT` of the delay, and is taken up to ``latency_ns`` later. That moment lies between two times; that it may have
  been early for one thing and late for another is not noticed.
* Where chance decides, every outcome is possible.

Fields that the model does not set are zero. Channels are reliable. Nothing is cut short: all orders,
all choices. For each order the moments are the earliest, as waiting makes nothing possible but a
late output: its deadline counts from the latest. It is slow on purpose.
"""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Iterable, Sequence
from typing import Any

import msgspec

from m2c.model.machine import Event, EventKind, InterfaceKind, Machine, OutputKind, Raise
from m2c.model.walk import statements_of
from tests.oracle.steps import Call, Configuration, Output, Stepper, Timer
from transports.interface import Observation, ObservationKind

SECOND_NS = 1_000_000_000
DRIFT = 1000
"""A clock may be off by one part of so many, besides ``tolerance_ns``."""

MOST_PLACES = 3_000
"""So many ways are followed of a machine with delays, of which each may begin at several times."""

OWN_EARS = "own ears"
"""The line of what the machine heard itself: it stamps these when it takes them."""

_SENT_AS = {
    OutputKind.PUBLISH: ObservationKind.MESSAGE,
    OutputKind.REQUEST: ObservationKind.REQUEST_SENT,
    OutputKind.RESPONSE: ObservationKind.RESPONSE_SENT,
}


class TooLongError(Exception):
    """A machine with delays can have gone too many ways to try all of them."""


class Input(msgspec.Struct, frozen=True, eq=False):
    """Something to take. Inputs of one ``line`` are taken in the order of ``number``."""

    event: Event
    data: Any
    call: Call | None
    line: str
    number: int
    earliest_ns: int
    latest_ns: int
    may_be_skipped: bool = False


def conforms(
    machine: Machine,
    trace: Sequence[Observation],
    latency_ns: int,
    deadline_ns: int,
    end_ns: int,
    *,
    start_ns: int = 0,
    tolerance_ns: int = 0,
    adds_up: bool = False,
    stands_still: bool = False,
    check_calls: bool = False,
    wide: bool = False,
    allowed_ns: int = 0,
) -> bool:
    """Whether ``machine`` can have done what ``trace`` says.

    Args:
        machine: a flat machine with topics, services, timers and delays. Its name is its node's.
        trace: what was heard until ``end_ns``, in any order; own observations have distinct stamps.
        latency_ns: how long after its stamp a message or tick is taken at the latest.
        deadline_ns: how long after the input an output is heard at the latest.
        end_ns: the moment of judging.
        start_ns: when the machine entered its initial state.
        tolerance_ns: how much earlier or later than its period says a timer may tick.
        adds_up: whether that may be so once for each period, not once in all.
        stands_still: whether it may have stood still.
        check_calls: whether a response must answer the call that decision 2 says.
        wide: whether what came of a take says nothing of when it was, to what began with it.
        allowed_ns: ``tolerance_ns`` is so much more than a delayed event may be off its time, without drift.

    Raises:
        UnsupportedError: the machine has something that the reference does not know.
        TooLongError: it has delays, and would take too long.
    """
    stepper = Stepper(machine)
    ordered = sorted(trace, key=lambda item: item.stamp_ns)
    inputs = inputs_of(machine, ordered, latency_ns, end_ns, start_ns, tolerance_ns, adds_up)
    heard = outputs_of(machine, ordered)

    def all_later(some: list[Input]) -> list[Input]:
        return (
            standing_still(machine, ordered, some, latency_ns, start_ns) if stands_still else some
        )

    inputs = all_later(inputs)

    def due(timer: Timer) -> Input:
        off_ns = tolerance_ns - allowed_ns + timer.delay_ns // DRIFT
        first_ns, last_ns = (began_ns + timer.delay_ns for began_ns in timer.began)
        line, number = f"delay {timer.number}", timer.number
        until_ns = last_ns + off_ns + latency_ns
        return Input(timer.event, timer.data, None, line, number, first_ns - off_ns, until_ns)

    seen: set[tuple[Any, ...]] = set()
    most = sys.maxsize if not has_delays(machine) else MOST_PLACES

    def possible(
        at: Configuration, taken: frozenset[Input], clock_ns: int, free_ns: int, count: int
    ) -> bool:
        """Whether the machine can go on from here so that all that was heard is explained.

        Args:
            at: the stable machine.
            taken: inputs taken so far.
            clock_ns: the moment of the last take, or of its last output.
            free_ns: the last output so far: the machine was busy until then.
            count: outputs heard so far.
        """
        here = (repr(at), taken, clock_ns, free_ns, count)
        if here in seen:
            return False
        seen.add(here)
        if len(seen) > most:
            raise TooLongError
        delayed = dict(zip(all_later([due(timer) for timer in at.timers]), at.timers, strict=True))
        left = [*(item for item in inputs if item not in taken), *delayed]
        if count == len(heard) and all(item.latest_ns >= end_ns for item in left):
            return True
        for item in left:
            if any(other.line == item.line and other.number < item.number for other in left):
                continue
            moment_ns = max(clock_ns, item.earliest_ns)
            if item in delayed and moment_ns >= end_ns:
                continue  # it may go on so for ever
            if item.line == OWN_EARS and moment_ns > item.latest_ns:
                continue
            was_busy = moment_ns == free_ns
            if not was_busy and any(other.latest_ns < moment_ns for other in left):
                continue
            latest_ns = max(moment_ns, min(other.latest_ns for other in left))
            last_ns = latest_ns
            if (
                count < len(heard) and not wide
            ):  # it is taken before that, which comes of it or of a later one
                last_ns = max(moment_ns, min(latest_ns, heard[count].stamp_ns - 1))
            when = moment_ns, last_ns
            if (timer := delayed.get(item)) is not None:
                now, outcomes = taken, stepper.ring(at, timer, when)
            else:
                now = frozenset({*taken, item})
                if item.may_be_skipped and possible(at, now, clock_ns, free_ns, count):
                    return True
                outcomes = stepper.take(at, item.event, item.data, item.call, when)
            for then, sent in outcomes:
                if explained(then, now, moment_ns, latest_ns, free_ns, count, sent):
                    return True
        return False

    def explained(
        at: Configuration,
        taken: frozenset[Input],
        moment_ns: int,
        latest_ns: int,
        free_ns: int,
        count: int,
        sent: tuple[Output, ...],
    ) -> bool:
        """Whether a take that sends ``sent``, and all after it, is possible.

        The take is at ``moment_ns`` or later, but no later than ``latest_ns``.
        """
        clock_ns = moment_ns
        for output in sent:
            if count == len(heard):  # still owed: nothing else is taken
                overdue = latest_ns + deadline_ns < end_ns
                return not overdue and all(
                    item in taken or item.line != OWN_EARS for item in inputs
                )
            stamp_ns = heard[count].stamp_ns
            in_time = moment_ns < stamp_ns <= latest_ns + deadline_ns
            if not in_time or not is_output(output, heard[count], check_calls):
                return False
            clock_ns = free_ns = stamp_ns
            count += 1
        return possible(at, taken, clock_ns, free_ns, count)

    return any(
        explained(at, frozenset(), start_ns, start_ns, start_ns - 1, 0, sent)
        for at, sent in stepper.start((start_ns, start_ns))
    )


def has_delays(machine: Machine) -> bool:
    """Whether something in ``machine`` comes later."""
    sends = any(isinstance(it, Raise) and it.delay_s is not None for it in statements_of(machine))
    return sends or any(
        item.after_s is not None for state in machine.states for item in state.transitions
    )


def inputs_of(
    machine: Machine,
    ordered: Sequence[Observation],
    latency_ns: int,
    end_ns: int,
    start_ns: int,
    tolerance_ns: int,
    adds_up: bool = False,
) -> list[Input]:
    """The inputs that were heard, and the timers' ticks, which nobody hears."""
    found: list[Input] = []
    for number, item in enumerate(ordered):
        event = _event(machine, item)
        if event is None:
            continue
        own = event.kind is not EventKind.MESSAGE
        found.append(
            Input(
                event=event,
                data=item.data,
                call=Call(item.client, item.call) if event.kind is EventKind.REQUEST else None,
                line=OWN_EARS if own else f"message {item.channel} {item.source}",
                number=number,
                earliest_ns=item.stamp_ns,
                latest_ns=item.stamp_ns if own else item.stamp_ns + latency_ns,
            )
        )
    for timer in machine.interfaces:
        if timer.kind is not InterfaceKind.TIMER:
            continue
        period_ns = round(SECOND_NS / timer.rate_hz)
        number = 1
        while True:
            nominal_ns = start_ns + number * period_ns
            off_ns = tolerance_ns * number if adds_up else tolerance_ns
            if nominal_ns - off_ns >= end_ns:
                break
            found.append(
                Input(
                    event=Event(EventKind.TIMER, timer.name),
                    data=None,
                    call=None,
                    line=f"timer {timer.name}",
                    number=number,
                    earliest_ns=nominal_ns - off_ns,
                    latest_ns=nominal_ns + off_ns + latency_ns,
                )
            )
            number += 1
    return found


def standing_still(
    machine: Machine,
    ordered: Sequence[Observation],
    inputs: Iterable[Input],
    latency_ns: int,
    start_ns: int,
) -> list[Input]:
    """The same inputs, taken later where the machine may have stood still."""
    own = [start_ns, *(item.stamp_ns for item in ordered if item.source == machine.name)]
    stills = [(one, two) for one, two in itertools.pairwise(own) if two - one > latency_ns]

    def later(item: Input) -> Input:
        until = [
            awake_ns + latency_ns
            for asleep_ns, awake_ns in stills
            if item.earliest_ns < awake_ns and item.latest_ns > asleep_ns
        ]
        if item.line == OWN_EARS or not until:
            return item
        is_tick = item.event.kind is EventKind.TIMER
        replace = msgspec.structs.replace
        return replace(item, latest_ns=max(until), may_be_skipped=is_tick)

    return [later(item) for item in inputs]


def _event(machine: Machine, item: Observation) -> Event | None:
    """What ``item`` is to ``machine``; None if it is not an input of it."""
    own = item.source == machine.name
    match item.kind:
        case ObservationKind.MESSAGE:
            kind, interface = EventKind.MESSAGE, InterfaceKind.SUBSCRIBER
        case ObservationKind.REQUEST_RECEIVED if own:
            kind, interface = EventKind.REQUEST, InterfaceKind.SERVER
        case ObservationKind.RESPONSE_RECEIVED if own:
            failed = EventKind.CALL_ERROR if item.error else EventKind.RESPONSE
            kind, interface = failed, InterfaceKind.CLIENT
        case _:
            return None
    for declared in machine.interfaces:
        if declared.kind is interface and declared.channel == item.channel:
            return Event(kind, declared.name)
    return None


def outputs_of(machine: Machine, ordered: Sequence[Observation]) -> list[Observation]:
    """What the machine itself was heard to send, on whatever channel."""
    return [
        item for item in ordered if item.source == machine.name and item.kind in _SENT_AS.values()
    ]


def is_output(owed: Output, heard: Observation, check_calls: bool) -> bool:
    """Whether ``heard`` is the output ``owed``."""
    if heard.kind is not _SENT_AS[owed.kind] or heard.channel != owed.channel or heard.error:
        return False
    if check_calls and owed.call is not None and owed.call != Call(heard.client, heard.call):
        return False
    return heard.data is None or same(owed.data, heard.data)


def same(owed: Any, heard: Any) -> bool:
    """Whether two values are the same message content; a field that is not owed is zero."""
    if isinstance(owed, dict) and isinstance(heard, dict):
        return owed.keys() <= heard.keys() and all(
            same(owed[name], value) if name in owed else _is_zero(value)
            for name, value in heard.items()
        )
    if isinstance(owed, list) and isinstance(heard, list):
        return len(owed) == len(heard) and all(map(same, owed, heard))
    if isinstance(owed, bool) or isinstance(heard, bool):
        return owed is heard
    if isinstance(owed, int | float) and isinstance(heard, int | float):
        return owed == heard or (math.isnan(owed) and math.isnan(heard))
    return type(owed) is type(heard) and bool(owed == heard)


def _is_zero(value: Any) -> bool:
    if isinstance(value, dict):
        return all(map(_is_zero, value.values()))
    if isinstance(value, list):
        return all(map(_is_zero, value))
    return not value
