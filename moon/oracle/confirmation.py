"""What has to be heard before a violation of one machine is certain (decision 26)."""

from __future__ import annotations

from collections.abc import Collection

from moon.oracle.bounds import Bounds
from moon.oracle.in_transit import TakenMessages
from moon.oracle.trace_events import SourceStreams
from moon.oracle.unconfirmed import (
    NOT_NEEDED,
    Losses,
    OtherEnds,
    Publishers,
    Violation,
    Waiting,
)
from moon.ordering.numbers import Count, Place
from moon.ordering.progress import Progress


class Confirmation:
    """Says what would show that nothing is missing which explains a violation.

    Args:
        node: the node that runs the machine.
        bounds: what is assumed of the middleware.
        taken_topics: the channels of the topics that can make a difference to the machine.
        streams: what was heard, and its numbers.
        progress: of all that the node reports, where it numbers that.
        other_ends: what others report of the node's calls.
        publishers: who may publish without having been heard.
        losses: what is known of the tap.
        takes: whether the node reports which messages it takes; then those of others tell nothing more.
    """

    def __init__(
        self,
        node: str,
        bounds: Bounds,
        taken_topics: Collection[str],
        streams: SourceStreams,
        progress: Progress,
        other_ends: OtherEnds,
        publishers: Publishers,
        losses: Losses,
        takes: TakenMessages,
    ) -> None:
        self._node = node
        self._skew = bounds.skew
        self._unheard_ns = bounds.deadline + bounds.latency
        self._taken_topics = taken_topics
        self._streams = streams
        self._progress = progress
        self._other_ends = other_ends
        self._publishers = publishers
        self._losses = losses
        self._takes = takes

    def needed(self, violation: Violation) -> Waiting | None:
        """What has to be heard before ``violation`` is certain; None if something was lost already."""
        verdict = violation.verdict
        if violation.is_certain or not self._losses.possible:
            return Waiting(verdict)
        after, since = violation.until_ns, violation.since_ns
        is_silence, expected = violation.is_silence, violation.expected
        places: dict[Place, int] = {}
        known = self._takes.reported or self._wait_for_others(places, after, since)
        counted = self._progress.heard
        if counted:  # its node numbers all that it reports
            known = known and self._progress.gap <= since
            # what comes with the very stamp may be what did not come
            reported = NOT_NEEDED if counted >= after else after + is_silence
        else:
            reported = NOT_NEEDED
            known = known and not self._other_ends.are_missing(since, after + self._skew)
            own = [c for c in self._streams.counts.values() if c.place[0] == self._node]
            if not own:  # it was never heard, nor how it numbers
                reported = after + 1
            if not own or any(count.next >= 0 for count in own):
                heard = {count.place for count in own}
                places.update((p, 0) for p in expected if p[2] and p not in heard)
            for count in own:
                wanted = count.place[2] or self._losses.happen
                if wanted or (is_silence and count.place in expected):
                    known = self._wait_for(places, count, after, since) and known
        if not known:
            return None
        waiting = Waiting(verdict, places, reported, since)
        # what came before the request may be missing
        if reported == NOT_NEEDED or self._progress.heard >= violation.asked_ns:
            waiting.call = violation.call
            waiting.answer = expected[0] if violation.call is not None else None
        return waiting

    def may_be_unheard(self, expected: list[Place], by_ns: int) -> bool:
        """Whether what is ``expected`` may have been sent by ``by_ns``, and its channel is not heard yet."""
        channels = [channel.partition("/_action/")[0] for _, channel, _ in expected]
        return self._streams.may_be_unheard(channels, by_ns - self._unheard_ns)

    def _wait_for_others(self, places: dict[Place, int], after: int, since: int) -> bool:
        """Add the topics of others that it takes; False: some of what they sent is not known."""
        counts = self._streams.counts
        known = True
        for count in counts.values():
            source, channel, is_message = count.place
            if source != self._node and is_message and channel in self._taken_topics:
                known = self._wait_for(places, count, after, since) and known
        for channel in self._taken_topics:
            for source in self._publishers.on(channel):
                place = (source, channel, True)
                if source != self._node and place not in counts:
                    places[place] = 0
        return known

    def _wait_for(self, places: dict[Place, int], count: Count, after: int, since: int) -> bool:
        """Add the next number of one place; False: some of what came there is not known.

        What is not numbered (a bag's, a stranger's) is taken for whole.
        """
        if count.next < 0:
            return True
        if count.unknown_until > since:
            return False
        if count.stamp <= after + self._skew:
            places[count.place] = count.next
        return True
