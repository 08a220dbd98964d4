"""What a tap hands over, made fit for judges: in time, of its type, with what is missing reported before it.

The only code that knows that observations arrive late, twice or not at all, that a clock may be set and
that a monitor may stand still. Live, recorded and simulated runs go through it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import msgspec

from moon.feed.clock import (
    NS,
    PERIOD_NS,
    SET_NS,
    EventTimeClock,
    clock_nobody_sets,
    clocks_of,
    read_together,
)
from moon.feed.counts import Counts
from moon.feed.held import Held
from moon.feed.nodes import Nodes
from moon.feed.numbers import Numbers
from moon.feed.reception import Reception
from moon.judge import Gap, Intake, Missing
from moon.oracle.bounds import LINKED_NS, Bounds
from moon.sources.source import Source
from transports.bounded import BoundedDict
from transports.interface import (
    CLIENT_END,
    SERVER_END,
    Answer,
    BlindSpot,
    BlindSpotKind,
    Observation,
    ObservationKind,
    Tap,
)
from transports.sequences import Sequel
from transports.sequences import Sequence as Numbered

_MESSAGE = ObservationKind.MESSAGE
_REQUEST_OF = {kind: end[0] for end in (CLIENT_END, SERVER_END) for kind in end}
"""What each end of a call reports first."""
_MISSING = {
    BlindSpotKind.NOT_RECEIVED: Missing.NOT_RECEIVED,
    BlindSpotKind.MAY_NOT_BE_TAKEN: Missing.MAY_NOT_BE_TAKEN,
    BlindSpotKind.OTHER_TIME: Missing.OTHER_TIME,
}
_KEPT_CALLS = 4096
"""So many ends of calls without numbers are remembered; their names come from the wire, and never end."""


class Feed:
    """Event time, for the judges of one tap.

    Args:
        source: where observations come from: its clocks are looked at.
        bounds: what is assumed of the middleware.
        reception: looks at stamps, types and sources.
        counts: what is counted.
        known: the nodes of the system.
        in_order: nothing is on its way: each observation comes before all that happened after it.

    Attributes:
        sources: how far all nodes have reported.
        clock: of the judges.
        numbers: the last one of each source and channel.
        since_ns: what is stamped before is not judged.
        listener: the tap, once there is one.
    """

    def __init__(
        self,
        source: Source,
        bounds: Bounds,
        reception: Reception,
        counts: Counts,
        known: Iterable[str] = (),
        in_order: bool = False,
    ) -> None:
        self._in_order = in_order
        self._now_ns = source.now_ns
        self._read_monotonic = clock_nobody_sets(source)
        """By it a standstill is distinguished from a clock that was set."""
        self._latency_ns = bounds.latency
        self._source = source
        self._repair_ns = 0
        self._reception = reception
        self._counts = counts
        self.sources = Nodes(bounds.latency, bounds.differ)
        self.clock = EventTimeClock(source.now_ns(), bounds.latency)
        self.since_ns = 0
        self.listener: Tap | None = None
        self._monotonic_ns = self._read_monotonic()
        self.numbers = Numbers(known)
        self._unnumbered: BoundedDict[tuple[str, str, ObservationKind, str, int, int], None] = (
            BoundedDict(_KEPT_CALLS)
        )
        """Calls' ends that have no number: who did what in which call, and when."""
        self._failed_first: Held[Observation] = Held()
        """Calls that failed before their requests were received: on ROS 2 these are on another topic."""
        self._blind_spots: Mapping[BlindSpot, str] = {}
        """What the tap did not know when it was last asked."""
        self._late: dict[str, int] = {}
        """When an observation of each source was last received too late."""

    def start(self, listener: Tap, since_ns: int = 0, finds_nodes: bool = True) -> int:
        """Judging begins now; since when all is received (ns), by default since now.

        Args:
            listener: the tap.
            since_ns: since when all is received (ns); 0: since now.
            finds_nodes: somebody says which nodes are there.
        """
        self.listener = listener
        self._repair_ns = round(self._source.repair_s * NS)  # of a recording, its beginning says it
        self.sources.clocks.are_own = self._repair_ns > 0  # such a middleware has no hybrid clock
        self.sources.clocks.are_told = bool(clocks_of(self._source)(""))
        self.sources.are_found = finds_nodes
        now_ns, self._monotonic_ns = self.read_clocks()
        self.since_ns = self.sources.listening_ns = since_ns or now_ns
        self.clock.restart(now_ns)
        return self.since_ns

    # --- what is received --------------------------------------------------------------------------

    def take(self, seen: Observation, now_ns: int) -> Intake:
        """What is found of ``seen``, received at ``now_ns``."""
        intake, clock = Intake(seen, now_ns), self.clock
        gap_ns = now_ns - clock.now_ns
        if not -SET_NS <= gap_ns <= clock.limit_ns or self._seems_set(gap_ns):
            intake.miss(self.look_at_clock(*self.read_clocks()))
        if self.listener is not None and self.listener.is_contested(seen.source):
            # from the node of this name or from another: nothing is concluded from it
            why = f"several sessions claim to be {seen.source}"
            gap = _not_judged(seen, clock.clock_ns, now_ns, why)
            intake.miss(msgspec.structs.replace(gap, cause=Missing.CONTESTED))
            if self.is_timed(seen.stamp_ns, now_ns):
                self._is_new(intake)  # it is not missing before the next
            return intake
        is_timed = self.is_timed(seen.stamp_ns, now_ns)
        if is_timed:
            is_held = seen.kind is not ObservationKind.MESSAGE
            intake.miss(self.heard(seen.source, seen.stamp_ns, now_ns, is_held, seen.order >= 0))
            for gap in self._crossed(seen, now_ns):
                intake.miss(gap)
        intake.miss(self.sources.take(seen, clock.clock_ns, is_timed))
        judged = self._reception.judge(seen, now_ns)
        if not is_timed:
            intake.miss(self._pass_over(seen, now_ns))
        if seen.stamp_ns < self.since_ns:
            self._counts.before += 1
            return intake
        if isinstance(judged, str):
            if judged:
                intake.miss(_not_judged(seen, clock.clock_ns, now_ns, judged))
            return intake
        lag_ns = now_ns - judged.stamp_ns
        if lag_ns > clock.limit_ns:
            if self._is_new(intake):  # its number counts: it is not missing before the next
                intake.miss(self._too_late(seen, lag_ns, now_ns))
            return intake
        clock.received(lag_ns)
        if not self._is_new(intake):
            return intake
        limit_ns = clock.reach_ns(now_ns)
        if judged.received_ns > limit_ns + 2 * PERIOD_NS:
            # the judges' clock is behind the time of day
            judged = msgspec.structs.replace(judged, received_ns=limit_ns)
        intake.judged = judged
        return intake

    def is_timed(self, stamp_ns: int, now_ns: int) -> bool:
        """Whether a stamp tells when something happened; else it is of before a clock was set, or of one
        that differs. Numbers order it all the same.
        """
        return self.since_ns <= stamp_ns and not self._reception.is_future(stamp_ns, now_ns)

    def heard(
        self,
        node: str,
        stamp_ns: int,
        now_ns: int,
        is_held: bool = False,
        is_numbered: bool = False,
    ) -> Gap | None:
        """Something of ``node`` was received at ``now_ns``: it can be reached, and its clock may be set.

        See ``HostClocks.heard``.
        """
        self.sources.reachability.heard(node, stamp_ns, now_ns - stamp_ns)
        if not node:
            return None
        set_ns = self.sources.clocks.heard(node, stamp_ns, now_ns, is_held, is_numbered)
        return self._host_clock_set(node, set_ns, now_ns) if set_ns else None

    def answered(self, node: str, asked_ns: int, stamp_ns: int, now_ns: int) -> Gap | None:
        """``node``, asked at ``asked_ns``, answered at ``stamp_ns`` by its clock, which may differ."""
        set_ns = self.sources.clocks.answered(node, asked_ns, stamp_ns, now_ns)
        return self._host_clock_set(node, set_ns, now_ns) if set_ns else None

    def _host_clock_set(self, node: str, set_ns: int, now_ns: int) -> Gap:
        from_ns = self.clock.clock_ns - self._latency_ns - abs(set_ns)
        where = "forward" if set_ns > 0 else "back"
        what = f"the clock of the host of {node} was set {where} by {_duration(abs(set_ns))}"
        until_ns = now_ns + max(set_ns, 0) + 1
        return Gap("", node, from_ns, until_ns, what, cause=Missing.CLOCK_SET)

    def _crossed(self, seen: Observation, now_ns: int) -> list[Gap]:
        """What is not known any more where ``seen`` shows that the clocks of two hosts differ."""
        found = self.sources.clocks.crossed(seen)
        if found is None:
            return []
        sender, receiver, before_ns = found
        why = (
            f"the clocks of the hosts of {sender} and {receiver} differ: what one sends is received "
            f"{_duration(before_ns)} before"
        )
        from_ns = self.clock.clock_ns - self._latency_ns - before_ns
        return [
            Gap("", node, from_ns, now_ns + 1, why, cause=Missing.CLOCK_SET)
            for node in (sender, receiver)
        ]

    def _too_late(self, seen: Observation, lag_ns: int, now_ns: int) -> Gap:
        """One node's observations come too late, or (if not only one's) this monitor is slow."""
        self._counts.late += 1
        if self.sources.clocks.differs(seen.source):  # when it was sent is not known by its stamp
            from_ns = self.clock.clock_ns - self._latency_ns
            why = f"the clock of the host of {seen.source} differs"
            return _not_judged(seen, from_ns, now_ns, why)
        self._late[seen.source] = now_ns
        why = f"observations arrive {lag_ns / NS:.1f} s late"
        recent = [source for source, at in self._late.items() if now_ns - at < NS]
        if len(recent) == 1:
            self.sources.reachability.too_late(seen.source, lag_ns, now_ns)
            return _not_judged(seen, seen.stamp_ns, now_ns, f"{why} from {seen.source}")
        self._late.clear()
        return self._start_anew(*self.read_clocks(), why, held_up=True, is_late=True)

    def _is_new(self, intake: Intake) -> bool:
        """Look at its number: whether it was not received before, and what is missing before it."""
        seen = intake.seen
        number, stamp = seen.sequence, seen.stamp_ns
        if number < 0:
            if seen.client and self._is_known(seen):
                return False
            sequence = self.numbers.of(seen)
            if seen.error and (sequence.next < 0 or seen.life != sequence.life):
                sequence.unknown_until = max(sequence.unknown_until, seen.stamp_ns)
                self._failed_first.add(seen)
            return True
        sequence = self.numbers.of(seen)
        if number == sequence.next and seen.life == sequence.life:
            intake.miss(self._went_back(seen, sequence, intake.now_ns))
            sequence.next, sequence.stamp = number + 1, stamp
            return True
        before_ns = sequence.stamp
        intake.sequel = sequel = sequence.follow(number, stamp, seen.life)
        match sequel:
            case Sequel.AGAIN:
                self._counts.repeated += 1
                return False
            case Sequel.FIRST if 0 <= sequence.left_at < number:
                intake.miss(_lost(seen, self.since_ns, stamp))
            case Sequel.FIRST if number and seen.kind is ObservationKind.MESSAGE:
                for gap in self._before_first(seen):
                    intake.miss(gap)
            case Sequel.AFTER_A_GAP:
                for from_ns, until_ns in self.sources.missing_between(
                    seen.source, before_ns, stamp
                ):
                    intake.miss(_lost(seen, from_ns + 1, until_ns))
            case Sequel.ANEW if number:  # a node that has started again sends 0 first
                intake.miss(_lost(seen, before_ns + 1, stamp))
            case Sequel.FIRST | Sequel.ANEW if seen.order < 0:
                intake.miss(self._before_first_call(seen, before_ns))
            case _:
                pass
        return True

    def _is_known(self, seen: Observation) -> bool:
        """Whether the same was received of a call, which has no number: an end of a call does it once."""
        same = seen.source, seen.channel, seen.kind, seen.client, seen.call, seen.stamp_ns
        if same in self._unnumbered:
            self._counts.repeated += 1
            return True
        self._unnumbered[same] = None
        return False

    def _went_back(self, seen: Observation, sequence: Numbered, now_ns: int) -> Gap | None:
        """What is not known where ``seen``, the next by its number, is stamped before the last one."""
        back_ns = seen.stamp_ns - sequence.stamp
        if back_ns >= -SET_NS:
            return None
        is_news = self.sources.clocks.went_back(seen.source, now_ns - seen.stamp_ns)
        return self._host_clock_set(seen.source, back_ns, self.clock.now_ns) if is_news else None

    def _pass_over(self, seen: Observation, now_ns: int) -> Gap | None:
        """Nobody knows when ``seen`` happened; its number counts, so that the next one follows."""
        number, stamp = seen.sequence, min(seen.stamp_ns, self.since_ns - 1)
        if number < 0:
            return None
        sequence = self.numbers.of(seen)
        is_next = number == sequence.next and seen.life == sequence.life
        gap = self._went_back(seen, sequence, now_ns) if is_next else None
        sequence.follow(number, stamp, seen.life)
        sequence.unknown_until = min(sequence.unknown_until, self.since_ns)
        return gap

    def _before_first(self, seen: Observation) -> Iterator[Gap]:
        """The first message of a node that came up while the monitor listened has number 0."""
        started_ns = self._began_heard(seen.source)
        if not started_ns:
            return
        why = f"what {seen.source} sent first on {seen.channel} was missed"
        for from_ns, until_ns in self.sources.missing_between(
            seen.source, started_ns - 1, seen.stamp_ns
        ):
            yield _not_judged(seen, from_ns + 1, until_ns, why)

    def _before_first_call(self, seen: Observation, before_ns: int) -> Gap | None:
        """What was missed before ``seen``, the first that its source, in this life, reports of the calls of a
        service; the last of the life before was at ``before_ns``.

        Nothing is reported before who reports it knows of the monitor, so that the first report has number 0
        all the same. But a client numbers its calls from 1, and each end reports a request before the
        response. Within ``LINKED_NS`` a node that is up knows of the monitor.
        """
        request = _REQUEST_OF.get(seen.kind)
        if request is None:
            return None
        up_ns = self._began_heard(seen.source)
        if request is not seen.kind:
            began_ns = up_ns or self.since_ns
            missed = f"what {seen.source} did first in calls of {seen.channel} was missed"
        elif seen.call > 1 and not self._is_heard_from_first_call(seen):
            began_ns = self._began_heard(seen.client) or up_ns
            missed = f"the first calls of {seen.client} to {seen.channel} were missed"
        else:
            return None
        if not began_ns:
            return None
        self.numbers.of(seen).unknown_until = seen.stamp_ns
        from_ns = max(began_ns, before_ns + 1)
        until_ns = min(seen.stamp_ns, max(up_ns, from_ns) + LINKED_NS if up_ns else seen.stamp_ns)
        return Gap(seen.channel, seen.source, from_ns, until_ns, missed, request)

    def _is_heard_from_first_call(self, seen: Observation) -> bool:
        """Whether what its client did in calls of the service was received from the first on: an earlier life
        of the server had those of before.
        """
        client = self.numbers.counts.get((seen.client, seen.channel, False))
        is_heard = client is not None and client.next >= 0 and not client.unknown_until
        return is_heard and seen.source != seen.client

    def _began_heard(self, name: str) -> int:
        """When ``name`` began to connect (ns), if the monitor listened by then; else 0."""
        began_ns = self.sources.up_since(name)
        return began_ns if began_ns >= self.since_ns else 0

    def is_whole(self, seen: Sequence[Observation], answers: Mapping[str, Answer]) -> bool:
        """Whether nothing is missing before or between these observations, nor after them, by their numbers.

        Args:
            seen: not taken yet, in any order.
            answers: how far nodes say that they have reported.
        """
        if any(one.order < 0 and one.sequence < 0 and one.kind is _MESSAGE for one in seen):
            return False
        # what was dropped last shows in no number; it is sent again, or its node says so
        if not self._repair_ns and any(
            source not in answers and self.sources.may_be_there(source)
            for source, channel, _ in self.numbers.counts
            if self._reception.is_named(channel)
        ):
            return False
        return self.numbers.are_next(seen) and self.sources.are_next(seen, answers)

    # --- time --------------------------------------------------------------------------------------

    def read_clocks(self) -> tuple[int, int]:
        """The time of day and of the clock that nobody sets, at one moment (ns)."""
        return read_together(self._now_ns, self._read_monotonic)

    def tick(self, now_ns: int, monotonic_ns: int) -> tuple[int, list[Gap]]:
        """Time has passed, and all that the tap had by then was taken.

        Returns:
            The time for the judges (ns), and what is missing.
        """
        self._monotonic_ns = monotonic_ns
        clock_ns = self.clock.tick(now_ns)
        gaps: list[Gap] = []
        if self.clock.is_lost:
            why = "this monitor does not keep up with what it receives"
            gaps.append(self._start_anew(now_ns, monotonic_ns, why, held_up=True))
        if self.listener is not None:
            gaps.extend(self._not_handed_over(self.listener, now_ns))
        gaps.extend(self.sources.advance(clock_ns))
        gaps.extend(self._not_requested(clock_ns - self._latency_ns))
        return clock_ns, gaps

    def _not_requested(self, until_ns: int) -> Iterator[Gap]:
        """What was missed before calls that failed up to ``until_ns``, unless their requests came since."""
        failed = self._failed_first
        for seen in failed.take(failed.count(until_ns)) if failed.stamps else ():
            sequence = self.numbers.of(seen)
            if sequence.unknown_until >= seen.stamp_ns:
                gap = self._before_first_call(seen, sequence.stamp)
                if gap is not None:
                    yield gap

    def _not_handed_over(self, tap: Tap, now_ns: int) -> Iterator[Gap]:
        """What ``tap`` dropped since it was last asked, and what it does not know."""
        from_ns = self.clock.clock_ns - self._latency_ns
        for channel, source in tap.take_dropped():
            why = f"messages on {channel} came faster than they were judged"
            yield Gap(channel, source, from_ns, now_ns, why)
        before, self._blind_spots = self._blind_spots, dict(tap.blind_spots())
        for spot in sorted(self._blind_spots):
            kind, channel, node = spot
            if not channel or self._reception.may_concern(channel):
                # a tap learns some time later that it does not know something: that may have been so before
                since_ns = from_ns if spot in before else self.since_ns
                why = self._blind_spots[spot]
                yield Gap(channel, node, since_ns, now_ns, why, cause=_MISSING[kind])

    def _seems_set(self, gap_ns: int) -> bool:
        """Whether ``gap_ns`` since the last tick is not what has passed on the clock that nobody sets."""
        set_ns = gap_ns - (self._read_monotonic() - self._monotonic_ns)
        return not -SET_NS <= set_ns <= SET_NS

    def look_at_clock(self, now_ns: int, monotonic_ns: int) -> Gap | None:
        """What was missed, if time does not go on as it should."""
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
            return None
        return self._start_anew(now_ns, monotonic_ns, what, held_up=passed_ns > self._latency_ns)

    def _start_anew(
        self,
        now_ns: int,
        monotonic_ns: int,
        why: str,
        held_up: bool = False,
        is_late: bool = False,
    ) -> Gap:
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
        cause = Missing.OWN_CLOCK_SET if was_set else Missing.ANEW
        return Gap("", "", from_ns, self.since_ns, why, cause=cause)

    def _overlap_ns(self, back_ns: int) -> int:
        """The clock was set back: so long may a stamp be from before that or from after it.

        A hybrid logical clock stands still meanwhile. Where it is longer than what is on its way may take,
        stamps of before are seen to be of the future.
        """
        is_short = back_ns <= self.clock.limit_ns and not self._in_order
        return back_ns + SET_NS if is_short else 0


def _not_judged(seen: Observation, from_ns: int, until_ns: int, why: str) -> Gap:
    """``seen``, or what is like it, cannot be judged."""
    return Gap(seen.channel, seen.source, from_ns, until_ns, why, seen.kind)


def _lost(seen: Observation, from_ns: int, until_ns: int) -> Gap:
    """Something like ``seen`` was not received, as its number shows."""
    if from_ns >= until_ns:  # stamps that do not increase: it was sent at one of them
        from_ns, until_ns = min(from_ns - 1, until_ns), max(from_ns - 1, until_ns) + 1
    why = f"observations on {seen.channel} from {seen.source} were lost"
    return Gap(seen.channel, seen.source, from_ns, until_ns, why, seen.kind, Missing.NUMBERED)


def _duration(duration_ns: int) -> str:
    """For people."""
    if duration_ns < NS // 10:
        return f"{duration_ns / 1_000_000:.0f} ms"
    return f"{duration_ns / NS:.1f} s"
