"""The oracle of one machine: observations in, verdicts out.

What a node reports is judged as soon as all before it was received, where the node numbers its reports and
they tell all that concerns the machine. Else observations of different channels do not come in the order in
which things happened, so each is kept for one latency bound before it is judged, in its place among the
others. A violation is only reported when nothing that could still come would explain it, and never withdrawn.
"""

from __future__ import annotations

from m2c.model.machine import EventKind
from moon.oracle.bounds import TooManyError
from moon.oracle.judging import Judging
from moon.oracle.program import TooOpenError
from moon.oracle.source_streams import Count
from moon.oracle.state import Hypothesis
from moon.oracle.taken_messages import reference_of
from moon.oracle.trace_events import Role, TraceEvent
from moon.verdict import Outcome, Verdict
from transports.interface import Observation, ObservationKind
from transports.sequences import Sequel

_TAKEN_UP = (EventKind.REQUEST, EventKind.GOAL)
# looked up for every observation
_ASKED, _OUTPUT, _STRANGE, _INPUT = Role.ASKED, Role.OUTPUT, Role.UNDECLARED, Role.INPUT
_ANSWERED = Role.ANSWERED
_TOPIC, _TAKEN, _MESSAGED = Role.MESSAGE, Role.TAKEN, EventKind.MESSAGE
_INCONCLUSIVE = Outcome.INCONCLUSIVE
_MESSAGE = ObservationKind.MESSAGE


class Oracle(Judging):
    """Checks one running machine against its model.

    Args:
        machine: the model.
        library: message types; found beside the model if not given.
        node: the node that runs it; by default called as the machine.
        bounds: what is assumed of the middleware.
        synchronised: whether the first observation comes from a machine that has just started.
        losses: whether observations get lost, known to all oracles of one tap.
        clock: how far time has passed, for all oracles of one monitor.
    """

    def start(self, stamp_ns: int, whole: bool = False) -> None:
        """The machine starts now, in its initial state.

        Args:
            stamp_ns: when, ns since the epoch.
            whole: nothing was missed: its timers run from this very moment, what it sends at once is
                heard, and it hears all that is sent from now on. Otherwise these are uncertain for
                one latency bound.
        """
        self._synchronised = True
        self._heard_since = None
        self._window.clear()
        self._requests.expected.clear()
        self._other_ends.clear()
        self._unconfirmed.restart()
        self._streams.restart()
        self._progress.restart()
        self._takes.restart()
        self._takes.started_ns = stamp_ns
        self._is_ordered = self._may_be_ordered
        self._begin(stamp_ns, whole)
        self._may_be_lost_until = 0 if whole else stamp_ns + self.bounds.latency
        self._finished = max(self._finished, stamp_ns - self.bounds.latency)
        self.outcome, self._reason = Outcome.CONFORMING, ""

    def listen(self, since_ns: int) -> None:
        """All that the machine does from ``since_ns`` on is heard, if it is heard at all.

        For an oracle that is not ``synchronised``: without it, one that finds a machine silent knows
        nothing of it before the first observation, and takes the first thing it does for the end of
        something that began before. With it, the silence before counts as silence.
        Until then none does on a channel on which its node was not heard yet: what it sent may be missing.

        Args:
            since_ns: ns since the epoch; ``FOREVER``: it is not known to be there, and owes nothing.
        """
        self._heard_since = since_ns
        self._wake_at(0)

    def observe(self, observation: Observation) -> Verdict:
        """Take one observation; the verdict as it stands then."""
        verdicts = self.feed(observation)
        return verdicts[-1] if verdicts else self.verdict(observation.stamp_ns)

    def concerns(self, channel: str, source: str, kind: ObservationKind) -> bool:
        """Whether observations like this can mean anything to the machine."""
        return self.channels.concerns(channel, source, kind)

    def feed(self, observation: Observation, sequel: Sequel | None = None) -> list[Verdict]:
        """Take one observation; verdicts that it, and the time that has passed, bring about."""
        key = (observation.source, observation.channel, observation.kind)
        stream = self._streams.opened.get(key) or self._streams.of(observation)
        if stream.other_end and self._progress.heard:
            return []  # its own node numbers all that it reports: this adds nothing
        verdicts: list[Verdict] = []
        count = stream.count
        if count is not None:
            number = observation.sequence
            if number == count.next and not self._unconfirmed.kept:
                count.next, count.stamp = number + 1, observation.stamp_ns
            elif number >= 0 and not self._follows(observation, count, verdicts):
                return verdicts + self.advance(observation.received_ns)
        fact: TraceEvent | None = None
        more: list[TraceEvent] | None = None
        read = stream.read
        try:
            if read is not None:
                fact = read(observation)
                if stream.more:
                    found = (other(observation) for other in stream.more)
                    more = [item for item in found if item is not None]
        except (KeyError, TypeError, ValueError, AttributeError):
            self.late += 1
            text = f"an observation on {observation.channel} cannot be read"
            verdicts += self.lose(observation.stamp_ns, text)
        is_filled = False
        if more:
            more = [each for item in more if (each := self._of_topic(item)) is not None]
        if fact is not None and (fact.role is _TOPIC or fact.role is _TAKEN):
            awaited_ns = self._takes.awaited_ns
            fact = self._of_topic(fact)
            is_filled = self._takes.awaited_ns > awaited_ns
        received_ns = observation.received_ns
        if self._clock.settled > self._finished:
            self._finished = self._clock.settled
        settled = received_ns - self._latency
        progress, order = self._progress, observation.order
        if stream.own and order < 0:
            if observation.kind is not _MESSAGE:
                kind, channel = observation.kind, observation.channel
                self._other_ends.report((kind, channel, observation.client, observation.call))
            if self._unconfirmed.kept and not self._progress.heard:
                verdicts += self._confirm(self._unconfirmed.counts_per_channel())
        if stream.own and order >= 0:
            if order == progress.next and not progress.ahead and progress.answer is None:
                progress.next, progress.heard = order + 1, observation.stamp_ns
            else:
                progress.take(order, observation.stamp_ns, settled)
            if self._unconfirmed.kept:
                verdicts += self._look_at_reports()
            if self._is_ordered:
                settled = self._known(settled, received_ns)
            if (
                fact is not None
                and not more
                and settled < self.wake
                and self._at_once(fact, settled)
            ):
                return verdicts
        if fact is not None:
            self._take(fact, verdicts)
        if more:
            for fact in more:
                self._take(fact, verdicts)
        if is_filled and self._is_ordered:
            settled = self._known(settled, received_ns)
        if settled < self.wake:
            if settled > self._finished:
                self._finished = settled
            return verdicts
        return verdicts + self._settle(settled)

    def reported(self, number: int, stamp_ns: int, now_ns: int) -> list[Verdict]:
        """The node was asked how far it is: what it did not report, it did not do.

        Args:
            number: all that it did until then has a number (``Observation.order``) below this one.
            stamp_ns: until when (ns since the epoch).
            now_ns: on the clock of ``Observation.received_ns``.
        """
        self._progress.answered(number, stamp_ns)
        is_open = any(hypothesis.pending for hypothesis in self._base or ())
        if not self._takes.reported and self.channels.is_plain and not is_open:
            self._follow()  # who answers reports what it takes
        settled = now_ns - self._latency
        if self._is_ordered:
            settled = self._known(settled, now_ns)
        verdicts = self._look_at_reports() if self._unconfirmed.kept else []
        return verdicts + self._settle(settled) if settled >= self.wake else verdicts

    def _known(self, settled: int, received_ns: int) -> int:
        """Until when (ns) all has been heard, by the numbers of the node's reports; at least ``settled``."""
        if settled < self._may_be_lost_until and not self._progress.is_whole:
            return settled
        known = self._progress.heard
        if known >= self._takes.awaited_ns:
            known = self._takes.awaited_ns - 1
        if known <= settled:
            return settled
        return known if known < received_ns else received_ns

    def _of_topic(self, fact: TraceEvent) -> TraceEvent | None:
        """What is left to be judged of ``fact``, if it is about a message of a topic."""
        if fact.role is _TOPIC:
            return self._published(fact)
        if fact.role is _TAKEN:
            return self._taken(fact)
        return fact

    def _published(self, fact: TraceEvent) -> TraceEvent | None:
        """A message on a topic that the machine takes; None where its node reports what it takes."""
        assert fact.event is not None
        if not self.search.program.changes_something(fact.event):
            self.inputs += 1
            if self._listening_since is None:
                self._listen(fact.stamp)
            return None
        if not self._takes.reported or fact.event[0] is not _MESSAGED:
            return fact
        if fact.observation.sequence < 0:  # of such a message it is not reported when it is taken
            self._is_ordered = False
            return fact
        self._note_message(fact)
        return None

    def _note_message(self, message: TraceEvent) -> None:
        self._takes.publish(message, self._base is not None and self._is_to_be_taken(message))
        if self._takes.expected.due < self.wake:
            self._wake_at(self._takes.expected.due)

    def _is_to_be_taken(self, message: TraceEvent) -> bool:
        """Whether the node has to take ``message``: it was there, and whoever published it is known."""
        since = max(self._may_be_lost_until, self._lost_until + 1)
        return message.stamp >= since and self._publishers.is_caller(message.stream[0])

    def _taken(self, fact: TraceEvent) -> TraceEvent | None:
        """The node took a message: an input, whose contents may still have to be received."""
        if not self.search.program.changes_something(fact.event):
            return None
        if not self._takes.reported and not self._begin_to_follow(fact):
            return None
        fact.role = _INPUT
        self._takes.take(fact)
        return fact

    def _begin_to_follow(self, fact: TraceEvent) -> bool:
        """The node's first report of what it takes: whether its reports are what counts from here on.

        They are not, while the message has been judged already by when it was published.
        """
        if not self.channels.is_plain:
            return False
        client, number = fact.call
        channel = fact.observation.channel
        if (client, channel, number) not in map(reference_of, self._messages()):
            count = self._streams.counts.get((client, channel, True))
            if count is not None and number < count.next:
                return False
        self._follow()
        return True

    def _messages(self) -> list[TraceEvent]:
        """Those that are not judged yet, and that the node may still report to have taken."""
        kept = self._resynchronisation.recent if self._base is None else self._window
        return [f for f in kept if _is_numbered_message(f)]

    def _follow(self) -> None:
        """From here on, messages are taken when the node reports that."""
        kept = self._resynchronisation.recent if self._base is None else self._window
        messages = self._messages()
        self._takes.reported = True
        self._is_ordered = not self.search.program.takes_feedback
        for message in messages:
            kept.remove(message)
            self._note_message(message)

    def _at_once(self, fact: TraceEvent, settled: int) -> bool:
        """Whether ``fact``, the next thing that happened, is judged here and now.

        A short cut for what ``_take`` and ``_settle`` do where nothing waits to be judged, nothing is due
        by ``settled`` (ns), and the machine can have done one thing only.
        """
        base, stamp = self._base, fact.stamp
        if base is None or len(base) != 1 or self._window or not self._finished < stamp <= settled:
            return False
        if self.outcome is _INCONCLUSIVE:
            return False
        only = self.search.deterministic_successor(base[0], fact)
        if only is None:
            return False
        if fact.role is _OUTPUT:
            self.outputs += 1
        else:
            self.inputs += 1
            if fact.event is not None and fact.event[0] in _TAKEN_UP:
                self._requests.take(fact, self._finished)
        self.search.last = stamp
        self._base = [only]
        self._history.append(fact)
        self._finished = settled
        due = self._next_due = self.search.next_due(only)
        self._wake_at(due if due < self._requests.expected.due else self._requests.expected.due)
        return True

    def advance(self, now_ns: int) -> list[Verdict]:
        """Time has passed: what can no longer change is settled, what is overdue is said.

        Args:
            now_ns: on the clock of ``Observation.received_ns``.
        """
        settled = now_ns - self._latency
        if settled < self.wake:
            if settled > self._finished:
                self._finished = settled
            return []
        return self._settle(settled)

    @property
    def hypotheses(self) -> list[Hypothesis]:
        """What the machine may be doing, by all that was heard until now."""
        base = self._base or []
        if not base or not self._window:
            return base
        last = self.search.last
        try:
            for fact in self._window:
                after = self.search.after(base, fact)
                if not after:
                    break  # late observations may still explain it
                base = after
        except (TooManyError, TooOpenError):
            return self._base or []
        finally:
            self.search.last = last
        return base

    def states(self) -> list[str]:
        """Names of the states in which the machine may be."""
        program = self.search.program.parts[0]
        found = {program.states[h.instances[0][0]].name for h in self.hypotheses}
        return sorted(found)

    # --- taking facts -----------------------------------------------------------------------------

    def _follows(self, observation: Observation, count: Count, verdicts: list[Verdict]) -> bool:
        """Whether this is new; what its number tells of losses goes to ``verdicts``."""
        stamp, number = observation.stamp_ns, observation.sequence
        sequel = count.sequel(number, stamp)
        if sequel is Sequel.AGAIN:
            self.repeated += 1
            return False
        if self._unconfirmed.kept:
            verdicts += self._confirm(self._unconfirmed.hear(count.place, number, stamp))
        match sequel:
            case Sequel.FIRST if number > 0 and self._is_expected(observation):
                # a number above 0 comes first where a tap joins later, or where the first was lost
                text = f"what came first on {observation.channel} was not received"
                verdicts += self.lose(stamp, text)
            case Sequel.AFTER_A_GAP if self._takes.reported and observation.source != self.node:
                self.losses.happen = True  # what is missing matters when it has been taken
            case Sequel.AFTER_A_GAP:
                self.losses.happen = True
                text = f"observations on {observation.channel} from {observation.source} were lost"
                verdicts += self.lose(stamp, text)
            case Sequel.ANEW if observation.source == self.node:
                self._progress.restart()
                self._other_ends.clear()
                self._unconfirmed.restart()
                self._takes.restart()
                self._is_ordered = self._may_be_ordered
                verdicts += self.lose(stamp, f"{self.node} was restarted")
        return True

    def _is_expected(self, observation: Observation) -> bool:
        """Whether its channel's first observation should have been heard by now."""
        if self._takes.reported and observation.source != self.node:
            return False
        if self.losses.happen:
            return self._base is not None
        return self._from_start and observation.source == self.node

    def _take(self, fact: TraceEvent, verdicts: list[Verdict]) -> None:
        role, stamp = fact.role, fact.stamp
        if role is _ASKED:
            source = fact.observation.source
            is_known = source == fact.call[0] and self._publishers.is_caller(source)
            if is_known and stamp > self._lost_until and stamp > (self._heard_since or 0):
                self._requests.ask(fact)
                self._wake_at(min(self.wake, self._requests.expected.due))
            return
        if role is _ANSWERED:  # that it was taken up was not heard, or not yet
            self._requests.take(fact, self._finished)
            self._imply(fact, ObservationKind.REQUEST_RECEIVED)
            self._imply(fact, ObservationKind.RESPONSE_SENT)
            return
        if role is Role.OTHER_END:
            self._imply(fact, ObservationKind.REQUEST_SENT)
            if fact.observation.kind is ObservationKind.RESPONSE_SENT:
                self._imply(fact, ObservationKind.RESPONSE_RECEIVED)
            return
        if role is Role.UNANSWERED:
            verdicts += self._confirm(self._unconfirmed.gave_up(fact.call, stamp))
            return
        if role is _OUTPUT or role is _STRANGE:
            self.outputs += 1
        elif role is _INPUT:
            self.inputs += 1
            if fact.event is not None and fact.event[0] in _TAKEN_UP:
                self._requests.take(fact, self._finished)
        elif role is Role.MESSAGE:
            self.inputs += 1
        if self._listening_since is None:
            self._listen(stamp)
        if self._base is None:
            self._resynchronisation.remember(fact, self._finished)
        elif stamp <= self._finished:
            self.late += 1
            text = f"an observation on {fact.observation.channel} came too late"
            verdicts += self.lose(stamp, text)
        else:
            fact.may_be_lost = stamp < self._may_be_lost_until
            self._keep(fact)

    def _imply(self, fact: TraceEvent, kind: ObservationKind) -> None:
        """By the other end of a call, the node did this."""
        if not self._progress.heard:
            event = (kind, fact.observation.channel, *fact.call)
            self._other_ends.imply(event, fact.stamp)

    def _listen(self, stamp: int) -> None:
        """The first fact is from ``stamp``."""
        if self._synchronised:
            self._begin(stamp)
            return
        since = stamp if self._heard_since is None else min(stamp, self._heard_since)
        self._listening_since = since
        self._wake_at(0)
        self._resynchronisation.begin(since)
        self.outcome = Outcome.INCONCLUSIVE
        self._reason = "started in the middle of a run: waiting until its state is certain"


def _is_numbered_message(fact: TraceEvent) -> bool:
    """Whether its node may report that it took ``fact``."""
    is_message = fact.event is not None and fact.event[0] is _MESSAGED
    return fact.role is _TOPIC and is_message and fact.observation.sequence >= 0
