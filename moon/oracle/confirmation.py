"""What has to be heard before a violation of one machine is certain (decision 26)."""

from __future__ import annotations

from m2c.model.machine import OutputKind
from moon.oracle.search import Search
from moon.oracle.source_streams import Count, Place, SourceStreams
from moon.oracle.state import Hypothesis
from moon.oracle.taken_messages import TakenMessages
from moon.oracle.unconfirmed import NOT_NEEDED, Losses, OtherEnds, Publishers, Waiting
from moon.ordering.progress import Progress
from moon.verdict import Verdict

_PARTS = {
    OutputKind.ACCEPT_GOAL: ("/_action/send_goal", False),
    OutputKind.REJECT_GOAL: ("/_action/send_goal", False),
    OutputKind.SEND_GOAL: ("/_action/send_goal", False),
    OutputKind.SEND_CANCEL: ("/_action/cancel_goal", False),
    OutputKind.FEEDBACK: ("/_action/feedback", True),
    OutputKind.SUCCEED: ("/_action/status", True),
    OutputKind.ABORT: ("/_action/status", True),
    OutputKind.CANCEL: ("/_action/status", True),
}
"""The part of an action by which an output leaves, and whether that is a topic."""


class Confirmation:
    """Says what would show that nothing is missing which explains a violation.

    Args:
        node: the node that runs the machine.
        search: the machine's.
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
        search: Search,
        streams: SourceStreams,
        progress: Progress,
        other_ends: OtherEnds,
        publishers: Publishers,
        losses: Losses,
        takes: TakenMessages,
    ) -> None:
        self._node = node
        self._search = search
        self._skew = search.bounds.skew
        self._taken_topics = search.program.taken_topics()
        self._streams = streams
        self._progress = progress
        self._other_ends = other_ends
        self._publishers = publishers
        self._losses = losses
        self._takes = takes

    def needed(
        self, verdict: Verdict, after: int, since: int, is_silence: bool, expected: list[Place]
    ) -> Waiting | None:
        """What has to be heard before ``verdict`` is certain; None if something was lost already.

        Args:
            verdict: the violation.
            after: all that happened until then (ns) may explain it.
            since: since when it is known what the machine does (ns).
            is_silence: whether it is that something did not come. Then only what comes later shows that.
            expected: where what was expected would have come.
        """
        if not self._losses.possible:
            return Waiting(verdict)
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
        return Waiting(verdict, places, reported, since) if known else None

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

    def places_of(self, base: list[Hypothesis]) -> list[Place]:
        """Where what ``base`` owes would come."""
        channel_of = self._search.program.channel_of_output
        found: dict[Place, None] = {}
        for item in (h.owed[0] for h in base if h.owed):
            part, is_message = _PARTS.get(item.kind, ("", item.kind is OutputKind.PUBLISH))
            found[self._node, channel_of(item.kind, item.interface) + part, is_message] = None
        return list(found)

    def may_be_shown_by_its_client(self, needed: Waiting, base: list[Hypothesis]) -> None:
        """Where nothing but the answer to one request is owed, its client's waiting in vain shows that."""
        owed = [h.owed[0] for h in base if h.owed]
        calls = {item.call for item in owed if item.kind is OutputKind.RESPONSE}
        if len(owed) != len(base) or len(calls) != 1 or None in calls:
            return
        if needed.reported_ns != NOT_NEEDED and self._progress.heard < min(o.low for o in owed):
            return  # what came before the request may be missing
        needed.call = calls.pop()
        needed.answer = next(iter(self.places_of(base)))
