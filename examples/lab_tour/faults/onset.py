"""When a fault first shows itself, told from what was heard without any oracle.

What a monitor says is held against this: it should speak of the first output that is certainly wrong,
not of a later one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import msgspec

from transports.interface import Observation, ObservationKind

SUCCESS, FAILURE = 0, 1
THRESHOLD = 30
"""Of BatteryLevelSkill, per cent."""

_BATTERY_TICK = "/BatteryLevelSkill/tick"
_LEVEL = "/BatteryComponent/level"


class Onset(msgspec.Struct, frozen=True):
    """The first wrong output, or the input that should have been answered.

    Attributes:
        stamp_ns: when it happened.
        what: it is, in words.
    """

    stamp_ns: int
    what: str


def onset(identifier: str, heard: Sequence[Observation], latency_ns: int) -> Onset | None:
    """Where the fault ``identifier`` first shows in ``heard`` (by stamp); None if it does not.

    Args:
        identifier: of the fault, ``T1`` to ``T6``.
        heard: everything, in order of the stamps.
        latency_ns: a message may take this long to be taken; before, both answers may be right.
    """
    return next(_FINDERS[identifier](heard, latency_ns), None)


Finder = Callable[[Sequence[Observation], int], Iterator[Onset]]


def _unanswered_tick(heard: Sequence[Observation], _: int) -> Iterator[Onset]:
    for seen in heard:
        if seen.channel == _BATTERY_TICK and seen.kind is ObservationKind.REQUEST_RECEIVED:
            yield Onset(seen.stamp_ns, "a tick was not answered")


def _unanswered_after_setting(heard: Sequence[Observation], _: int) -> Iterator[Onset]:
    for seen in heard:
        if (
            seen.channel == "/SchedulerComponent/SetPoi"
            and seen.source == "SetPoi1Skill"
            and seen.kind is ObservationKind.RESPONSE_RECEIVED
        ):
            yield Onset(seen.stamp_ns, "the tick was not answered when the point was set")


def _wrong_failure(heard: Sequence[Observation], latency_ns: int) -> Iterator[Onset]:
    for seen, asked_ns in _battery_answers(heard):
        levels = _levels(heard, asked_ns, latency_ns)
        if seen.data["status"] == FAILURE and all(level >= THRESHOLD for level in levels):
            yield Onset(seen.stamp_ns, "FAILURE was answered with enough charge")


def _wrong_success(heard: Sequence[Observation], latency_ns: int) -> Iterator[Onset]:
    for seen, asked_ns in _battery_answers(heard):
        levels = _levels(heard, asked_ns, latency_ns)
        if seen.data["status"] == SUCCESS and all(level < THRESHOLD for level in levels):
            yield Onset(seen.stamp_ns, "SUCCESS was answered without enough charge")


def _battery_answers(heard: Sequence[Observation]) -> Iterator[tuple[Observation, int]]:
    """Each answer of BatteryLevelSkill, and when it got the request."""
    asked: dict[tuple[str, int], int] = {}
    for seen in heard:
        if seen.channel != _BATTERY_TICK:
            continue
        if seen.kind is ObservationKind.REQUEST_RECEIVED:
            asked[seen.client, seen.call] = seen.stamp_ns
        elif seen.kind is ObservationKind.RESPONSE_SENT and not seen.error:
            yield seen, asked[seen.client, seen.call]


def _levels(heard: Sequence[Observation], at_ns: int, latency_ns: int) -> list[int]:
    """What BatteryLevelSkill can hold for the charge at ``at_ns``."""
    found = [100]
    for seen in heard:
        is_level = seen.channel == _LEVEL and seen.kind is ObservationKind.MESSAGE
        if is_level and seen.stamp_ns < at_ns:
            if seen.stamp_ns < at_ns - latency_ns:
                found.clear()
            found.append(seen.data["data"])
    return found


def _answered_at_once(heard: Sequence[Observation], _: int) -> Iterator[Onset]:
    for seen in heard:
        if seen.channel == "/AlarmSkill/tick" and seen.kind is ObservationKind.RESPONSE_SENT:
            yield Onset(seen.stamp_ns, "a tick was answered and the user not notified")


def _other_service(heard: Sequence[Observation], _: int) -> Iterator[Onset]:
    for seen in heard:
        if seen.source == "IsPoiDone1Skill" and seen.kind is ObservationKind.REQUEST_SENT:
            yield Onset(seen.stamp_ns, f"{seen.channel} was called")


_FINDERS: dict[str, Finder] = {
    "T1": _unanswered_tick,
    "T2": _unanswered_after_setting,
    "T3": _wrong_failure,
    "T4": _answered_at_once,
    "T5": _wrong_success,
    "T6": _other_service,
}
