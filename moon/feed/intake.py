"""What a tap hands over, made fit for judges: in time, of its type, with what is missing reported before it.

The only code that knows that observations arrive late, twice or not at all, that a clock may be set and
that a monitor may stand still. Live, recorded and simulated runs go through it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Protocol

import msgspec

from moon.feed.clock import NS, PERIOD_NS, SET_NS, EventTimeClock, read_together
from moon.feed.counts import Counts, Rejected
from moon.feed.nodes import Nodes
from moon.feed.numbers import Count, Numbers
from moon.feed.reception import Reception
from moon.judge import Gap
from transports.interface import Observation, ObservationKind, Tap
from transports.sequences import Sequel

_NEXT = Sequel.NEXT
_TAKEN = ObservationKind.MESSAGE_TAKEN


class Judges(Protocol):
    """To whom what is missing is reported."""

    def gap(self, gap: Gap) -> None:
        """Something is missing."""
        ...

    def host_clock_set(self, node: str, from_ns: int, since_ns: int, why: str) -> None:
        """The clock of the host of ``node`` was set: its times before and after that are not compared.

        Args:
            node: one of those whose clock that is.
            from_ns: what is stamped from then on (ns since the epoch) is uncertain.
            since_ns: what is stamped from then on is certain again.
            why: for people.
        """
        ...

    def start_anew(self, from_ns: int, since_ns: int, was_set_back: bool, why: str) -> None:
        """Nothing from ``from_ns`` to ``since_ns`` is known: all begin in the middle of the run.

        What is stamped before ``since_ns`` is not judged.

        Args:
            from_ns: ns since the epoch, on the clock of before.
            since_ns: the same, on the clock of now; it may still be to come.
            was_set_back: stamps begin elsewhere.
            why: for people.
        """
        ...


class EventOrder:
    """Event time, for the judges of one tap.

    Args:
        now_ns: the time of day.
        monotonic_ns: a clock that nobody sets: by it a standstill is distinguished from a clock that was set.
        latency_ns: nothing is received later than this after its stamp.
        repair_s: of the middleware (``Listener.repair_s``).
        reception: looks at stamps, types and sources.
        counts: what is counted.
        judges: what is missing is reported to them.
        known: the nodes of the system.
        skew_ns: the clocks of different hosts differ by at most this.
        in_order: nothing is on its way: each observation comes before all that happened after it.

    Attributes:
        sources: how far all nodes have reported.
        clock: of the judges.
        numbers: the last one of each source and channel.
        sequel: how the number of what was taken last follows.
        gaps: what is missing before it, by that: in which stretches it may have happened; empty: nothing.
        since_ns: what is stamped before is not judged.
        listener: the tap, once there is one.
    """

    def __init__(
        self,
        now_ns: Callable[[], int],
        monotonic_ns: Callable[[], int],
        latency_ns: int,
        repair_s: float,
        reception: Reception,
        counts: Counts,
        judges: Judges,
        known: Iterable[str] = (),
        skew_ns: int = 0,
        in_order: bool = False,
    ) -> None:
        self._in_order = in_order
        self._now_ns = now_ns
        self._read_monotonic = monotonic_ns
        self._latency_ns = latency_ns
        self._repair_ns = round(repair_s * NS)
        self._reception = reception
        self._counts = counts
        self._judges = judges
        self.sources = Nodes(latency_ns, skew_ns)
        self.clock = EventTimeClock(now_ns(), latency_ns)
        self.since_ns = 0
        self.listener: Tap | None = None
        self._monotonic_ns = monotonic_ns()
        self.numbers = Numbers(known)
        self.sequel = _NEXT
        self.gaps: tuple[Gap, ...] = ()
        self._late: dict[str, int] = {}
        """When an observation of each source was last received too late."""

    def start(self, listener: Tap, since_ns: int = 0, repair_s: float | None = None) -> int:
        """Judging begins now; since when all is received (ns), by default since now.

        Args:
            listener: the tap.
            since_ns: since when all is received (ns); 0: since now.
            repair_s: of the middleware, where only the beginning of a recording says it.
        """
        self.listener = listener
        if repair_s is not None:
            self._repair_ns = round(repair_s * NS)
        now_ns, self._monotonic_ns = self.read_clocks()
        self.since_ns = self.sources.listening_ns = since_ns or now_ns
        self.clock.restart(now_ns)
        return self.since_ns

    # --- what is received --------------------------------------------------------------------------

    def take(self, seen: Observation, now_ns: int) -> Observation | None:
        """``seen``, received at ``now_ns``, as it is to be judged; None: it is not."""
        clock = self.clock
        gap_ns = now_ns - clock.now_ns
        if not -SET_NS <= gap_ns <= clock.limit_ns or self._seems_set(gap_ns):
            self.look_at_clock(*self.read_clocks())
        if self.listener is not None and self.listener.is_contested(seen.source):
            # from the node of this name or from another: nothing is concluded from it
            self._miss(seen, clock.clock_ns, now_ns, f"several sessions claim to be {seen.source}")
            return None
        is_timed = self.is_timed(seen.stamp_ns, now_ns)
        if is_timed:
            self.heard(seen.source, seen.stamp_ns, now_ns)
        gap = self.sources.take(seen, clock.clock_ns, is_timed)
        if gap is not None:
            self._judges.gap(gap)
        judged = self._reception.judge(seen, now_ns)
        if not is_timed:
            self._pass_over(seen)
        if seen.stamp_ns < self.since_ns:
            self._counts.before += 1
            return None
        if isinstance(judged, Rejected):
            if judged.reason:
                self._miss(seen, clock.clock_ns, now_ns, judged.reason)
            return None
        lag_ns = now_ns - judged.stamp_ns
        if lag_ns > clock.limit_ns:
            self._too_late(seen, lag_ns, now_ns)
            return None
        clock.received(lag_ns)
        if not self._is_new(seen):
            return None
        limit_ns = clock.reach_ns(now_ns)
        if judged.received_ns > limit_ns + 2 * PERIOD_NS:
            # the judges' clock is behind the time of day
            return msgspec.structs.replace(judged, received_ns=limit_ns)
        return judged

    def is_timed(self, stamp_ns: int, now_ns: int) -> bool:
        """Whether a stamp tells when something happened; else it is of before a clock was set, or of one
        that differs. Numbers order it all the same.
        """
        return self.since_ns <= stamp_ns and not self._reception.is_future(stamp_ns, now_ns)

    def heard(self, node: str, stamp_ns: int, now_ns: int) -> None:
        """Something of ``node`` was received at ``now_ns``: it can be reached, and its clock may be set."""
        self.sources.reachability.heard(node, stamp_ns, now_ns - stamp_ns)
        if node:
            set_ns = self.sources.clocks.heard(node, stamp_ns, now_ns)
            if set_ns:
                self._host_clock_set(node, set_ns, now_ns)

    def answered(self, node: str, asked_ns: int, stamp_ns: int, now_ns: int) -> None:
        """``node``, asked at ``asked_ns``, answered at ``stamp_ns`` by its clock, which may differ."""
        set_ns = self.sources.clocks.answered(node, asked_ns, stamp_ns, now_ns)
        if set_ns:
            self._host_clock_set(node, set_ns, now_ns)

    def _host_clock_set(self, node: str, set_ns: int, now_ns: int) -> None:
        from_ns = self.clock.clock_ns - self._latency_ns - abs(set_ns)
        where = "forward" if set_ns > 0 else "back"
        what = f"the clock of the host of {node} was set {where} by {_duration(abs(set_ns))}"
        self._judges.host_clock_set(node, from_ns, now_ns + max(set_ns, 0) + 1, what)

    def _miss(self, seen: Observation, from_ns: int, until_ns: int, why: str) -> None:
        self._judges.gap(Gap(seen.channel, seen.source, from_ns, until_ns, why, seen.kind))

    def _too_late(self, seen: Observation, lag_ns: int, now_ns: int) -> None:
        """One node's observations come too late, or (if not only one's) this monitor is slow."""
        self._late[seen.source] = now_ns
        self._counts.late += 1
        why = f"observations arrive {lag_ns / NS:.1f} s late"
        recent = [source for source, at in self._late.items() if now_ns - at < NS]
        if len(recent) == 1:
            self._miss(seen, seen.stamp_ns, now_ns, f"{why} from {seen.source}")
            return
        self._late.clear()
        self._start_anew(*self.read_clocks(), why, held_up=True, is_late=True)

    def _is_new(self, seen: Observation) -> bool:
        """Look at its number: whether it was not received before, and what is missing before it."""
        number, stamp = seen.sequence, seen.stamp_ns
        self.sequel, self.gaps = _NEXT, ()
        if number < 0:
            return True
        count = self.numbers.of(seen)
        sequence = count.sequence
        if number == sequence.next and seen.life == sequence.life:
            if stamp < sequence.stamp - SET_NS and self.sources.clocks.went_back(seen.source):
                self._host_clock_set(seen.source, stamp - sequence.stamp, self.clock.now_ns)
            sequence.next, sequence.stamp = number + 1, stamp
            return True
        before_ns = sequence.stamp
        self.sequel = sequel = count.sequel(number, stamp, seen.life)
        match sequel:
            case Sequel.AGAIN:
                self._counts.repeated += 1
                return False
            case Sequel.FIRST if 0 <= count.left_at < number:
                self._note_gap(seen, self.since_ns, stamp)
            case Sequel.FIRST if number and seen.kind is ObservationKind.MESSAGE:
                self._look_at_first(seen)
            case Sequel.FIRST if seen.call > 1 and seen.order < 0 and seen.kind is not _TAKEN:
                self._look_at_first_call(seen, count)
            case Sequel.AFTER_A_GAP:
                for from_ns, until_ns in self.sources.missing_between(
                    seen.source, before_ns, stamp
                ):
                    self._note_gap(seen, from_ns + 1, until_ns)
            case Sequel.ANEW if number:  # a node that has started again sends 0 first
                self._note_gap(seen, before_ns + 1, stamp)
            case _:
                pass
        return True

    def _pass_over(self, seen: Observation) -> None:
        """Nobody knows when ``seen`` happened; its number counts, so that the next one follows."""
        if seen.sequence < 0:
            return
        count = self.numbers.of(seen)
        count.sequel(seen.sequence, min(seen.stamp_ns, self.since_ns - 1), seen.life)
        count.unknown_until = min(count.unknown_until, self.since_ns)

    def _note_gap(self, seen: Observation, from_ns: int, until_ns: int) -> None:
        if from_ns >= until_ns:  # stamps that do not increase: it was sent at one of them
            from_ns, until_ns = min(from_ns - 1, until_ns), max(from_ns - 1, until_ns) + 1
        why = f"observations on {seen.channel} from {seen.source} were lost"
        gap = Gap(seen.channel, seen.source, from_ns, until_ns, why, seen.kind)
        self.gaps = (*self.gaps, gap)

    def _look_at_first(self, seen: Observation) -> None:
        """The first message of a node that came up while the monitor listened has number 0."""
        if started_ns := self._began_heard(seen.source):
            why = f"what {seen.source} sent first on {seen.channel} was missed"
            self._miss(seen, started_ns, seen.stamp_ns, why)

    def _look_at_first_call(self, seen: Observation, count: Count) -> None:
        """A client numbers its calls from 1. Nothing is reported of a call before who reports it knows of the
        monitor, so that the first report has number 0 all the same.
        """
        client_ns = self._began_heard(seen.client)
        if not client_ns:
            return
        if seen.source != seen.client:
            client = self.numbers.counts.get((seen.client, seen.channel, False))
            if client is not None and client.next >= 0 and not client.unknown_until:
                return  # it was heard from its first call on: another life of this server had those
        count.unknown_until = seen.stamp_ns
        why = f"the first calls of {seen.client} to {seen.channel} were missed"
        self._miss(seen, client_ns, seen.stamp_ns, why)

    def _began_heard(self, name: str) -> int:
        """When ``name`` began to connect (ns), if the monitor listened by then; else 0."""
        began_ns = self.sources.up_since(name)
        return began_ns if began_ns >= self.since_ns else 0

    # --- time --------------------------------------------------------------------------------------

    def read_clocks(self) -> tuple[int, int]:
        """The time of day and of the clock that nobody sets, at one moment (ns)."""
        return read_together(self._now_ns, self._read_monotonic)

    def tick(self, now_ns: int, monotonic_ns: int) -> int:
        """Time has passed, and all that the tap had by then was taken: the time for the judges (ns)."""
        self._monotonic_ns = monotonic_ns
        clock_ns = self.clock.tick(now_ns)
        if self.clock.is_lost:
            why = "this monitor does not keep up with what it receives"
            self._start_anew(now_ns, monotonic_ns, why, held_up=True)
        for gap in self._gaps(now_ns, clock_ns):
            self._judges.gap(gap)
        return clock_ns

    def _gaps(self, now_ns: int, clock_ns: int) -> Iterator[Gap]:
        """What the tap has dropped, and what does not come any more."""
        for channel, source in () if self.listener is None else self.listener.take_dropped():
            why = f"messages on {channel} came faster than they were judged"
            yield Gap(channel, source, self.clock.clock_ns - self._latency_ns, now_ns, why)
        yield from self.sources.advance(clock_ns)

    def _seems_set(self, gap_ns: int) -> bool:
        """Whether ``gap_ns`` since the last tick is not what has passed on the clock that nobody sets."""
        set_ns = gap_ns - (self._read_monotonic() - self._monotonic_ns)
        return not -SET_NS <= set_ns <= SET_NS

    def look_at_clock(self, now_ns: int, monotonic_ns: int) -> None:
        """Whether time goes on as it should; else what was missed is reported."""
        gap_ns = now_ns - self.clock.now_ns
        passed_ns = max(monotonic_ns - self._monotonic_ns, 0)
        set_ns = gap_ns - passed_ns
        if gap_ns > self.clock.limit_ns and passed_ns > gap_ns // 2:
            what = f"this monitor stood still for {gap_ns / NS:.1f} s; what happened was missed"
        elif set_ns < -SET_NS:
            what = f"the clock was set back by {_duration(-set_ns)}"
        elif set_ns > SET_NS:
            what = f"the clock was set forward by {_duration(set_ns)}"
        else:
            return
        self._start_anew(now_ns, monotonic_ns, what, held_up=passed_ns > self._latency_ns)

    def _start_anew(
        self,
        now_ns: int,
        monotonic_ns: int,
        why: str,
        held_up: bool = False,
        is_late: bool = False,
    ) -> None:
        """Something is not known to be received, of any node, or stamps begin elsewhere."""
        self._counts.stalls += 1
        passed_ns = max(monotonic_ns - self._monotonic_ns, 0)
        back_ns = passed_ns - (now_ns - self.clock.now_ns)
        was_set, was_set_back = abs(back_ns) > SET_NS, back_ns > SET_NS
        from_ns = self.clock.clock_ns - self._latency_ns
        self.since_ns = now_ns
        if was_set_back:
            self.since_ns += self._overlap_ns(back_ns)
        elif held_up:  # what is missing and what is on its way look alike
            self.since_ns += self._repair_ns
        self._monotonic_ns = monotonic_ns
        if was_set:
            self.sources.clock_set(now_ns, self.since_ns)
        else:
            self.sources.restart()
        if was_set and not held_up:
            self.sources.clocks.clock_set()
        elif not is_late:  # what comes late may be of clocks that were set
            self.sources.clocks.restart()
        self.sources.listening_ns = self.since_ns
        self.numbers.clear()
        self.clock.restart(now_ns, held_up)
        self._judges.start_anew(from_ns, self.since_ns, was_set_back, why)

    def _overlap_ns(self, back_ns: int) -> int:
        """The clock was set back: so long may a stamp be from before that or from after it.

        A hybrid logical clock stands still meanwhile. Where it is longer than what is on its way may take,
        stamps of before are seen to be of the future.
        """
        is_short = back_ns <= self.clock.limit_ns and not self._in_order
        return back_ns + SET_NS if is_short else 0


def _duration(duration_ns: int) -> str:
    """For people."""
    if duration_ns < NS // 10:
        return f"{duration_ns / 1_000_000:.0f} ms"
    return f"{duration_ns / NS:.1f} s"
