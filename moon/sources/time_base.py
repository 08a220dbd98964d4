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
from moon.oracle.bounds import HOSTS_DIFFER_NS
from moon.properties.property import REQUESTS
from moon.recording.entries import END_OF_TIME_NS, makes_sense
from moon.recording.sorting import JITTER_NS
from moon.recording.stored import plural
from moon.sources.on_time import USUAL_NS
from transports.interface import Observation, ObservationKind
from transports.service_events import KIND_OF_EVENT

LOG, PUBLISH, HEADER, CLOCK = "log", "publish", "header", "clock"
CLOCK_TOPIC = "/clock"
_CLOCK_PLACE = (CLOCK_TOPIC, ObservationKind.MESSAGE)
LATEST_NS = 10_000_000_000
"""A recorder may stand still, and receive late; what is later than this was not late: clocks differ."""
MAX_HELD = 200_000
"""Entries held at once, whatever the time."""
_MAX_PLACES = 10_000
_UNTIL = attrgetter("until_ns")
_MANY_KEPT = 100
"""So many links are looked at that may have kept an entry."""
_SECOND_NS = 1_000_000_000
_CLIENT_END = (ObservationKind.REQUEST_SENT, ObservationKind.RESPONSE_RECEIVED)
_ANSWERS = (ObservationKind.RESPONSE_SENT, ObservationKind.RESPONSE_RECEIVED)
_SHOWN = 2
"""So many calls or messages show how a clock is set (decision 54)."""
_USUAL_STEPS = 4
"""A time that goes on by more than so many steps of the usual length at once was set, or not recorded."""


class TimeError(ValueError):
    """A recording has no such time, or none that makes sense; the text says which it has."""


class TimeChoice(msgspec.Struct, frozen=True):
    """Which time of its entries a recording is judged by.

    Attributes:
        kind: :data:`LOG`, :data:`PUBLISH`, :data:`HEADER`, :data:`CLOCK`; empty: by evidence.
        field: of :data:`HEADER`: the path of the field with the stamp, or with a header that has one.
    """

    kind: str = ""
    field: str = ""


def time_choice(text: str) -> TimeChoice:
    """The choice that is written as ``text``: ``log``, ``publish``, ``header:FIELD`` or ``clock``.

    Raises:
        TimeError: it is none of them.
    """
    kind, colon, field = text.partition(":")
    if kind == HEADER and all(field.split(".")):
        return TimeChoice(HEADER, field)
    if kind in (LOG, PUBLISH, CLOCK) and not colon:
        return TimeChoice(kind)
    raise TimeError(f"`{text}` is no time; expected log, publish, header:FIELD or clock")


def concerns(needed: frozenset[str] | None, channel: str) -> bool:
    """Whether ``channel`` is one of ``needed``, or a part of an action that is; None: all are."""
    return needed is None or channel in needed or channel.partition("/_action/")[0] in needed


class Range:
    """What was found of one time of the entries, in the order in which they were recorded.

    Attributes:
        first_ns, last_ns: the first one, and the last one; -1 before there is one.
        count: how many entries have it.
        senseless: how many have one that makes no sense.
        disorder_ns: by how much at most it goes back from one entry to a later one.
    """

    def __init__(self) -> None:
        self.first_ns = self.last_ns = -1
        self.count = self.senseless = self.disorder_ns = 0
        self._newest_ns = self._most_ns = -1
        self._least_ns = END_OF_TIME_NS

    def note(self, stamp_ns: int) -> None:
        """Take note of the next one."""
        self.count += 1
        if not makes_sense(stamp_ns):
            self.senseless += 1
            return
        if self.first_ns < 0:
            self.first_ns = stamp_ns
        self.last_ns = stamp_ns
        self._least_ns = min(self._least_ns, stamp_ns)
        self._most_ns = max(self._most_ns, stamp_ns)
        self._newest_ns = max(self._newest_ns, stamp_ns)
        self.disorder_ns = max(self.disorder_ns, self._newest_ns - stamp_ns)

    def begin_again(self) -> None:
        """A clock was set back: what comes is not compared with what was."""
        self._newest_ns = -1

    @property
    def what_is_wrong(self) -> str:
        """Why nothing can be said by it, in words; "" if something can."""
        if self.count and self.senseless == self.count:
            return "none of them is one (negative, or at the end of time)"
        if self.count > 1 and self._least_ns == self._most_ns:
            return f"all of them are the same ({self._least_ns / 1e9:.9g} s)"
        return ""


class _Kept(msgspec.Struct, frozen=True):
    """What a link or the recorder kept for a while (ns): it is late, and its stamps are right.

    Attributes:
        first_ns: the first stamp.
        since_ns, until_ns: when it was recorded.
    """

    first_ns: int
    since_ns: int
    until_ns: int


class _Lags:
    """By how much some entries were recorded after they were stamped (ns).

    Attributes:
        count: of the entries.
        least_ns, most_ns: the least, and the most.
        for_a_while_ns: by how much at least for a while, if that was their clock; 0: never.
        late_since: the stamp of the first since which all were late, and when that was recorded; None: it
            was not.
        received_ns: when the last one was recorded.
        is_fresh: whether something was stamped while it was recorded.
        is_unset: whether stamps that nobody set are among others: from before the recording, where no
            publisher has kept them, or none, so that they are those of reception.
    """

    def __init__(self) -> None:
        self.count = 0
        self.least_ns = self.most_ns = self.for_a_while_ns = 0
        self.is_fresh = self.is_unset = False
        self._stamp_ns = -1
        self.late_since: tuple[int, int] | None = None
        self.received_ns = 0
        self._went_back = False

    def note(self, stamp_ns: int, received_ns: int, bound_ns: int, timely_ns: int) -> _Kept | None:
        """Take note of the next one.

        Late are the stamps of a clock that is behind, and what a link or the recorder kept. The latter comes
        all at once. So it was the clock where entries that are late come as they were stamped, one after the
        other, while others came in time, or after stamps that were higher.

        Args:
            stamp_ns: its stamp.
            received_ns: when it was recorded.
            bound_ns: what comes within this time is not late.
            timely_ns: when something was recorded last that was in time.

        Returns:
            What a link or the recorder kept, up to this one; None: that does not show.
        """
        lag_ns = received_ns - stamp_ns
        kept = self._kept(stamp_ns, received_ns, bound_ns)
        self.least_ns = lag_ns if not self.count else min(self.least_ns, lag_ns)
        self.most_ns = lag_ns if not self.count else max(self.most_ns, lag_ns)
        self.count += 1
        self.received_ns = received_ns
        if lag_ns <= bound_ns:
            self.late_since = None
        elif self.late_since is None:
            self.late_since = (stamp_ns, received_ns)
            self._went_back = stamp_ns < self._stamp_ns - bound_ns
        else:
            first_ns, since_ns = self.late_since
            stamped_ns, recorded_ns = stamp_ns - first_ns, received_ns - since_ns
            is_steady = stamped_ns > bound_ns and recorded_ns > stamped_ns // 2
            if is_steady and (self._went_back or timely_ns > since_ns) and not self.for_a_while_ns:
                self.for_a_while_ns = min(lag_ns, since_ns - first_ns)
        self._stamp_ns = stamp_ns
        return kept

    def _kept(self, stamp_ns: int, received_ns: int, bound_ns: int) -> _Kept | None:
        """What was kept comes faster than it was stamped; a clock that is set right again does not."""
        if self.late_since is None:
            return None
        first_ns, since_ns = self.late_since
        stamped_ns, recorded_ns = stamp_ns - first_ns, received_ns - since_ns
        is_late = received_ns - stamp_ns > bound_ns
        most_ns = (stamped_ns - bound_ns) // 2 if is_late else USUAL_NS
        if stamped_ns <= bound_ns or recorded_ns > most_ns:
            return None
        return _Kept(first_ns, since_ns, received_ns)

    def begin_again(self) -> None:
        """The recorder's clock was set back: what comes is not compared with what was."""
        self._stamp_ns, self.late_since = -1, None


class _SetBack(msgspec.Struct, frozen=True):
    """A clock was set back: what is stamped from the first until the second time (ns) is in no order.

    Attributes:
        node: whose it is; empty: of who publishes on ``channel``.
        received_ns: when the first entry that is stamped anew was recorded.
    """

    node: str
    channel: str
    from_ns: int
    until_ns: int
    by_ns: int
    received_ns: int


class _Back(msgspec.Struct):
    """A clock's stamps went back, at an entry recorded at ``received_ns``, from ``until_ns`` to ``from_ns``.

    Attributes:
        before_ns: how late what came fastest in the second before was recorded.
        after_ns: the same of the second after it, as far as it is known.
        count: of the entries since.
    """

    received_ns: int
    from_ns: int
    until_ns: int
    before_ns: int
    after_ns: int
    count: int = 1


class _Fastest:
    """By how much one clock may be behind: what came fastest from it in a second was recorded so late (ns).

    A clock that is set stays so for a second, and for two calls or messages, or is so when recording begins
    or ends (decision 54). So a second is longer where fewer than two of them came in it.
    """

    def __init__(self) -> None:
        self._most_ns = self._last_ns = 0
        self._newest_ns = 0
        """The highest stamp."""
        self._back: deque[_Back] = deque()
        """Where stamps went back, and the second after that has not ended."""
        self._set_back: deque[_Back] = deque(maxlen=_MAX_PLACES)
        self._received: deque[int] = deque(maxlen=_MAX_PLACES)
        """Of each call and each message of the last second, when it was recorded."""
        self._least: deque[tuple[int, int]] = deque(maxlen=_MAX_PLACES)
        """When those were that came faster than all after them in that second, and how fast."""
        self._seconds: deque[int] = deque(maxlen=3)
        """How fast what came fastest was in each of the last seconds that have ended."""
        self._ends_ns = 0
        """The next of them ends then."""

    def note(self, received_ns: int, lag_ns: int, is_answer: bool) -> None:
        """Take note of the next one; an answer is of a call of which note was taken."""
        received, least = self._received, self._least
        if least:  # entries may be out of order by a little
            received_ns = max(received_ns, least[-1][0])
            self._note_second(received_ns)
        else:
            self._most_ns = max(self._most_ns, lag_ns)
        self._note_order(received_ns, lag_ns)
        if not is_answer or not received:
            received.append(received_ns)
        while least and least[-1][1] >= lag_ns:
            least.pop()
        least.append((received_ns, lag_ns))
        self._last_ns = lag_ns

    def _note_second(self, until_ns: int) -> None:
        """Take note of the second before that in which the next one came.

        A clock that runs slow is behind, at the end of a second, by as much more as in each of two before.
        """
        received, least = self._received, self._least
        while len(received) > _SHOWN and received[0] < until_ns - _SECOND_NS:
            received.popleft()
        while least[0][0] < received[0]:
            least.popleft()
        if least[-1][0] >= self._ends_ns:
            self._seconds.append(least[0][1])
            self._ends_ns = least[-1][0] + _SECOND_NS
        rises_ns = [after - before for before, after in itertools.pairwise(self._seconds)]
        behind_ns = least[0][1] + max(min(rises_ns, default=0), 0)
        self._most_ns = max(self._most_ns, behind_ns)

    def _note_order(self, received_ns: int, lag_ns: int) -> None:
        """Take note of a stamp that is before another of what was recorded before it."""
        stamp_ns = received_ns - lag_ns
        while self._back and self._is_over(self._back[0], received_ns):
            self._set_back.append(self._back.popleft())
        for back in self._back:
            back.after_ns = min(back.after_ns, lag_ns)
            back.count += 1
        if stamp_ns >= self._newest_ns:
            self._newest_ns = stamp_ns
        elif len(self._back) < _MANY_KEPT:
            before_ns = self._least[0][1]
            self._back.append(_Back(received_ns, stamp_ns, self._newest_ns, before_ns, lag_ns))
            self._newest_ns = stamp_ns  # what comes now is compared with that

    @staticmethod
    def _is_over(back: _Back, received_ns: int) -> bool:
        return back.count >= _SHOWN and received_ns > back.received_ns + _SECOND_NS

    def set_back(self, least_ns: int) -> Iterator[tuple[_Back, int]]:
        """Where it was by ``least_ns`` or more, and by how much.

        What the network delayed comes after what was stamped later, too; but not all of a second does.
        """
        for back in (*self._set_back, *self._back):
            by_ns = back.after_ns - back.before_ns
            if by_ns >= max(least_ns, back.until_ns - back.from_ns - least_ns):
                yield back, by_ns

    @property
    def most_ns(self) -> int:
        """In the second in which that was most, and at either end."""
        return max(self._most_ns, self._last_ns)

    def begin_again(self) -> None:
        """The recorder's clock was set back: what comes is not compared with what was."""
        self._most_ns = self.most_ns
        self._received.clear()
        self._least.clear()
        self._seconds.clear()
        self._ends_ns = self._newest_ns = 0
        self._set_back += self._back
        self._back.clear()


class Survey:
    """What the times of a recording are, found by reading all of it.

    Args:
        choice: what was chosen; of its time note is taken, too.
        needed: the channels that matter (see :func:`concerns`); None: all.
        latency_ns: a message is received within this time.
        skew_ns: clocks differ by this at most where nothing shows it.

    Attributes:
        log: when entries were recorded.
        stamps: when they were published, or happened.
        fresh: the same of those that happened while it was recorded.
        chosen: by a field of a header, or by ``/clock``; only if that was chosen.
        told: the first of these, and when that was recorded.
        told_back_ns: by how much these go back on one channel at most.
        set_back: how often the recorder's clock was.
        is_of_two: whether requests come after that which a client had made before: it is another run with
            the same names, or no order of time.
        is_on_arrival: whether entries are stamped with the time at which they were recorded.
        most_late_ns: by how much at most something fresh was recorded after it happened.
        kept: what a link or the recorder kept.
    """

    def __init__(
        self,
        choice: TimeChoice,
        needed: frozenset[str] | None,
        latency_ns: int,
        skew_ns: int = HOSTS_DIFFER_NS,
        node_of: Callable[[Observation], str] = lambda seen: "",
    ) -> None:
        self.needed = needed
        self.latency_ns, self.skew_ns = latency_ns, skew_ns
        self.log, self.stamps, self.fresh, self.chosen = Range(), Range(), Range(), Range()
        self.told = (0, 0)
        self.told_back_ns = 0
        self._told: dict[str, int] = {}
        """By channel: the newest of these."""
        self.set_back = 0
        self.is_of_two = False
        self._calls: dict[tuple[str, str, str, int], int] = {}
        """The highest number of a client's calls, at either end."""
        self._calls_before: dict[tuple[str, str, str, int], int] = {}
        """The same before the recorder's clock was set back."""
        self.is_on_arrival = True
        self.most_late_ns = 0
        self.kept: deque[_Kept] = deque(maxlen=_MAX_PLACES)
        self._least_late_ns = END_OF_TIME_NS
        self._choice = choice
        self._node_of = node_of
        self._timely_ns = -1
        """When something was recorded last that was in time."""
        self._lags: dict[tuple[str, str, str], _Lags] = {}
        """By channel, kind and client: each end of a call has a clock of its own."""
        self._fastest: dict[tuple[str, str], _Fastest] = {}
        """By clock: that of a node, if the models tell; else a client's, a server's, or of who publishes."""
        self._nodes: dict[tuple[str, str], str] = {}
        """The node of each clock that is known to be one's."""

    def note(self, seen: Observation) -> None:
        """Take note of the next entry."""
        received_ns, stamp_ns = seen.received_ns, seen.stamp_ns
        if makes_sense(received_ns) and received_ns < self.log.last_ns - JITTER_NS:
            self.set_back += 1
            for found in (self.log, self.stamps, self.fresh):
                found.begin_again()
            for lags in self._lags.values():
                lags.begin_again()
            for fastest in self._fastest.values():
                fastest.begin_again()
            self._timely_ns = -1
            self._calls_before, self._calls = self._calls, {}
        self.log.note(received_ns)
        if seen.kind in KIND_OF_EVENT:
            self._note_number(seen)
        matters = concerns(self.needed, seen.channel)
        told_ns = read_time(seen, self._choice) if matters or self._choice.kind == CLOCK else None
        if told_ns is not None:
            self.told = self.told if self.chosen.count else (told_ns, received_ns)
            self.chosen.note(told_ns)
            newest_ns = self._told.get(seen.channel, told_ns)
            self.told_back_ns = max(self.told_back_ns, newest_ns - told_ns)
            if seen.channel in self._told or len(self._told) < _MAX_PLACES:
                self._told[seen.channel] = max(newest_ns, told_ns)
        if not matters:
            return
        self.stamps.note(stamp_ns)
        self.is_on_arrival = self.is_on_arrival and received_ns == stamp_ns
        if makes_sense(received_ns) and makes_sense(stamp_ns):
            self._note_lag(seen, received_ns - stamp_ns)

    def _note_number(self, seen: Observation) -> None:
        """A client numbers its requests one after the other, whatever its clock, and the recorder's, do."""
        end = "client" if seen.kind in _CLIENT_END else "server"
        place = (seen.channel, end, seen.client, seen.client_life)
        if seen.kind in REQUESTS:
            self.is_of_two |= 0 <= seen.call <= self._calls_before.get(place, -1)
        if place in self._calls or len(self._calls) < _MAX_PLACES:
            self._calls[place] = max(seen.call, self._calls.get(place, -1))

    def _note_lag(self, seen: Observation, lag_ns: int) -> None:
        is_fresh = seen.stamp_ns >= self.log.first_ns
        if is_fresh:
            self.fresh.note(seen.stamp_ns)
            self.most_late_ns = max(self.most_late_ns, lag_ns)
            self._least_late_ns = min(self._least_late_ns, lag_ns)
            is_client = seen.kind in _CLIENT_END
            is_call = seen.kind is not ObservationKind.MESSAGE
            clock = ("", seen.client) if is_client else (seen.channel, "server" * is_call)
            if node := self._node_of(seen):
                clock = ("", node)
                self._nodes[clock] = node
            if clock in self._fastest or len(self._fastest) < _MAX_PLACES:
                fastest = self._fastest.setdefault(clock, _Fastest())
                fastest.note(seen.received_ns, lag_ns, seen.kind in _ANSWERS)
        place = (seen.channel, str(seen.kind), seen.client)
        lags = self._lags.get(place)
        if lags is None:
            if len(self._lags) >= _MAX_PLACES:
                return
            lags = self._lags[place] = _Lags()
        if not is_fresh and lag_ns > self.latency_ns:
            # what was kept for who comes later comes first, and of calls nothing is kept
            lags.is_unset |= lags.is_fresh or seen.kind is not ObservationKind.MESSAGE
        lags.is_unset |= lags.count > 0 and (lag_ns == 0) != (lags.least_ns == lags.most_ns == 0)
        lags.is_fresh |= is_fresh
        kept = lags.note(seen.stamp_ns, seen.received_ns, self.latency_ns, self._timely_ns)
        if kept is not None:
            if (
                self.kept
                and self.kept[-1].since_ns <= kept.until_ns <= self.kept[-1].until_ns + USUAL_NS
            ):
                last = self.kept.pop()
                first_ns, since_ns = (
                    min(last.first_ns, kept.first_ns),
                    min(last.since_ns, kept.since_ns),
                )
                kept = _Kept(first_ns, since_ns, kept.until_ns)
            self.kept.append(kept)
        if abs(lag_ns) <= self.latency_ns // 2:
            self._timely_ns = seen.received_ns

    @property
    def apart_ns(self) -> int:
        """By how much stamps of two clocks may be wrong against each other.

        What is stamped after it was recorded is of a clock that is ahead, by so much at least. What is late
        is late because of the network, unless all is that comes from a clock in a second: then that may be
        behind. Two clocks that differ, and of which that does not show it, differ by no more than is said, or
        by :data:`HOSTS_DIFFER_NS`.
        """
        behind_ns = max((it.most_ns for it in self._fastest.values()), default=0)
        return max(min(behind_ns, self.latency_ns) - self._least_late_ns, 0) + self.skew_ns

    @property
    def set_back_clocks(self) -> tuple[_SetBack, ...]:
        """Where clocks were set back while it was recorded, by when."""
        found = [
            _SetBack(node, clock[0], back.from_ns, back.until_ns, by_ns, back.received_ns)
            for clock, fastest in self._fastest.items()
            if (node := self._nodes.get(clock, "")) or clock[0]
            for back, by_ns in fastest.set_back(self.skew_ns)
        ]
        return tuple(sorted(found, key=attrgetter("received_ns")))

    def contradiction(self) -> str:
        """Where stamps contradict the times of recording, in words; "" if they nowhere do."""
        if self.stamps.senseless:
            what = f"{self.stamps.senseless} of {plural(self.stamps.count, 'stamp')}"
            return f"{what} make no sense (negative, or at the end of time)"
        for (channel, _, _), lags in sorted(self._lags.items()):
            if lags.least_ns < -self.latency_ns // 2:
                return f"{channel} is stamped {_seconds(-lags.least_ns)} after it was recorded"
            if lags.least_ns > self.latency_ns and lags.count > 1 and not self._were_kept(lags):
                return f"{channel} is stamped {_seconds(lags.least_ns)} before it was recorded"
            if lags.for_a_while_ns:
                behind = _seconds(lags.for_a_while_ns)
                return f"{channel} is for a while stamped {behind} before it was recorded"
            if lags.is_unset:
                return f"{channel} is now and then not stamped, or as before the recording"
        if max(self.fresh.disorder_ns, self.most_late_ns) > LATEST_NS:
            return "stamps are in another order than what was recorded"
        return ""

    def _were_kept(self, lags: _Lags) -> bool:
        """Whether all came with what a link, or the recorder, had kept: late, with stamps that are right."""
        first_ns, since_ns = lags.late_since or (0, 0)
        return any(
            kept.first_ns <= first_ns + self.latency_ns
            and kept.since_ns <= since_ns + self.latency_ns
            and lags.received_ns <= kept.until_ns + self.latency_ns
            for kept in self.kept
        )


def _seconds(duration_ns: int) -> str:
    return f"{duration_ns / 1e9:,.1f} s"


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
    kept: tuple[_Kept, ...] = ()
    set_back: tuple[_SetBack, ...] = ()
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
            what = f"no time on {CLOCK_TOPIC} was recorded"
        raise TimeError(f"{what}; expected --time log or --time publish")
    if found.what_is_wrong:
        raise TimeError(f"its stamps are nonsense: {found.what_is_wrong}; nothing can be judged")
    # a channel's stamps are in order, if they are of one clock that nobody sets; those of two may come late
    is_of_two = found.disorder_ns > LATEST_NS or survey.told_back_ns > survey.latency_ns
    if choice.kind == HEADER and is_of_two:
        back = _seconds(found.disorder_ns)
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
        text = f"that of {CLOCK_TOPIC} when each entry was recorded"
        if step_ns > survey.latency_ns:
            limits += (f"the time on {CLOCK_TOPIC} is known to {_seconds(step_ns)} only",)
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


def read_time(seen: Observation, choice: TimeChoice) -> int | None:
    """The time that the contents of ``seen`` tell (ns); None if they tell none, or none was chosen.

    A zero in a header is none: its publisher has not set it.
    """
    if choice.kind == HEADER:
        return _stamp_in(seen.data, choice.field) or None
    if choice.kind == CLOCK and (seen.channel, seen.kind) == _CLOCK_PLACE:
        return _stamp_in(seen.data, "clock")
    return None


def _stamp_in(data: Any, path: str) -> int | None:
    """The stamp at ``path``: a time, a header with one, or seconds."""
    for name in path.split("."):
        data = data.get(name) if isinstance(data, dict) else None
    if isinstance(data, dict) and "stamp" in data:
        data = data["stamp"]
    if isinstance(data, dict):
        sec, nanosec = data.get("sec"), data.get("nanosec", 0)
        if isinstance(sec, int) and isinstance(nanosec, int):
            return sec * 10**9 + nanosec
        return None
    if isinstance(data, int | float) and not isinstance(data, bool) and abs(data) < 1e10:
        return round(data * 1e9)
    return None


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
        for kept in base.kept[after : after + _MANY_KEPT]:
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
        if before is not None or len(self._last) < _MAX_PLACES:
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


def _clock_gap(clock: _SetBack) -> Gap:
    whose = clock.node or f"who publishes on {clock.channel}"
    why = f"the clock of {whose} was set back by {round(clock.by_ns / 1e6)} ms"
    cause = Missing.CLOCK_SET if clock.node else Missing.NOT_JUDGED
    return Gap(clock.channel, clock.node, clock.from_ns, clock.until_ns + 1, why, cause=cause)


def _gap(missing: Observation, from_ns: int, until_ns: int) -> Gap:
    why = f"the time of a message on {missing.channel} makes no sense"
    return Gap(missing.channel, missing.source, from_ns, max(from_ns, until_ns) + 1, why)
