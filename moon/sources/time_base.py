"""The time of a recording that others made: of one entry a file has several, and not all can be relied on.

A bag has of each message when it was recorded (``log_time``), by the recorder's clock, and may have when it
was published (``publish_time``), by the publisher's. Events of services are stamped by their nodes. Such
stamps tell in which order things happened, where they agree with the times of recording. Where they
contradict them (clocks that differ, simulated time on one side), nothing can be concluded from how they lie
to each other, and when an entry was recorded is its time.

A recording is read once for that (:class:`Survey`), before it is judged (:func:`in_time`). It is a whole:
what is later than usual in it is not late, it is put where it belongs.
"""

from __future__ import annotations

import heapq
import itertools
from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from operator import attrgetter
from typing import Any

import msgspec
from msgspec.structs import replace

from moon.judge import Gap, Missing
from moon.recording.entries import makes_sense
from moon.recording.sorting import JITTER_NS
from moon.recording.stored import plural
from moon.sources.on_time import LATEST_NS, MAX_HELD
from moon.sources.recorded_clocks import MANY_KEPT, MAX_PLACES, Kept, SetBack
from moon.sources.time_choice import (
    CLOCK,
    HEADER,
    LOG,
    PUBLISH,
    TimeChoice,
    TimeError,
    concerns,
    read_time,
)
from moon.sources.time_survey import Survey, seconds
from transports.interface import Observation

_UNTIL = attrgetter("until_ns")
_USUAL_STEPS = 4
"""A time that goes on by more than so many steps of the usual length at once was set, or not recorded."""


class TimeBase(msgspec.Struct, frozen=True):
    """By which time a recording is judged, and why.

    Attributes:
        kind: :data:`LOG`, :data:`PUBLISH`, :data:`HEADER` or :data:`CLOCK`.
        field: of :data:`HEADER`.
        text: the same in words.
        why: what speaks against a better one; "" if nothing does, or it was chosen.
        is_on_arrival: whether it tells when entries were recorded only.
        first_ns: when the first entry was recorded.
        window_ns: by so much entries are out of the order of their times.
        known_ns: what happened up to then is in the recording, if it was recorded at all; 0: all is.
        needed: the channels that are stamped by it, where others may be off; None: all.
        told: of :data:`HEADER` and :data:`CLOCK`: the first time that is told, and when that was recorded.
        open_ns: two things happened this much further apart than by it at most, or nearer.
        bound_ns: what was recorded later than this after its stamp, and not ``kept``, may have such a stamp
            as its clock was set; 0: all stamps are relied on.
        kept: what a link or the recorder kept, by when it was recorded.
        set_back: where a clock was, by when that was recorded.
        step_ns: of :data:`CLOCK`: between two times that are further apart it was set, or not recorded.
        limits: what cannot be concluded, one sentence each.
    """

    kind: str
    text: str
    field: str = ""
    why: str = ""
    is_on_arrival: bool = False
    first_ns: int = 0
    window_ns: int = 0
    known_ns: int = 0
    needed: frozenset[str] | None = None
    told: tuple[int, int] = (0, 0)
    open_ns: int = 0
    step_ns: int = 0
    bound_ns: int = 0
    kept: tuple[Kept, ...] = ()
    set_back: tuple[SetBack, ...] = ()
    limits: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        """What is said of it."""
        return f"{self.text}: {self.why}" if self.why else self.text


_LOG_TEXT = "log_time, when each entry was recorded"
_PUBLISH_TEXT = "publish_time, when each message was published, and the stamps of service events"
_LINES_TEXT = "of each line"


def time_base(
    survey: Survey,
    choice: TimeChoice,
    is_lines: bool = False,
    late: int = 0,
) -> TimeBase:
    """The time by which a recording is judged.

    Args:
        survey: of the recording.
        choice: what was chosen.
        is_lines: whether it is a log of JSON lines: these have one time each.
        late: how many entries stand far from their place, although each channel is in order.

    Raises:
        TimeError: there is no such time, or none that makes sense, or entries are in no order of time.
    """
    limits = _order(survey, late)
    if choice.kind in (HEADER, CLOCK):
        return _told_by_messages(survey, choice, limits)
    kind, why = _kind(survey, choice, is_lines)
    found = survey.log if kind == LOG else survey.stamps
    if found.what_is_wrong:
        where = "times" if is_lines else ("log_time" if kind == LOG else "stamps")
        raise TimeError(f"its {where} are nonsense: {found.what_is_wrong}; nothing can be judged")
    if found.senseless:
        what = plural(found.senseless, "entry", "entries")
        limits += (f"{what} with a time that makes no sense: left out, as if not received",)
    text = _LINES_TEXT if is_lines else (_LOG_TEXT if kind == LOG else _PUBLISH_TEXT)
    if kind == LOG:
        open_ns = survey.latency_ns
        return TimeBase(LOG, text, why=why, is_on_arrival=True, open_ns=open_ns, limits=limits)
    if choice.kind:
        window_ns = min(survey.stamps.disorder_ns, LATEST_NS)
        open_ns = survey.apart_ns
        return TimeBase(
            PUBLISH,
            text,
            why=why,
            window_ns=window_ns,
            open_ns=open_ns,
            set_back=survey.set_back_clocks,
            limits=limits,
        )
    return TimeBase(
        PUBLISH,
        text,
        why=why,
        first_ns=survey.log.first_ns,
        open_ns=survey.apart_ns,
        window_ns=max(survey.fresh.disorder_ns, survey.most_late_ns),
        needed=survey.needed,
        bound_ns=0 if survey.log.what_is_wrong else survey.latency_ns,
        kept=tuple(sorted(survey.kept, key=_UNTIL)),
        set_back=survey.set_back_clocks,
        known_ns=max(survey.log.last_ns - min(survey.most_late_ns, survey.latency_ns), 0),
        limits=limits,
    )


def _kind(survey: Survey, choice: TimeChoice, is_lines: bool) -> tuple[str, str]:
    """:data:`LOG` or :data:`PUBLISH`, and what speaks against the other; TimeError if it cannot be had."""
    if survey.is_on_arrival or is_lines:
        if choice.kind == PUBLISH and not is_lines:
            what = "it has no publish_time, only when entries were recorded"
            raise TimeError(f"{what}; expected --time log")
        return LOG, ""
    if choice.kind:
        return choice.kind, ""
    wrong = survey.log.what_is_wrong
    if wrong and not survey.stamps.what_is_wrong:
        return PUBLISH, f"log_time is nonsense: {wrong}"
    why = survey.contradiction()
    return (LOG, why) if why else (PUBLISH, "")


def _order(survey: Survey, late: int) -> tuple[str, ...]:
    """What is said of the order of entries; TimeError if there is none."""
    if survey.set_back > 1 or late:
        count = plural(max(survey.set_back, late), "time")
        raise TimeError(
            f"its entries are in no order of time (it goes back {count}): two runs in one file, or one that "
            "was shuffled; nothing can be judged. Take them apart, or sort them (`mcap sort`)"
        )
    if survey.is_of_two:
        raise TimeError(
            "its time goes back once, and after that a client makes calls that it had made before: two runs "
            "in one file, with the same clients, or one that was shuffled; nothing can be judged. Take them "
            "apart, or sort them (`mcap sort`)"
        )
    if survey.set_back:
        return ("its clock was set back once: what comes after that is judged anew",)
    return ()


def _told_by_messages(survey: Survey, choice: TimeChoice, limits: tuple[str, ...]) -> TimeBase:
    found = survey.chosen
    if not found.count:
        what = f"no message has a field {choice.field} with a stamp"
        if choice.kind == CLOCK:
            what = "no time on /clock was recorded"
        raise TimeError(f"{what}; expected --time log or --time publish")
    if found.what_is_wrong:
        raise TimeError(f"its stamps are nonsense: {found.what_is_wrong}; nothing can be judged")
    # a channel's stamps are in order, if they are of one clock that nobody sets; those of two may come late
    is_of_two = found.disorder_ns > LATEST_NS or survey.told_back_ns > survey.latency_ns
    if choice.kind == HEADER and is_of_two:
        back = seconds(found.disorder_ns)
        raise TimeError(
            f"its stamps in {choice.field} go back by {back}: they are of clocks that differ, or of one "
            "that was set; expected --time log or --time publish"
        )
    text = f"{choice.field} of messages, and of others when they were recorded"
    passed_ns = max(found.last_ns - found.first_ns, 0)
    step_ns = passed_ns // max(found.count - 1, 1)
    open_ns = survey.latency_ns
    if choice.kind == CLOCK:
        recorded_ns = max(survey.log.last_ns - survey.log.first_ns, 1)
        open_ns = open_ns * passed_ns // recorded_ns + step_ns  # so far that time goes on meanwhile
        text = "that of the simulation's clock when each entry was recorded"
        if step_ns > survey.latency_ns:
            limits += (f"the time of the simulation's clock is known to {seconds(step_ns)} only",)
    window_ns = min(found.disorder_ns, LATEST_NS) if choice.kind == HEADER else 0
    return TimeBase(
        choice.kind,
        text,
        choice.field,
        is_on_arrival=True,
        window_ns=window_ns,
        needed=survey.needed,
        told=survey.told,
        open_ns=open_ns,
        step_ns=max(_USUAL_STEPS * step_ns, survey.latency_ns),
        limits=limits,
    )


# --- the times of an entry ------------------------------------------------------------------------


class _Times:
    """The time of each entry of a recording, by its base."""

    def __init__(self, base: TimeBase) -> None:
        self._base = base
        self._choice = TimeChoice(base.kind, base.field)
        self._told_ns, self._told_at_ns = base.told
        self._last: dict[str, tuple[int, int]] = {}
        """Where the recorder's clock is the time: each channel's last stamp, and when that was recorded."""

    def of(self, seen: Observation) -> int:
        """When ``seen`` happened."""
        base = self._base
        if base.kind == LOG:
            return seen.received_ns
        if base.kind == PUBLISH:
            if not concerns(base.needed, seen.channel):
                return seen.received_ns
            # what its publisher kept for who comes later is known when it comes
            return seen.stamp_ns if seen.stamp_ns >= base.first_ns else seen.received_ns
        matters = base.kind == CLOCK or concerns(base.needed, seen.channel)
        told_ns = read_time(seen, self._choice) if matters else None
        if told_ns is not None:
            self._told_ns, self._told_at_ns = told_ns, seen.received_ns
        if base.kind == CLOCK:
            return self._told_ns
        return self._told_ns + seen.received_ns - self._told_at_ns

    def is_open(self, seen: Observation) -> bool:
        """Whether ``seen`` may have happened at any time from its stamp until it was recorded.

        It is late, and nothing shows whether it was kept or its clock was set.
        """
        base, stamp_ns, received_ns = self._base, seen.stamp_ns, seen.received_ns
        bound_ns = base.bound_ns
        if not bound_ns or stamp_ns < base.first_ns or received_ns - stamp_ns <= bound_ns:
            return False
        if not concerns(base.needed, seen.channel) or not makes_sense(received_ns):
            return False
        after = bisect_left(base.kept, received_ns - bound_ns, key=_UNTIL)
        for kept in base.kept[after : after + MANY_KEPT]:
            if kept.since_ns <= received_ns + bound_ns and kept.first_ns <= stamp_ns + bound_ns:
                return False
        return True

    def is_step(self, seen: Observation, before_ns: int, now_ns: int) -> bool:
        """Whether the time went on from ``before_ns`` to ``now_ns``, that of ``seen``, and did not pass."""
        if self._base.kind == CLOCK:
            return now_ns > before_ns + self._base.step_ns
        if self._base.kind != LOG:
            return False
        before = self._last.get(seen.channel)
        if before is not None or len(self._last) < MAX_PLACES:
            self._last[seen.channel] = seen.stamp_ns, now_ns
        if before is None or now_ns <= before_ns + LATEST_NS:
            return False
        passed_ns = seen.stamp_ns - before[0]
        return 0 < passed_ns < now_ns - before[1] - LATEST_NS


def in_time(
    entries: Iterable[Any], base: TimeBase, set_back: Callable[[], None] = lambda: None
) -> Iterator[Observation | Gap]:
    """The observations of ``entries``, each when it happened by ``base``, in that order.

    What has a time that makes no sense is left out, and reported as missing between what was recorded before
    and after it. So is what may have happened at any time until it was recorded, all that time.

    Args:
        entries: a recording, in the order in which it was received.
        base: by which time.
        set_back: called where a clock was set back, after all of before it and before what comes after it.
    """
    times = _Times(base)
    held: list[tuple[int, int, Observation | Gap]] = []
    left_out: list[Observation] = []
    set_clocks, ahead = deque(base.set_back), itertools.count(-2 * len(base.set_back))
    newest_ns = last_received_ns = passed_ns = 0
    for number, seen in enumerate(entries):
        if type(seen) is not Observation:
            continue
        now_ns = times.of(seen)
        if not makes_sense(now_ns):
            left_out.append(seen)
            continue
        if _is_set_back(seen, now_ns, base, last_received_ns, newest_ns):
            while held:
                yield heapq.heappop(held)[2]
            set_back()
            newest_ns = 0
        if times.is_step(seen, newest_ns or now_ns, now_ns):
            while held:
                yield heapq.heappop(held)[2]
            why = "the clock of the recording was set forward, or not recorded"
            yield Gap("", "", newest_ns + 1, now_ns, why, cause=Missing.ANEW)
        if makes_sense(seen.received_ns):
            last_received_ns = seen.received_ns
        for missing in left_out:
            yield _gap(missing, passed_ns, now_ns)
        left_out.clear()
        newest_ns = max(newest_ns, now_ns)
        found: Observation | Gap = replace(seen, stamp_ns=now_ns, received_ns=now_ns)
        if times.is_open(seen):
            why = f"a message on {seen.channel} is late, or its clock was set"
            found = Gap(seen.channel, seen.source, now_ns, seen.received_ns, why)
        while set_clocks and set_clocks[0].received_ns <= seen.received_ns:
            clock = set_clocks.popleft()
            for at_ns in (clock.from_ns, clock.until_ns + 1):
                heapq.heappush(held, (at_ns, next(ahead), _clock_gap(clock)))
        heapq.heappush(held, (now_ns, number, found))
        while held and (held[0][0] <= newest_ns - base.window_ns or len(held) > MAX_HELD):
            passed_ns, _, found = heapq.heappop(held)
            yield found
    while held:
        passed_ns, _, found = heapq.heappop(held)
        yield found
    for missing in left_out:
        yield _gap(missing, passed_ns, passed_ns)


def _is_set_back(
    seen: Observation, now_ns: int, base: TimeBase, received_ns: int, newest_ns: int
) -> bool:
    """Whether a clock was set back before ``seen``: what comes is not mixed with what was."""
    if base.kind == CLOCK:
        return now_ns < newest_ns
    if makes_sense(seen.received_ns) and seen.received_ns < received_ns - JITTER_NS:
        return True
    return now_ns < newest_ns - LATEST_NS


def _clock_gap(clock: SetBack) -> Gap:
    whose = clock.node or f"who publishes on {clock.channel}"
    why = f"the clock of {whose} was set back by {round(clock.by_ns / 1e6)} ms"
    cause = Missing.CLOCK_SET if clock.node else Missing.NOT_JUDGED
    return Gap(clock.channel, clock.node, clock.from_ns, clock.until_ns + 1, why, cause=cause)


def _gap(missing: Observation, from_ns: int, until_ns: int) -> Gap:
    why = f"the time of a message on {missing.channel} makes no sense"
    return Gap(missing.channel, missing.source, from_ns, max(from_ns, until_ns) + 1, why)
