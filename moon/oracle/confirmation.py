"""The verdict on one machine; a violation is certain once nothing that is missing can be the reason.

A tap may lose observations without reporting it: what is missing shows in the numbers of what comes after it.
So the verdict is *violated* only when, for everything that could explain the violation had it been lost, a
number that follows was received (decision 26). Until then it waits (``Unconfirmed``); for what, is decided by
``Confirmation``.

Both halves of an oracle share the ``Conclusion``: the judge reports to it what it finds (``found``,
``unknown``, ``known``), and the numbers of what is received show when that is certain (``numbered``,
``reported``, ``gave_up``). So the judge needs to know nothing of numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import msgspec

from moon.feed.nodes import Nodes
from moon.feed.numbers import Place
from moon.feed.progress import Progress
from moon.feed.reachability import Reachability
from moon.oracle.bounds import FOREVER, LINKED_NS, Bounds
from moon.oracle.calls import Call, KnownCalls, Where, is_nameless
from moon.oracle.evidence import Shown, evidence_of
from moon.oracle.in_transit import RequestTracking, TakenMessages
from moon.oracle.program import Program
from moon.oracle.source_streams import SourceStreams
from moon.verdict import Cause, Outcome, Verdict
from transports.interface import ObservationKind
from transports.sequences import Sequence

KEPT_VIOLATIONS = 16
"""More of them do not wait; the oldest go."""
KEPT_EVENTS = 1024
"""Events of calls of which only one end has reported yet."""

UNCONFIRMED = "if no observation is missing here: "
"""How the reason of a verdict begins that is not certain yet."""
NOT_NEEDED = 0


class Losses:
    """What the oracles of one tap know of it.

    Attributes:
        happen: observations have been lost.
        by_channel: nodes number each channel by itself, and it comes when it comes: what a node did in calls
            may be received seconds later than what it sent after that.
        possible: they can be. They cannot where the observations are a whole trace, as of a simulation:
            then nothing needs to be confirmed.
    """

    def __init__(self, happen: bool = False, possible: bool = True) -> None:
        self.happen = happen
        self.possible = possible
        self.by_channel = False

    @property
    def are_over_by_time(self) -> bool:
        """Whether what a node did in calls has come ``LINKED_NS`` later, or never comes."""
        return self.by_channel and not self.happen


class Violation(msgspec.Struct):
    """What a machine cannot have done, if nothing is missing.

    Attributes:
        verdict: the violation, as it is published once it is certain.
        since_ns: since when it is known what the machine does: what was lost before does not matter.
        until_ns: all that happened until then may explain it.
        is_silence: whether it is that something did not come. Then only what comes later shows that.
        expected: where what was expected would have come.
        is_certain: whether no observation that is missing can be the reason.
        call: the request whose answer was all that was expected; None: it was not.
    """

    verdict: Verdict
    since_ns: int
    until_ns: int
    is_silence: bool
    expected: list[Place]
    is_certain: bool = False
    call: Call | None = None


class Waiting(msgspec.Struct):
    """What has to be received before a violation is certain.

    Attributes:
        verdict: the violation.
        places: the number that has to come next at each place, after the violation.
        reported_ns: all that the node did until then has to be received, by the order of its reports;
            ``NOT_NEEDED`` where it is, or where the node counts per channel only.
        since_ns: since when it was known what the machine does.
        until_ns: all that happened until then may explain it.
        call: the request that a node which counts per channel did not answer; its client giving up shows the
            silence as well as the node's own next report does.
        is_given_up: the client of ``call`` has given up; that counts once the node can be reached.
        answer: the place at which the answer would have come.
        absent: those of ``places`` whose node was not found yet: it may have sent something before it was.
        ends: what the other ends of its calls say that the node did, about when the violation happened; its
            own report of each says whether that was later.
        clocks: the nodes whose clocks may have been set; what they do next shows that.
        is_asked: whether those that may show that it is certain were asked how far they have reported.
    """

    verdict: Verdict
    places: dict[Place, int] = {}
    reported_ns: int = NOT_NEEDED
    since_ns: int = 0
    until_ns: int = 0
    call: Call | None = None
    is_given_up: bool = False
    answer: Place | None = None
    absent: frozenset[Place] = frozenset()
    ends: set[tuple[Where, Call]] = set()
    clocks: set[str] = set()
    is_asked: bool = False

    @property
    def is_over(self) -> bool:
        """Whether nothing is left to wait for."""
        if self.places or self.ends or self.clocks:
            return False
        return self.reported_ns == NOT_NEEDED

    def is_limited(self, place: Place) -> bool:
        """Whether nothing that matters comes at ``place`` later than ``LINKED_NS`` after the violation."""
        return not place[2] or place in self.absent


class Unconfirmed:
    """The violations of one machine that are not certain yet."""

    def __init__(self) -> None:
        self.kept: list[Waiting] = []

    def add(self, waiting: Waiting) -> None:
        """``waiting`` is certain once what it waits for has come."""
        self.kept.append(waiting)
        del self.kept[:-KEPT_VIOLATIONS]

    def numbered(self, place: Place, number: int, stamp: int) -> list[Verdict]:
        """An observation's number shows whether something was lost at its place before it.

        Args:
            place: where it came.
            number: its number there.
            stamp: when it happened (ns). What happened before a violation and comes only now was
                missing when it was judged: it was no violation.

        Returns:
            The verdicts that are certain by now.
        """
        for waiting in tuple(self.kept):
            wanted = waiting.places.get(place)
            if wanted is None:
                continue
            if number != wanted or stamp <= waiting.verdict.stamp_ns:
                self.kept.remove(waiting)
            else:
                del waiting.places[place]
        return self._certain()

    def reported(self, until_ns: int, gap_ns: int) -> list[Verdict]:
        """All that the node did until ``until_ns`` has been received but what happened before ``gap_ns``."""
        for waiting in tuple(self.kept):
            if waiting.reported_ns == NOT_NEEDED:
                continue
            if gap_ns > waiting.since_ns:
                self.kept.remove(waiting)
            elif until_ns >= waiting.reported_ns:
                waiting.reported_ns = NOT_NEEDED
        return self._certain()

    @property
    def silent_ns(self) -> int:
        """From then on (ns) :meth:`silent` may make one of them certain; FOREVER: it does not."""
        if any(waiting.is_given_up for waiting in self.kept):
            return 0
        waiting = (w.verdict.stamp_ns for w in self.kept if any(map(w.is_limited, w.places)))
        return min(waiting, default=FOREVER - LINKED_NS) + LINKED_NS

    def silent(
        self, is_reached: Callable[[int], bool], until_ns: int, are_over_by_time: bool
    ) -> list[Verdict]:
        """It is ``until_ns``: what a node that can be reached did not report by now, it does not any more.

        Args:
            is_reached: whether it can be, as is known from what came since then (ns).
            until_ns: now.
            are_over_by_time: what a node reported of calls ``LINKED_NS`` before came, or will not come; and
                who was there then was found.
        """
        for waiting in self.kept:
            is_over = are_over_by_time and waiting.verdict.stamp_ns < until_ns - LINKED_NS
            if not (waiting.is_given_up or is_over) or not is_reached(waiting.verdict.stamp_ns):
                continue
            if waiting.is_given_up:
                waiting.reported_ns, waiting.call, waiting.is_given_up = NOT_NEEDED, None, False
                if waiting.answer is not None:
                    waiting.places.pop(waiting.answer, None)
            if is_over:
                for place in [*filter(waiting.is_limited, waiting.places)]:
                    del waiting.places[place]
        return self._certain()

    def settled(self, other_ends: OtherEnds, stamp: int) -> list[Verdict]:
        """The node reported what it did at ``stamp``; what is open of the other ends is in ``other_ends``."""
        for waiting in tuple(self.kept):
            told = {end for end in waiting.ends if not other_ends.is_open(*end)}
            if told and stamp <= waiting.until_ns:
                self.kept.remove(waiting)
            waiting.ends -= told
        return self._certain()

    def to_ask(self, node: str) -> set[str]:
        """Who may show that a violation of ``node`` is certain, by saying how far they have reported."""
        found: set[str] = set()
        for waiting in self.kept:
            if not waiting.is_asked:
                waiting.is_asked = True
                found.update(place[0] for place in waiting.places)
                found.update((node,) if waiting.reported_ns != NOT_NEEDED else ())
                found.update(waiting.clocks)
        return found

    def told(self, sources: Nodes, node: str, skew_ns: int) -> list[Verdict]:
        """What other nodes than ``node`` did was received up to some time, by the order of their reports."""
        for waiting in self.kept:
            if waiting.clocks:
                waiting.clocks = sources.clocks.doubtful(waiting.clocks)
            until_ns = waiting.until_ns + skew_ns
            for place in tuple(waiting.places):
                if place[0] != node and sources.is_whole(place[0], waiting.since_ns, until_ns):
                    del waiting.places[place]
        return self._certain()

    def counts_per_channel(self) -> list[Verdict]:
        """The node, of which something is received now, does not number all that it reports."""
        for waiting in self.kept:
            waiting.reported_ns = NOT_NEEDED
        return self._certain()

    def gave_up(self, channel: str, call: Call, stamp: int) -> None:
        """The client of ``call`` on ``channel`` had no answer when it gave up at ``stamp`` (ns)."""
        for waiting in self.kept:
            is_answer = waiting.answer is not None and waiting.answer[1] == channel
            if is_answer and waiting.call == call and stamp > waiting.verdict.stamp_ns:
                waiting.is_given_up = True

    def doubt(self, since_ns: int) -> None:
        """Drop the violations stamped ``since_ns`` or later; see ``Oracle.doubt``."""
        self.kept = [waiting for waiting in self.kept if waiting.verdict.stamp_ns < since_ns]

    def restart(self) -> None:
        """The node counts anew: the end of what it reported before is not known."""
        self.kept = [waiting for waiting in self.kept if waiting.reported_ns == NOT_NEEDED]

    def _certain(self) -> list[Verdict]:
        found = [waiting.verdict for waiting in self.kept if waiting.is_over]
        if found:
            self.kept = [waiting for waiting in self.kept if not waiting.is_over]
        return found


class OtherEnds:
    """What the other ends of a node's calls show that it did, and it did not report.

    For nodes that number their reports per channel only. One report of two on the same event is enough.

    Args:
        latency: an end of a call reports of it within this time of what the other end reports (ns).
    """

    def __init__(self, latency: int) -> None:
        self._latency = latency
        self._reported = KnownCalls()
        self._implied = KnownCalls()
        self._dropped_ns = 0
        """What is not remembered happened until then."""

    def report(self, where: Where, call: Call, stamp: int) -> None:
        """The node itself reported that something happened to ``call`` at ``stamp`` (ns)."""
        if self._implied.remove(where, call) and not is_nameless(call[0]):
            return
        self._reported.add(where, call, stamp)
        if self._reported.count > KEPT_EVENTS:
            self._reported.drop_oldest()

    def imply(self, where: Where, call: Call, stamp: int) -> None:
        """By the other end, it happened, about ``stamp`` (ns)."""
        if self._reported.has(where, call):
            return
        self._implied.add(where, call, stamp)
        if self._implied.count > KEPT_EVENTS:
            self._dropped_ns = max(self._dropped_ns, self._implied.drop_oldest())

    def are_missing(self, since_ns: int, until_ns: int) -> bool:
        """Whether the node may have done something since ``since_ns`` that it did not report.

        All that the other ends did by ``until_ns`` counts. What they did later, see ``unsettled``.
        """
        if self._dropped_ns > since_ns - self._latency:
            return True
        return any(
            since_ns < self._latest(where, stamp) and stamp <= until_ns
            for where, _, stamp in self._implied.items()
        )

    def _latest(self, where: Where, stamp: int) -> int:
        """When it happened at the latest: a response is received later than it was sent."""
        return stamp + self._latency if where[0] == ObservationKind.RESPONSE_RECEIVED else stamp

    def has_any(self, since_ns: int) -> bool:
        """Whether the node did something from ``since_ns`` on, by the other ends."""
        return any(stamp >= since_ns for _, _, stamp in self._implied.items())

    def unsettled(self, until_ns: int) -> set[tuple[Where, Call]]:
        """What the node did not report yet, and may have done by ``until_ns`` or after that.

        Of what it does now, the other end's report may be received first.
        """
        last_ns = until_ns + self._latency
        return {
            (where, call)
            for where, call, stamp in self._implied.items()
            if until_ns < stamp <= last_ns
        }

    def is_open(self, where: Where, call: Call) -> bool:
        """Whether the node has not reported yet what is ``unsettled``."""
        return self._implied.has(where, call)

    def clear(self) -> None:
        """The node has started anew."""
        self._reported.clear()
        self._implied.clear()


class Publishers:
    """Who may publish on a topic although nothing was received from it yet: nodes that are up, by the models.

    Args:
        of_channel: names of the nodes whose models publish on each channel.
        callers: nodes whose word is taken for it that they sent a request; None: everybody's. A stranger can
            say so of a request that nobody sent.
    """

    def __init__(
        self,
        of_channel: Mapping[str, Iterable[str]] | None = None,
        callers: Iterable[str] | None = None,
    ) -> None:
        self._callers = None if callers is None else frozenset(callers)
        self._of_channel = {name: frozenset(nodes) for name, nodes in (of_channel or {}).items()}
        self._up: set[str] = set()

    def came_up(self, node: str) -> None:
        """``node`` is or was there."""
        self._up.add(node)

    def is_caller(self, node: str) -> bool:
        """Whether ``node`` is known, and its word taken."""
        return self._callers is None or node in self._callers

    def on(self, channel: str) -> list[str]:
        """Nodes that may have published on ``channel``."""
        return sorted(self._of_channel.get(channel, frozenset()) & self._up)

    def absent(self, channel: str) -> list[str]:
        """Nodes that publish on ``channel`` and are not known to be there, nor to have been."""
        return sorted(self._of_channel.get(channel, frozenset()) - self._up)


# --- what has to be received first ----------------------------------------------------------------


class Tracked(msgspec.Struct):
    """What is kept of what is received of one machine; never replaced.

    Attributes:
        streams: the numbers of what was received.
        progress: of all that its node reports, where it numbers that.
        other_ends: of its calls.
        requests, takes: what others sent to it.
        reachability: when nodes were heard in time; None: they always can be reached.
    """

    streams: SourceStreams
    progress: Progress
    other_ends: OtherEnds
    requests: RequestTracking
    takes: TakenMessages
    reachability: Reachability | None


class Confirmation:
    """Decides what would show that nothing is missing which explains a violation.

    Args:
        node: the node that runs the machine.
        bounds: what is assumed of the middleware.
        program: the machine.
        tracked: what was received of the machine.
        publishers: who may publish although nothing was received from them.
        losses: what is known of the tap.
        sources: how far all nodes have reported, where they number that.
    """

    def __init__(
        self,
        node: str,
        bounds: Bounds,
        program: Program,
        tracked: Tracked,
        publishers: Publishers,
        losses: Losses,
        sources: Nodes,
    ) -> None:
        self._node = node
        self._sources = sources
        self._skew, self._latency = bounds.skew, bounds.latency
        self._silent_ns = bounds.deadline + bounds.latency
        self._taken_topics = program.taken_topics()
        self._services = program.services()
        self._streams = tracked.streams
        self._progress = tracked.progress
        self._other_ends = tracked.other_ends
        self._publishers = publishers
        self._losses = losses
        self._takes = tracked.takes

    def needed(self, violation: Violation) -> Waiting | None:
        """What has to be received before ``violation`` is certain; None if something was lost already."""
        verdict = violation.verdict
        if violation.is_certain or not self._losses.possible:
            return Waiting(verdict)
        after, since = violation.until_ns, violation.since_ns
        is_silence, expected = violation.is_silence, violation.expected
        places: dict[Place, int] = {}
        known = self._wait_for_others(places, after, since)
        counted = self._progress.reported_ns
        if counted:  # its node numbers all that it reports
            known = known and self._progress.gap <= since
            # what comes with the very stamp may be what did not come
            reported = NOT_NEEDED if counted >= after else after + is_silence
        else:
            reported = NOT_NEEDED
            known = known and not self._other_ends.are_missing(since, after + self._skew)
            own = {p: c for p, c in self._streams.counts.items() if p[0] == self._node}
            # nothing was received from it, so it is not known how it numbers; or nothing since it has started
            if not own or self._sources.is_numbered(self._node):
                reported = after + 1
            if not own or any(count.next >= 0 for count in own.values()):
                places.update((p, 0) for p in expected if p[2] and p not in own)
            losses = self._losses
            if losses.by_channel and not self._sources.is_announced(self._node):
                # a call may have gone by unseen of which the other end is not found yet
                unheard = ((self._node, channel, False) for channel in self._services)
                places.update((place, 0) for place in unheard if place not in own)
            for place, count in own.items():
                wanted = place[2] or losses.happen or losses.by_channel
                if wanted or (is_silence and place in expected):
                    known = self._wait_for(places, place, count, after, since) and known
        heard = {self._node, *(place[0] for place in self._streams.counts)}
        if not known or self._sources.reachability.may_be_late(heard, after - self._latency):
            return None
        waiting = Waiting(verdict, places, reported, since, after)
        waiting.clocks = self._sources.clocks.doubtful(heard)
        waiting.absent = frozenset(
            place for place in places if place[2] and place[0] in self._publishers.absent(place[1])
        )
        if not counted:
            waiting.ends = self._other_ends.unsettled(after + self._skew)
            # who numbers all that it does can say so itself: its client may be cut off from it
            if reported == NOT_NEEDED:
                waiting.call = violation.call
                waiting.answer = expected[0] if violation.call is not None else None
        return waiting

    def may_have_missed(self, expected: list[Place], by_ns: int) -> bool:
        """Whether what is ``expected`` by ``by_ns`` may have been missed: its channel was silent by then.

        What a node numbers, it numbers on channels too that are not found yet. A message that comes later
        shows that it was missed; of a call nothing comes later.
        """
        if self._progress.reported_ns:
            return False
        may_have_missed, silent_ns = self._streams.may_have_missed, self._silent_ns
        messages = [channel for _, channel, is_message in expected if is_message]
        calls = [channel for _, channel, is_message in expected if not is_message]
        called_ns = LINKED_NS if self._losses.by_channel else silent_ns
        return may_have_missed(messages, by_ns, silent_ns) or may_have_missed(
            calls, by_ns, called_ns
        )

    def _wait_for_others(self, places: dict[Place, int], after: int, since: int) -> bool:
        """Add the topics of others whose numbers alone show what the machine took of them.

        Returns:
            Whether it is known what they sent; not where some of that is missing.
        """
        counts = self._streams.counts
        known = True
        reported = self._takes.reported
        shown = {
            channel
            for channel, kind in self._taken_topics.items()
            if evidence_of(kind, reported) is Shown.BY_SENDER
        }
        for numbered, count in counts.items():
            source, channel, is_message = numbered
            if source != self._node and is_message and channel in shown:
                known = self._wait_for(places, numbered, count, after, since) and known
        for channel in shown:
            publishers = self._publishers.on(channel)
            if self._losses.by_channel:  # a node is found once all its channels are linked
                publishers += self._publishers.absent(channel)
            for source in publishers:
                place = (source, channel, True)
                if source != self._node and place not in counts:
                    places[place] = 0
        until = after + self._skew
        for place in tuple(places):
            if self._sources.is_whole(place[0], since, until):
                del places[place]
        return known

    def _wait_for(
        self, places: dict[Place, int], place: Place, count: Sequence, after: int, since: int
    ) -> bool:
        """Add the next number of one place; False: some of what came there is not known.

        What is not numbered (a bag's, a stranger's) is taken for whole.
        """
        if count.next < 0:
            return True
        if count.unknown_until > since:
            return False
        if count.stamp <= after + self._skew:
            places[place] = count.next
        return True


# --- the verdict as it stands ---------------------------------------------------------------------


class Conclusion:
    """The verdict on one machine, or on the policy, as it stands.

    Args:
        machine: its name.
        node: the node that runs it.
        needed: what has to be received before a violation is certain; None if something was lost already.

    Attributes:
        outcome: of the verdict.
        violations: how many were certain.
        unconfirmed: those that are not certain yet.
        suspected: the violation that makes the verdict inconclusive, as it is not certain; None: none does.
    """

    def __init__(
        self, machine: str, node: str, needed: Callable[[Violation], Waiting | None]
    ) -> None:
        self.outcome = Outcome.CONFORMING
        self.violations = 0
        self.unconfirmed = Unconfirmed()
        self.suspected: Verdict | None = None
        self._needed = needed
        self._machine = machine
        self._node = node
        self._reason = ""

    def verdict(self, stamp_ns: int) -> Verdict:
        """The verdict as it stands at ``stamp_ns``."""
        missing = Cause.MISSING_OBSERVATION if self.suspected is not None else None
        return Verdict(
            self._machine, self._node, self.outcome, stamp_ns, self._reason, cause=missing
        )

    # --- what the judge finds ------------------------------------------------------------------------

    def found(self, violation: Violation) -> tuple[list[Verdict], bool]:
        """``violation`` was found.

        Returns:
            What is to be published now, and whether what the machine does is still known after it: it is not
            where something is missing that may explain it.
        """
        needed = self._needed(violation)
        verdict = violation.verdict
        if needed is not None:
            if needed.is_over:
                return self._confirmed([verdict]), True
            self.unconfirmed.add(needed)
            if self.outcome is Outcome.VIOLATED:
                return [], True  # it is, whether this one is certain or not
        reason = f"{UNCONFIRMED}{verdict.reason}"
        if needed is None:
            reason = f"observations were lost; {reason}"
        return self.unknown(verdict.stamp_ns, reason, True, verdict), needed is not None

    def unknown(
        self,
        stamp_ns: int,
        reason: str,
        is_news: bool = False,
        suspected: Verdict | None = None,
    ) -> list[Verdict]:
        """It is not known what the machine does.

        Args:
            stamp_ns: since when.
            reason: why, for people.
            is_news: whether that is the reason from now on where there is one already.
            suspected: the violation that is the reason.
        """
        was_unknown = self.outcome is Outcome.INCONCLUSIVE
        if is_news or not was_unknown:
            self._reason, self.suspected = reason, suspected
        self.outcome = Outcome.INCONCLUSIVE
        return [] if was_unknown else [self.verdict(stamp_ns)]

    def known(self) -> None:
        """It is known what the machine does, and all that it did is what its model does."""
        if not self.unconfirmed.kept:
            self.outcome, self._reason, self.suspected = Outcome.CONFORMING, "", None

    def restart(self) -> None:
        """The machine starts, in its initial state."""
        self.unconfirmed.restart()
        self.outcome, self._reason, self.suspected = Outcome.CONFORMING, "", None

    # --- what is received, and may confirm a violation -----------------------------------------------

    def numbered(self, place: Place, number: int, stamp_ns: int) -> list[Verdict]:
        """Something came with ``number`` at ``place``, and happened at ``stamp_ns``."""
        return self._confirmed(self.unconfirmed.numbered(place, number, stamp_ns))

    def reported(self, until_ns: int, gap_ns: int) -> list[Verdict]:
        """All that the node did until ``until_ns`` was received but what happened before ``gap_ns``."""
        return self._confirmed(self.unconfirmed.reported(until_ns, gap_ns))

    def silent(
        self, is_reached: Callable[[int], bool], until_ns: int, are_over_by_time: bool
    ) -> list[Verdict]:
        """It is ``until_ns`` (``Unconfirmed.silent``)."""
        return self._confirmed(self.unconfirmed.silent(is_reached, until_ns, are_over_by_time))

    def settled(self, other_ends: OtherEnds, stamp_ns: int) -> list[Verdict]:
        """The node reported its end of a call, at ``stamp_ns``."""
        return self._confirmed(self.unconfirmed.settled(other_ends, stamp_ns))

    def told(self, sources: Nodes, skew_ns: int) -> list[Verdict]:
        """Other nodes have reported something, by ``sources``."""
        return self._confirmed(self.unconfirmed.told(sources, self._node, skew_ns))

    def counts_per_channel(self) -> list[Verdict]:
        """The node does not number all that it reports."""
        return self._confirmed(self.unconfirmed.counts_per_channel())

    def _confirmed(self, verdicts: list[Verdict]) -> list[Verdict]:
        """``verdicts`` are certain: nothing can be missing."""
        if verdicts:
            self.violations += len(verdicts)
            self.outcome, self.suspected = Outcome.VIOLATED, None
            self._reason = verdicts[-1].reason
        return verdicts
