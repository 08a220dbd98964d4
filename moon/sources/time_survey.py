"""What the times of a recording are, found by reading all of it before it is judged."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from operator import attrgetter

from moon.oracle.bounds import Bounds
from moon.recording.entries import END_OF_TIME_NS, makes_sense
from moon.recording.sorting import JITTER_NS
from moon.recording.stored import plural
from moon.sources.on_time import LATEST_NS, USUAL_NS
from moon.sources.recorded_clocks import MAX_PLACES, Fastest, Kept, Lags, SetBack
from moon.sources.time_choice import CLOCK, TimeChoice, concerns, read_time
from transports.interface import CLIENT_END, REQUESTS, RESPONSES, Observation, ObservationKind
from transports.service_events import KIND_OF_EVENT


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


class Survey:
    """What the times of a recording are, found by reading all of it.

    Args:
        choice: what was chosen; of its time note is taken, too.
        needed: the channels that matter (see :func:`concerns`); None: all.
        bounds: what is assumed; clocks differ by no more than those say where nothing shows it.

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
        bounds: Bounds,
        node_of: Callable[[Observation], str] = lambda seen: "",
    ) -> None:
        self.needed = needed
        self.latency_ns, self.differ_ns = bounds.latency, bounds.differ
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
        self.kept: deque[Kept] = deque(maxlen=MAX_PLACES)
        self._least_late_ns = END_OF_TIME_NS
        self._choice = choice
        self._node_of = node_of
        self._timely_ns = -1
        """When something was recorded last that was in time."""
        self._lags: dict[tuple[str, str, str], Lags] = {}
        """By channel, kind and client: each end of a call has a clock of its own."""
        self._fastest: dict[tuple[str, str], Fastest] = {}
        """By clock: that of a node, if the models tell; else a client's, a server's, or of who publishes."""
        self._of_nodes: set[tuple[str, str]] = set()
        """Those of them that are known to be a node's, with its name."""

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
            if seen.channel in self._told or len(self._told) < MAX_PLACES:
                self._told[seen.channel] = max(newest_ns, told_ns)
        if not matters:
            return
        self.stamps.note(stamp_ns)
        self.is_on_arrival = self.is_on_arrival and received_ns == stamp_ns
        if makes_sense(received_ns) and makes_sense(stamp_ns):
            self._note_lag(seen, received_ns - stamp_ns)

    def _note_number(self, seen: Observation) -> None:
        """A client numbers its requests one after the other, whatever its clock, and the recorder's, do."""
        end = "client" if seen.kind in CLIENT_END else "server"
        place = (seen.channel, end, seen.client, seen.client_life)
        if seen.kind in REQUESTS:
            self.is_of_two |= 0 <= seen.call <= self._calls_before.get(place, -1)
        if place in self._calls or len(self._calls) < MAX_PLACES:
            self._calls[place] = max(seen.call, self._calls.get(place, -1))

    def _note_lag(self, seen: Observation, lag_ns: int) -> None:
        is_fresh = seen.stamp_ns >= self.log.first_ns
        if is_fresh:
            self.fresh.note(seen.stamp_ns)
            self.most_late_ns = max(self.most_late_ns, lag_ns)
            self._least_late_ns = min(self._least_late_ns, lag_ns)
            is_client = seen.kind in CLIENT_END
            is_call = seen.kind is not ObservationKind.MESSAGE
            clock = ("", seen.client) if is_client else (seen.channel, "server" * is_call)
            if node := self._node_of(seen):
                clock = ("", node)
                self._of_nodes.add(clock)
            if clock in self._fastest or len(self._fastest) < MAX_PLACES:
                fastest = self._fastest.setdefault(clock, Fastest())
                fastest.note(seen.received_ns, lag_ns, seen.kind in RESPONSES)
        place = (seen.channel, str(seen.kind), seen.client)
        lags = self._lags.get(place)
        if lags is None:
            if len(self._lags) >= MAX_PLACES:
                return
            lags = self._lags[place] = Lags()
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
                kept = Kept(first_ns, since_ns, kept.until_ns)
            self.kept.append(kept)
        if abs(lag_ns) <= self.latency_ns // 2:
            self._timely_ns = seen.received_ns

    @property
    def apart_ns(self) -> int:
        """By how much stamps of two clocks may be wrong against each other.

        What is stamped after it was recorded is of a clock that is ahead, by so much at least. What is late
        is late because of the network, unless all is that comes from a clock in a second: then that may be
        behind. Two clocks that differ, and of which that does not show it, differ by no more than
        ``Bounds.differ``.
        """
        behind_ns = max((it.most_ns for it in self._fastest.values()), default=0)
        return max(min(behind_ns, self.latency_ns) - self._least_late_ns, 0) + self.differ_ns

    @property
    def set_back_clocks(self) -> tuple[SetBack, ...]:
        """Where clocks were set back while it was recorded, by when."""
        found = [
            SetBack(name * is_node, channel, back.from_ns, back.until_ns, by_ns, back.received_ns)
            for (channel, name), fastest in self._fastest.items()
            if (is_node := (channel, name) in self._of_nodes) or channel
            for back, by_ns in fastest.set_back(self.differ_ns)
        ]
        return tuple(sorted(found, key=attrgetter("received_ns")))

    def contradiction(self) -> str:
        """Where stamps contradict the times of recording, in words; "" if they nowhere do."""
        if self.stamps.senseless:
            what = f"{self.stamps.senseless} of {plural(self.stamps.count, 'stamp')}"
            return f"{what} make no sense (negative, or at the end of time)"
        for (channel, _, _), lags in sorted(self._lags.items()):
            if lags.least_ns < -self.latency_ns // 2:
                return f"{channel} is stamped {seconds(-lags.least_ns)} after it was recorded"
            if lags.least_ns > self.latency_ns and lags.count > 1 and not self._were_kept(lags):
                return f"{channel} is stamped {seconds(lags.least_ns)} before it was recorded"
            if lags.for_a_while_ns:
                behind = seconds(lags.for_a_while_ns)
                return f"{channel} is for a while stamped {behind} before it was recorded"
            if lags.is_unset:
                return f"{channel} is now and then not stamped, or as before the recording"
        if max(self.fresh.disorder_ns, self.most_late_ns) > LATEST_NS:
            return "stamps are in another order than what was recorded"
        return ""

    def _were_kept(self, lags: Lags) -> bool:
        """Whether all came with what a link, or the recorder, had kept: late, with stamps that are right."""
        first_ns, since_ns = lags.late_since or (0, 0)
        return any(
            kept.first_ns <= first_ns + self.latency_ns
            and kept.since_ns <= since_ns + self.latency_ns
            and lags.received_ns <= kept.until_ns + self.latency_ns
            for kept in self.kept
        )


def seconds(duration_ns: int) -> str:
    """``duration_ns``, for people."""
    return f"{duration_ns / 1e9:,.1f} s"
