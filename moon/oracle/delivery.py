"""Delivery to the judge of one machine, in order, of what is received late.

Up to the *watermark* all that happened was received, or is known to be missing (``moon.feed``); what
happened later is held. What has nothing older before it any more goes to the judge. Whether the machine's
node got what others sent to it is shown by what is received, in whatever order: so that is waited for here,
and the judge is handed what never arrived. ``Topics`` decides whether a message is handed over as of when it
was published, or as of when its node took it.
"""

from __future__ import annotations

from collections.abc import Iterator

from moon.feed.held import Held
from moon.judge import Gap
from moon.oracle.bounds import FOREVER, LINKED_NS, Bounds
from moon.oracle.channels import Channels
from moon.oracle.confirmation import Conclusion, Publishers, Tracked
from moon.oracle.evidence import Shown, evidence_of
from moon.oracle.in_transit import Expected, Reference, TakenMessages, reference_of
from moon.oracle.model_oracle import TRIES, ModelOracle
from moon.oracle.program import Program
from moon.oracle.state import Hypothesis
from moon.oracle.trace_events import Role, TraceEvent
from moon.verdict import MIDDLE, Verdict


class Clock:
    """How far time has passed for all oracles of one monitor: those for which it changes nothing do nothing.

    Attributes:
        watermark: all that happened until then (ns) was received, or does not come any more.
        wake: until the watermark is there (ns), time alone changes nothing for any of them; or earlier.
    """

    __slots__ = ("wake", "watermark")

    def __init__(self) -> None:
        self.watermark = 0
        self.wake = 0


class Delivery:
    """Hands what is received of one machine to its judge, in order.

    Args:
        judge: of the machine.
        conclusion: what is concluded of it.
        held: what is received and not handed over yet.
        tracked: what was received, and what others sent to the machine.
        clock: how far time has passed, for all oracles of one monitor.
        bounds: what is received later than its latency bound after its stamp is late.
        synchronised: whether what is received first comes from a machine that has just started.

    Attributes:
        watermark: all that happened until then was handed over (ns).
        wake: until the watermark is there (ns), time alone changes nothing.
        inputs: how many the machine's node was received to have, or were sent to it.
        late: how many observations came after their time.
    """

    def __init__(
        self,
        judge: ModelOracle,
        conclusion: Conclusion,
        held: Held[TraceEvent],
        tracked: Tracked,
        clock: Clock,
        bounds: Bounds,
        synchronised: bool,
    ) -> None:
        self.watermark = 0
        self.wake = 0
        self.inputs = 0
        self.late = 0
        self._judge = judge
        self._conclusion = conclusion
        self._unconfirmed = conclusion.unconfirmed
        self._held = held
        self._streams = tracked.streams
        self._progress = tracked.progress
        self._tracking = tracked.requests
        self._requests = tracked.requests.expected
        self._takes = tracked.takes
        self._taken = tracked.takes.expected
        self._clock = clock
        self._latency, self._skew = bounds.latency, bounds.skew
        self._reachability = tracked.reachability
        self.unreached: set[str] = set()
        """Nodes that have to be asked whether they are there."""
        self._under_way: dict[Reference, TraceEvent] = {}
        """What is overdue and may be under way through a network that is cut."""
        self._synchronised = synchronised
        self._is_listening = False
        """Whether the judge knows that there is something to listen to."""
        self._linked_ns = 0
        """What is sent from then on (ns) reaches the machine, which started before."""
        self._lost_until = 0
        """What was sent to the machine by then (ns) may be lost: the machine may still wait for it."""
        self._dropped_ns = 0
        """When the newest happened that was received and not handed over (ns)."""
        self._gap_ns = 0
        """Before that (ns) something happened that the machine's node reported and that was lost."""

    # --- beginnings, and what is missing -------------------------------------------------------------

    def start(self, stamp_ns: int, whole: bool, earliest_ns: int = FOREVER) -> None:
        """The machine starts; see ``Oracle.start``."""
        self._synchronised = True
        # what others published may be received before it is known that the node is there, which takes it
        messages = [event for event in self._held.observations if event.role is Role.MESSAGE]
        self._held.clear()
        for event in messages:
            if not whole or event.stamp >= stamp_ns:
                self._held.add(event)
        self._requests.clear()
        self._linked_ns = 0 if whole else stamp_ns + self._latency
        self._begin(stamp_ns, whole, earliest_ns)
        self.watermark = max(self.watermark, stamp_ns - self._latency)

    def _begin(self, stamp_ns: int, whole: bool = False, earliest_ns: int = FOREVER) -> None:
        self._is_listening = True
        self._judge.start(stamp_ns, whole, self._linked_ns, earliest_ns)
        self._look_at_judge()
        self.wake_at(0)

    def linked(self, since: int) -> None:
        """From ``since`` (ns) on, what is sent to a started machine reaches it; see ``Oracle.listen``."""
        if self._judge.since_start and since != FOREVER:
            self._judge.linked(since)
        self.wake_at(0)

    def found(self) -> None:
        """The machine's node is there from now on: what was sent before may not have reached it."""
        if self._is_listening and self._judge.hypotheses is None:
            self._judge.listen(max(self.watermark, self._clock.watermark))
            self.wake_at(0)

    def listen(self, stamp: int) -> None:
        """Something is received that happened at ``stamp`` (ns); nothing changes if it is not the first."""
        if self._is_listening:
            return
        if self._synchronised:
            self._begin(stamp)
            return
        since = self._streams.received_since
        since = stamp if since is None else min(stamp, since)
        self._is_listening = True
        self.wake_at(0)
        self._judge.listen(since)
        self._conclusion.unknown(since, MIDDLE, is_news=True)

    def note_passed(self) -> None:
        """A request was received: perhaps one that is overdue was sent before it."""
        if self._tracking.passed:
            self.wake_at(0)

    def lose(self, stamp: int, text: str) -> list[Verdict]:
        """Something is missing since ``stamp`` (ns); ``text``: what, for people."""
        newest = self._drop(stamp)
        return list(self._judge.gap(Gap("", "", stamp, newest + 1, text)))

    def _drop(self, stamp: int) -> int:
        """What the machine does is not known from ``stamp`` on: what waits to be judged, or to arrive, goes.

        Returns:
            When the newest of all that is known to be missing now happened (ns).
        """
        # by their stamps: the clock of reception is the judges', which may be behind
        newest = max((event.stamp for event in self._held.observations), default=0)
        self._dropped_ns = max(self._dropped_ns, newest)
        self._held.clear()
        self._requests.clear()
        self._tracking.passed.clear()
        self._takes.forget()
        self._lost_until = stamp + self._latency + self._skew
        self._synchronised = False
        self._is_listening = True
        self.wake_at(0)
        return max(stamp, self._dropped_ns)

    def _look_at_judge(self) -> None:
        """Where it has given up, it listens anew, from when on it will be handed all there is."""
        stamp = self._judge.gave_up_ns
        if stamp is not None:
            self._judge.listen(self._drop(stamp))

    # --- what is received ----------------------------------------------------------------------------

    @property
    def asked_since(self) -> int:
        """A request that was sent after that (ns) reaches the machine, if its node is there."""
        return max(self._lost_until, self._streams.received_since or 0)

    @property
    def taken_since(self) -> int:
        """A message that is published from then on (ns) is taken by the machine's node: it was there."""
        if self._judge.hypotheses is None:
            return FOREVER
        return max(self._linked_ns, self._lost_until + 1)

    def add(self, event: TraceEvent) -> list[Verdict]:
        """The machine took or did something."""
        self.listen(event.stamp)
        is_known = self._judge.hypotheses is not None
        if event.stamp_ns > self.watermark:
            self._held.add(event)
            if is_known:
                self.wake_by(event.stamp_ns)
            else:  # it is to remember what there was, whenever it looks for a moment to begin at
                self._hand_over(self.watermark)
        elif is_known:
            self.late += 1
            text = f"an observation on {event.observation.channel} came too late"
            return self.lose(event.stamp, text)
        else:
            self._judge.observe(event)
        return []

    def known(self, until: int, received_ns: int) -> int:
        """Until when (ns) all was received, by the numbers of the node's reports; at least ``until``."""
        if until < self._linked_ns and not self._progress.is_whole:
            return until
        known = self._progress.reported_ns
        if known >= self._takes.awaited_ns:
            known = self._takes.awaited_ns - 1
        if known <= until:
            return until
        return known if known < received_ns else received_ns

    def pass_until(self, until: int) -> list[Verdict]:
        """All that happened until ``until`` (ns) was received, or does not come any more."""
        if until < self.wake:
            if until > self.watermark:
                self.watermark = until
            return []
        return self.advance(until)

    def wake_at(self, due: int) -> None:
        """Time alone changes something once the watermark is at ``due`` (ns)."""
        self.wake = due
        if due < self._clock.wake:
            self._clock.wake = due

    def wake_by(self, due: int) -> None:
        """The same, if it was not before that."""
        if due < self.wake:
            self.wake_at(due)

    @property
    def judged_until(self) -> int:
        """What happened by then (ns) has been judged."""
        until = max(self.watermark, self._clock.watermark)
        first = self._held.stamps[0] if self._held.stamps else FOREVER
        return first - 1 if first <= until and self._judge.hypotheses is not None else until

    def foreseen(self) -> list[Hypothesis]:
        """What the machine may be doing, by all that was received, in order or not."""
        return self._judge.foreseen(self._held.observations)

    # --- handing over --------------------------------------------------------------------------------

    def at_once(self, event: TraceEvent, until: int, verdicts: list[Verdict]) -> bool:
        """Whether ``event`` is the next thing that happened, and was handed over here and now.

        A short cut for what ``add`` and ``pass_until`` do where nothing waits to be handed over, and nothing
        is due by ``until`` (ns), as for most observations of nodes that number their reports.
        """
        judge, stamp = self._judge, event.stamp
        if judge.hypotheses is None or self._held.stamps or not self.watermark < stamp <= until:
            return False
        progress = self._progress
        if progress.ahead or progress.answer is not None or self._unconfirmed.kept:
            return False
        found = judge.observe(event)
        due = judge.due_ns
        if due > until:
            self.watermark = until
            if self._requests.due < due:
                due = self._requests.due
            if self._taken.due < due:
                due = self._taken.due
            self.wake_at(due)
            return True
        verdicts += found
        self._look_at_judge()
        self.wake_by(stamp)
        verdicts += self.advance(until)
        return True

    def advance(self, until: int) -> list[Verdict]:
        """All that happened until ``until`` (ns) was received, or is known to be missing."""
        if until <= self.watermark:
            return []
        if until < self.wake:
            self.watermark = until
            return []
        verdicts: list[Verdict] = []
        judge, progress = self._judge, self._progress
        if self._takes.awaited_ns <= until:
            text = "the contents of a message that it took were not received"
            verdicts += self.lose(until, text)
        if progress.ahead or progress.answer is not None:
            progress.advance(until)
        if self._unconfirmed.kept:
            verdicts += self._conclusion.reported(progress.reported_ns, progress.gap)
        if progress.gap != self._gap_ns:
            verdicts += self._reports_lost()
        if self._held.stamps:
            verdicts += self._hand_over(until)
        self.watermark = until
        if judge.hypotheses is not None and judge.due_ns <= until:
            verdicts += judge.advance(until)
            self._look_at_judge()
        if self._requests.due <= until or self._tracking.passed:
            verdicts += self._not_received(until)
        if self._taken.due <= until:
            verdicts += self._not_taken(until)
        if self._is_to_be_found and judge.due_ns <= until:
            verdicts += judge.advance(until)
            self._look_at_judge()
        self.wake_at(self._next_time())
        return verdicts

    def _reports_lost(self) -> list[Verdict]:
        """Something that the machine's node reported was not received, by its numbers or its answer.

        Of a node that was there before, what it reported before anything was received of it tells nothing.
        """
        self._gap_ns = gap_ns = self._progress.gap
        holes = self._progress.holes
        is_known = bool(holes) and (holes[-1][0] > 0 or self._judge.since_start)
        text = f"observations of {self._streams.node} were lost"
        return self.lose(gap_ns, text) if is_known else []

    def _hand_over(self, until: int) -> list[Verdict]:
        """What can have nothing before it any more is judged, in order."""
        verdicts: list[Verdict] = []
        judge, held = self._judge, self._held
        count = held.count(until)
        for event in held.observations[:count]:
            # what comes late all at once says no less than what comes one after the other
            if judge.hypotheses is not None and judge.due_ns < event.stamp_ns:
                verdicts += judge.advance(event.stamp_ns - 1)
            verdicts += judge.observe(event)
            if judge.gave_up_ns is not None:
                self._look_at_judge()
                return verdicts
        held.take(count)
        return verdicts

    @property
    def _is_to_be_found(self) -> bool:
        """Whether it is not known what the machine does, and something of it was received."""
        if self._judge.hypotheses is not None or not self._is_listening:
            return False
        return self._streams.received_since != FOREVER

    def _next_time(self) -> int:
        """Until this time (ns) nothing is to be handed over, due or to be found."""
        if self._judge.hypotheses is None:
            return self._judge.due_ns if self._is_to_be_found else FOREVER
        due = self.due_ns
        if self._held.stamps and self._held.stamps[0] < due:
            due = self._held.stamps[0]
        answer = self._progress.answer
        return due if answer is None else min(due, answer[1])

    @property
    def due_ns(self) -> int:
        """When something is decided if nothing more happens: by the judge, or of what others sent (ns)."""
        return min(self._judge.due_ns, self._requests.due, self._taken.due)

    def _overdue(
        self, expected: Expected, until: int, verdicts: list[Verdict]
    ) -> Iterator[TraceEvent]:
        """What should have arrived by ``until`` (ns) and is not under way any more."""
        for reference, event, since_ns in expected.overdue(until):
            sender = event.observation.source
            if self._reachability is None:
                yield event
                continue
            if since_ns < until - LINKED_NS:
                continue  # it cannot be known whose fault it was
            nodes = (sender, self._streams.node)
            if self._has_arrived(since_ns, expected.deadline, nodes, until):
                self._under_way.pop(reference, None)
                yield event
                continue
            late_ns = until - since_ns - expected.deadline
            wait = min(max(late_ns, self._latency // TRIES), self._latency)
            expected.wait_on(reference, event, since_ns, until + wait)
            self.unreached.update(nodes)
            if reference not in self._under_way:
                self._under_way[reference] = event
                text = (
                    f"what {sender} sent may be under way: the network between it and "
                    f"{self._streams.node} may be cut"
                )
                verdicts += self._conclusion.unknown(event.stamp, text)

    def _has_arrived(
        self, since_ns: int, deadline: int, nodes: tuple[str, str], until: int
    ) -> bool:
        """Whether no network can be the reason that what is under way since then has not come by ``until``.

        Both ends were heard in time after that, and for as long again as they were not; and once more
        when it was overdue: it may have been slow, and held up then.
        """
        reachability = self._reachability
        if reachability is None:
            return True
        reached = reachability.reached_ns(nodes, since_ns + self._latency)
        if reached is None or until < 2 * reached - since_ns:
            return False
        return reachability.reached_ns(nodes, since_ns + deadline) is not None

    def take_findings(self, until: int) -> list[str]:
        """What was under way for too long and has come, or is given up, one sentence each."""
        found = []
        for event in self._takes.lost:
            source, channel = event.stream
            found.append(
                f"the link between {source} and {self._streams.node} lost message "
                f"{event.observation.sequence} on {channel}, or was slow"
            )
        self._takes.lost.clear()
        for reference in [p for p in self._under_way if not self._is_expected(p)]:
            event = self._under_way.pop(reference)
            seconds = (until - event.stamp) / 1e9
            found.append(
                f"the link between {event.observation.source} and {self._streams.node} was down or slow for "
                f"up to {seconds:.1f} s: {event.observation.channel} did not come through"
            )
        return found

    def _is_expected(self, reference: Reference) -> bool:
        return reference in self._requests.events or reference in self._taken.events

    def _not_received(self, until: int) -> list[Verdict]:
        """Requests that others sent and the machine's node never received."""
        verdicts: list[Verdict] = []
        passed, self._tracking.passed = self._tracking.passed, []
        for event in passed:
            self._under_way.pop((event.observation.channel, event.call), None)
        for event in (*passed, *self._overdue(self._requests, until, verdicts)):
            # else perhaps its end is not instrumented
            if self.inputs or self._judge.since_start or self._progress.reported_ns:
                expected = f"request {event.call[1]} of {event.call[0]} to be received"
                why = "the request was not taken up"
                verdicts += self._judge.never_arrived(event, expected, why, until)
        return verdicts

    def _not_taken(self, until: int) -> list[Verdict]:
        """Messages on the machine's topics that its node, which reports what it takes, never took."""
        verdicts: list[Verdict] = []
        for event in self._overdue(self._taken, until, verdicts):
            if not self._takes.is_missed(event):
                continue
            source, channel = event.stream
            expected = f"message {event.observation.sequence} of {source} on {channel} to be taken"
            why = "the message was not taken"
            verdicts += self._judge.never_arrived(event, expected, why, until)
        return verdicts


# --- messages of topics ---------------------------------------------------------------------------

_MESSAGE, _TAKEN, _INPUT = Role.MESSAGE, Role.TAKEN, Role.INPUT


class Topics:
    """What is received of the messages on the topics of one machine.

    Args:
        program: the machine.
        channels: its channels.
        publishers: whose word is taken for it that they published.
        takes: the messages, where the node reports which of them it takes.
        held: what is not judged yet.
        latency: a node that does not say what it takes is presumed to take it so soon (ns).
        presumes_links: whether publishers are linked to the node from the beginning: nobody says when each
            of them came.

    Attributes:
        is_ordered: all that the machine takes and sends is reported by its own node, in order: it is known
            how far that is.
    """

    def __init__(
        self,
        program: Program,
        channels: Channels,
        publishers: Publishers,
        takes: TakenMessages,
        held: Held[TraceEvent],
        latency: int,
        presumes_links: bool,
    ) -> None:
        self._latency = latency
        self._presumes_links = presumes_links
        self._program = program
        self._channels = channels
        self._publishers = publishers
        self._takes = takes
        self._held = held
        taken = program.taken_topics().values()
        self._takes_none = not taken
        self._is_reported_whole = all(evidence_of(kind, True) is Shown.BY_NODE for kind in taken)
        """Whether a node that reports what it takes reports all that its machine takes."""
        self.is_ordered = self._takes_none

    def restart(self) -> None:
        """Another life of the node begins."""
        self._takes.restart()
        self.is_ordered = self._takes_none

    def receive(self, event: TraceEvent, since_ns: int) -> TraceEvent | None:
        """What is left to be judged of ``event``, which is about a message of a topic.

        Args:
            event: a message that was published and makes a difference to the machine, or was taken.
            since_ns: what is published from then on is to be taken, where its publisher is known.
        """
        if event.role is _TAKEN:
            return self._taken(event, since_ns)
        reported = self._takes.reported
        if not reported or event.event is None:
            event.is_linked = self._takes.is_linked(event) or self._presumes_links
            if not reported:
                self._takes.presumed[reference_of(event)] = event.stamp
            return event
        match evidence_of(event.event[0], reported, event.observation.sequence >= 0):
            case Shown.BY_NODE:
                self._publish(event, since_ns)
                return None
            case (
                Shown.BY_NOBODY
            ):  # it may have been taken before or after anything that is reported
                self.is_ordered = False
        return event

    def follow(self, since_ns: int) -> None:
        """The node can report what it takes: from here on, messages are taken when it does."""
        if not self._takes.reported and self._channels.is_plain:
            self._follow(since_ns)

    def _publish(self, message: TraceEvent, since_ns: int) -> None:
        is_known = self._publishers.is_caller(message.stream[0])
        self._takes.publish(message, message.stamp >= since_ns and is_known)

    def _taken(self, event: TraceEvent, since_ns: int) -> TraceEvent | None:
        """The node took a message: an input, whose contents may still have to be received."""
        if not self._program.changes_something(event.event):
            return None
        if not self._takes.reported and not self._begin_to_follow(event, since_ns):
            return None
        event.role = _INPUT
        self._takes.take(event)
        return event

    def _begin_to_follow(self, event: TraceEvent, since_ns: int) -> bool:
        """The node's first report of what it takes: whether its reports are what counts from here on.

        They are not, while the message has been judged already as taken within the latency bound, and was. If
        it was taken later, what was judged is not what happened: the machine takes something unknown.
        """
        if not self._channels.is_plain:
            return False
        reference = (event.observation.channel, event.call)
        is_to_come = reference in map(reference_of, self._messages())
        if not is_to_come and not self._takes.has_contents(reference):
            published_ns = self._takes.presumed.get(reference)
            if published_ns is not None and event.stamp <= published_ns + self._latency:
                return False
        self._follow(since_ns)
        return True

    def _messages(self) -> list[TraceEvent]:
        """Those that are not judged yet, and that the node may still report to have taken."""
        return [event for event in self._held.observations if _may_be_reported(event)]

    def _follow(self, since_ns: int) -> None:
        messages = self._messages()
        self._takes.reported = True
        self._takes.presumed.clear()
        self.is_ordered = self._is_reported_whole
        for message in messages:
            self._held.remove(message)
            self._publish(message, since_ns)


def _may_be_reported(event: TraceEvent) -> bool:
    """Whether its node may report that it took ``event``."""
    if event.role is not _MESSAGE or event.event is None:
        return False
    shown = evidence_of(event.event[0], True, event.observation.sequence >= 0)
    return shown is Shown.BY_NODE
