"""The oracle of one machine: observations in, verdicts out.

It receives what is observed of the machine: late, twice, or not at all. It drops what came twice, finds what
is missing by the numbers, and says how far all was received: up to the node's last report, where it numbers
its reports and they are of all that concerns the machine; else up to one latency bound ago. In order it goes
to the judge (``delivery``, ``model_oracle``); what that finds is certain when nothing missing can be the
reason (``confirmation``).
"""

from __future__ import annotations

from pathlib import Path

from m2c.diagnostics import DiagnosticLog
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import EventKind, Machine
from m2c.model.system import library_for
from m2c.model.walk import has_timers
from moon.feed.held import Held
from moon.feed.lives import ANOTHER, PAST, Lives
from moon.feed.nodes import Nodes
from moon.feed.progress import Progress
from moon.oracle.bounds import FOREVER, Bounds
from moon.oracle.channels import AmbiguousError, Channels
from moon.oracle.confirmation import Conclusion, Confirmation, OtherEnds, Tracked
from moon.oracle.delivery import Delivery, Topics
from moon.oracle.evidence import Shown, evidence_of
from moon.oracle.in_transit import Links, RequestTracking, TakenMessages
from moon.oracle.model_oracle import ModelOracle
from moon.oracle.program import Program
from moon.oracle.search import Search
from moon.oracle.shared import Shared
from moon.oracle.source_streams import SourceStream, SourceStreams
from moon.oracle.state import Hypothesis
from moon.oracle.trace_events import Role, TraceEvent
from moon.verdict import Outcome, Verdict
from transports.interface import Observation, ObservationKind
from transports.sequences import Sequel

_TAKEN_UP = (EventKind.REQUEST, EventKind.GOAL)
# looked up for every observation
_OUTPUT, _INPUT, _TOPIC, _TAKEN = Role.OUTPUT, Role.INPUT, Role.MESSAGE, Role.TAKEN
_MESSAGE = ObservationKind.MESSAGE
_NEXT = Sequel.NEXT


class Oracle:
    """Checks one running machine against its model.

    Args:
        machine: the model.
        library: message types; found beside the model if not given.
        node: the node that runs it; by default called as the machine.
        bounds: what is assumed of the middleware.
        synchronised: whether the first observation comes from a machine that has just started.
        shared: with the other oracles of its monitor; None: it is alone.
        program: the machine, ready to be stepped, if it is already.

    Attributes:
        judge: judges what happened, in order.
        outputs: how many were received.
        repeated: observations received twice.
    """

    def __init__(
        self,
        machine: Machine,
        library: InterfaceLibrary | None = None,
        node: str = "",
        bounds: Bounds | None = None,
        synchronised: bool = True,
        shared: Shared | None = None,
        program: Program | None = None,
    ) -> None:
        if library is None:
            library = library_for([Path(machine.position.file)], [], DiagnosticLog())
        self.machine = machine
        self.has_timers = has_timers(machine)
        """Whether what the machine does depends on how much time has passed."""
        self.node = node or machine.name
        self.bounds = bounds = bounds or Bounds()
        shared = shared or Shared()
        sources, publishers = shared.sources, shared.publishers
        self.losses = shared.losses
        self.channels = Channels(machine, library, self.node)
        self._clock = shared.clock
        self._publishers = publishers
        search = Search(machine, library, self.channels, bounds, program)
        self._program = program = search.program
        self._successors = search.successors
        self._fails = bool(program.call_failures or program.goal_failures)
        self._latency = bounds.latency
        self._sources = sources or Nodes(bounds.latency)
        self._streams = SourceStreams(self.channels, self.node, self._sources, shared.numbers)
        self._progress = Progress()
        self._lives = Lives()
        self._other_ends = OtherEnds(bounds.latency)
        held: Held[TraceEvent] = Held()
        self._links = Links()
        self._takes = TakenMessages(bounds.deadline + bounds.skew, self._links)
        self._topics = Topics(
            program,
            self.channels,
            publishers,
            self._takes,
            held,
            latency=bounds.latency,
            presumes_links=sources is None,
        )
        self._requests = RequestTracking(bounds.deadline, None if sources is None else self._links)
        tracked = Tracked(
            streams=self._streams,
            progress=self._progress,
            other_ends=self._other_ends,
            requests=self._requests,
            takes=self._takes,
            reachability=None if sources is None else sources.reachability,
        )
        self._taken_topics = program.taken_topics()
        confirmation = Confirmation(
            self.node,
            bounds,
            program,
            tracked,
            publishers,
            self.losses,
            self._sources,
        )
        self._conclusion = Conclusion(machine.name, self.node, confirmation.needed)
        self._unconfirmed = self._conclusion.unconfirmed
        self.judge = ModelOracle(
            machine.name, self.node, search, self._conclusion, confirmation.may_have_missed
        )
        self._delivery = Delivery(
            self.judge,
            self._conclusion,
            held,
            tracked,
            self._clock,
            bounds,
            synchronised,
        )
        self.outputs = 0
        self.repeated = 0
        self._unreadable = 0

    # --- what the node does ---------------------------------------------------------------------------

    def start(self, stamp_ns: int, whole: bool = False, earliest_ns: int = FOREVER) -> None:
        """The machine starts now, in its initial state.

        Args:
            stamp_ns: when, ns since the epoch.
            whole: nothing was missed: its timers run from this very moment, what it sends at once is
                received, and it receives all that is sent from now on. Otherwise these are uncertain for
                one latency bound.
            earliest_ns: it may have started then already (ns), where the news came late; its timers and
                delays may run since then.
        """
        self._other_ends.clear()
        self._streams.restart()
        self._progress.restart()
        self._lives.start(min(stamp_ns, earliest_ns))
        self._restart_links(stamp_ns)
        self._delivery.start(stamp_ns, whole, earliest_ns)
        self._conclusion.restart()

    def listen(self, since_ns: int) -> None:
        """All that the machine does from ``since_ns`` on is received, if anything of it is.

        For an oracle that is not ``synchronised``: without it, one that finds a machine silent knows
        nothing of it before the first observation, and takes the first thing it does for the end of
        something that began before. With it, the silence before counts as silence.
        Until then none does on a channel on which nothing was received from its node yet: what it sent
        may be missing. Nor does a message of others: of a machine that has started, it may not be linked
        to its publisher.

        Args:
            since_ns: ns since the epoch; ``FOREVER``: it is not known to be there, and owes nothing.
        """
        was_there = self._streams.is_there
        self._streams.received_since = since_ns
        self._delivery.linked(since_ns)
        if self._streams.is_there and not was_there:
            self._delivery.found()

    def sender_changed(self, name: str, stamp_ns: int) -> None:
        """``name`` came or went at ``stamp_ns``: what it sent last may never have left, or reached it."""
        if name == self.node:
            self._links.started_ns = stamp_ns
            self._requests.unlink()
            self._takes.unlink()
            return
        self._links.came(name, stamp_ns)
        self._requests.sender_ended(name)
        self._takes.sender_changed(name)

    def _restart_links(self, stamp_ns: int) -> None:
        """Another life of the node begins: others have to find it once more."""
        self._links.started_ns = stamp_ns
        self._requests.unlink()
        self._topics.restart()

    def lose(self, stamp_ns: int, text: str) -> list[Verdict]:
        """Something is missing: no verdict until the machine's doing is certain again.

        Args:
            stamp_ns: since when, ns since the epoch.
            text: what is missing, for people.
        """
        return self._delivery.lose(stamp_ns, text)

    def doubt(self, since_ns: int = 0) -> None:
        """Drop the violations stamped ``since_ns`` or later that are not certain yet.

        Something that happened then was not received, or its stamps are wrong.
        """
        self._unconfirmed.doubt(since_ns)

    # --- what is received -----------------------------------------------------------------------------

    def observe(self, observation: Observation) -> Verdict:
        """Take one observation; the verdict as it stands then."""
        verdicts = self.feed(observation)
        return verdicts[-1] if verdicts else self.verdict(observation.stamp_ns)

    def concerns(self, channel: str, source: str, kind: ObservationKind) -> bool:
        """Whether observations like this can mean anything to the machine."""
        return self.channels.concerns(channel, source, kind)

    def uses(self, channel: str) -> bool:
        """Whether the machine sends or receives anything on ``channel``."""
        return channel in self.channels.ports

    def takes(self, channel: str) -> bool:
        """Whether messages on ``channel`` can make a difference to the machine."""
        return channel in self._taken_topics

    def feed(self, observation: Observation, sequel: Sequel | None = None) -> list[Verdict]:
        """Take one observation; verdicts that it, and the time that has passed, bring about.

        Args:
            observation: what was received.
            sequel: how its number follows, where whoever calls this follows the numbers.
        """
        key = (observation.source, observation.channel, observation.kind)
        stream = self._streams.opened.get(key) or self._streams.of(observation)
        progress = self._progress
        if stream.other_end and progress.reported_ns:
            return []  # its own node numbers all that it reports: this adds nothing
        verdicts: list[Verdict] = []
        if stream.own and observation.life != self._lives.present:
            which = self._lives.see(observation.life, observation.stamp_ns)
            if which == PAST:
                return self.advance(observation.received_ns)
            if which == ANOTHER:
                self._begin_again(observation.stamp_ns, verdicts)
        count = stream.count
        if count is not None:
            number = observation.sequence
            if sequel is None and number >= 0:
                sequel = count.follow(number, observation.stamp_ns, observation.life)
                if sequel is Sequel.AGAIN:
                    self.repeated += 1
                    return self.advance(observation.received_ns)
            is_to_see = sequel is not _NEXT or self._unconfirmed.kept
            if number >= 0 and sequel is not None and is_to_see:
                self._look_at_number(observation, stream, sequel, verdicts)
        event: TraceEvent | None = None
        more: list[TraceEvent] | None = None
        read = stream.read
        try:
            if read is not None:
                event = read(observation)
                if stream.more:
                    found = (other(observation) for other in stream.more)
                    more = [item for item in found if item is not None]
        except AmbiguousError as error:
            verdicts += self._delivery.lose(observation.stamp_ns, str(error))
        except (KeyError, TypeError, ValueError, AttributeError):
            self._unreadable += 1
            text = f"an observation on {observation.channel} cannot be read"
            verdicts += self._delivery.lose(observation.stamp_ns, text)
        is_filled = False
        if more:
            more = [each for item in more if (each := self._of_topic(item)) is not None]
        if event is not None and (event.role is _TOPIC or event.role is _TAKEN):
            awaited_ns = self._takes.awaited_ns
            event = self._of_topic(event)
            is_filled = self._takes.awaited_ns > awaited_ns
        is_to_judge = event is not None and self._note(event, verdicts)
        delivery, received_ns = self._delivery, observation.received_ns
        if self._clock.watermark > delivery.watermark:
            delivery.watermark = self._clock.watermark
        until, order = received_ns - self._latency, observation.order
        if stream.own and order < 0:
            self._counts_per_channel(observation, verdicts)
            is_stranger = not self._is_announced
            self._successors.fails_unseen = self._fails and is_stranger
            self.judge.resynchronisation.may_be_slow = is_stranger
        if stream.own and order >= 0:
            if order == progress.next and not progress.ahead and progress.answer is None:
                progress.next, progress.reported_ns = order + 1, observation.stamp_ns
            else:
                progress.take(order, observation.stamp_ns, until)
            if self._unconfirmed.kept:
                verdicts += self._conclusion.reported(progress.reported_ns, progress.gap)
            if self._topics.is_ordered:
                until = delivery.known(until, received_ns)
            if (
                is_to_judge
                and event is not None
                and not more
                and until < delivery.wake
                and delivery.at_once(event, until, verdicts)
            ):
                return verdicts
        if is_to_judge and event is not None:
            verdicts += delivery.add(event)
        if more:
            for event in more:
                if self._note(event, verdicts):
                    verdicts += delivery.add(event)
        if is_filled and self._topics.is_ordered:
            until = delivery.known(until, received_ns)
        if until < delivery.wake:
            if until > delivery.watermark:
                delivery.watermark = until
            return verdicts
        return verdicts + delivery.pass_until(until)

    @property
    def _is_announced(self) -> bool:
        """Whether the node says that it is there: who does so reports, too, which of its calls failed."""
        return self.node not in self._sources.known or self._sources.is_announced(self.node)

    def _look_at_number(
        self,
        observation: Observation,
        stream: SourceStream,
        sequel: Sequel,
        verdicts: list[Verdict],
    ) -> None:
        """What the number of ``observation`` shows of losses goes to ``verdicts``."""
        stamp, number = observation.stamp_ns, observation.sequence
        if self._unconfirmed.kept and stream.count is not None:
            place = (observation.source, observation.channel, observation.kind is _MESSAGE)
            verdicts += self._conclusion.numbered(place, number, stamp)
        match sequel:
            case Sequel.FIRST if number > 0 and self._is_expected(stream):
                # a number above 0 comes first where a tap joins later, or where the first was lost
                text = f"what came first on {observation.channel} was not received"
                verdicts += self._delivery.lose(stamp, text)
            case Sequel.AFTER_A_GAP if self._is_shown_by_node(stream):
                self.losses.happen = True  # what is missing matters when it has been taken
            case Sequel.AFTER_A_GAP:
                self.losses.happen = True
                text = f"observations on {observation.channel} from {observation.source} were lost"
                verdicts += self._delivery.lose(stamp, text)
            case Sequel.ANEW if observation.source == self.node:
                self._begin_again(stamp, verdicts)
            case Sequel.ANEW:
                self.sender_changed(observation.source, stamp)

    def _begin_again(self, stamp_ns: int, verdicts: list[Verdict]) -> None:
        """The node has started again: what it reports is of another life from ``stamp_ns`` on."""
        self._progress.restart()
        self._other_ends.clear()
        self._unconfirmed.restart()
        self._restart_links(stamp_ns)
        verdicts += self._delivery.lose(stamp_ns, f"{self.node} was restarted")

    def _is_shown_by_node(self, stream: SourceStream) -> bool:
        """Whether the machine's node itself reports which messages of ``stream`` it took."""
        kind = stream.taken_as
        return kind is not None and evidence_of(kind, self._takes.reported) is Shown.BY_NODE

    def _is_expected(self, stream: SourceStream) -> bool:
        """Whether the first observation of ``stream`` should have been received by now."""
        if self._is_shown_by_node(stream):
            return False
        if self.losses.happen:
            return self.is_synchronised
        return self.judge.since_start and stream.own

    def _counts_per_channel(self, observation: Observation, verdicts: list[Verdict]) -> None:
        """The machine's node reports ``observation``, and does not number all that it reports."""
        if observation.kind is not _MESSAGE:
            kind, channel = observation.kind, observation.channel
            call = (observation.client, observation.call, observation.client_life)
            self._other_ends.report((kind, channel), call, observation.stamp_ns)
        if self._unconfirmed.kept and not self._progress.reported_ns:
            verdicts += self._conclusion.settled(self._other_ends, observation.stamp_ns)
            verdicts += self._conclusion.counts_per_channel()

    def _of_topic(self, event: TraceEvent) -> TraceEvent | None:
        """What is left to be judged of ``event``, where it is about a message of a topic."""
        if event.role is not _TOPIC and event.role is not _TAKEN:
            return event
        if event.role is _TOPIC and not self._program.changes_something(event.event):
            self._delivery.inputs += 1
            self._delivery.listen(event.stamp)
            return None
        if event.role is _TOPIC:
            event.ahead = self.bounds.skew
        left = self._topics.receive(event, self._delivery.taken_since)
        self._delivery.wake_by(self._takes.expected.due)
        return left

    def _note(self, event: TraceEvent, verdicts: list[Verdict]) -> bool:
        """Whether ``event`` is to be judged: what others report has its effect at once."""
        role = event.role
        if role is _OUTPUT:
            self.outputs += 1
            return True
        if role is _INPUT:
            self._delivery.inputs += 1
            if event.event is not None and event.event[0] in _TAKEN_UP:
                self._requests.take(event, self._delivery.watermark)
                self._delivery.note_passed()
            return True
        match role:
            case Role.ASKED:
                source = event.observation.source
                is_known = source == event.call[0] and self._publishers.is_caller(source)
                if is_known and event.stamp > self._delivery.asked_since:
                    self._requests.ask(event)
                    self._delivery.wake_by(self._requests.expected.due)
                return False
            case Role.ANSWERED:  # that it was taken up was not reported, or not yet
                self._requests.take(event, self._delivery.watermark)
                self._imply(event, ObservationKind.REQUEST_RECEIVED)
                self._imply(event, ObservationKind.RESPONSE_SENT)
                return False
            case Role.OTHER_END:
                self._imply(event, ObservationKind.REQUEST_SENT)
                if event.observation.kind is ObservationKind.RESPONSE_SENT:
                    self._imply(event, ObservationKind.RESPONSE_RECEIVED)
                return False
            case Role.UNREACHED:
                self._requests.give_up(event.call, event.observation.channel, event.stamp)
                return False
            case Role.UNANSWERED:
                self._requests.give_up(event.call, event.observation.channel, event.stamp)
                self._unconfirmed.gave_up(event.observation.channel, event.call, event.stamp)
                return False
            case Role.UNDECLARED:
                self.outputs += 1
            case Role.MESSAGE:
                self._delivery.inputs += 1
        return True

    def _imply(self, event: TraceEvent, kind: ObservationKind) -> None:
        """By the other end of a call, the node did this."""
        if not self._progress.reported_ns:
            where = (kind, event.observation.channel)
            self._other_ends.imply(where, event.call, event.stamp)

    # --- how far all was received ---------------------------------------------------------------------

    def reported(self, number: int, stamp_ns: int, now_ns: int) -> list[Verdict]:
        """The node was asked how far it is: what it did not report, it did not do.

        Args:
            number: all that it did until then has a number (``Observation.order``) below this one.
            stamp_ns: until when (ns since the epoch).
            now_ns: on the clock of ``Observation.received_ns``.
        """
        progress = self._progress
        progress.answered(number, stamp_ns)
        if self._streams.received_since not in (None, FOREVER):
            self._delivery.listen(stamp_ns)  # it is there, and its silence counts
        if progress.answer is not None:  # what it says to have reported may be lost
            self._delivery.wake_by(stamp_ns)
        if not any(hypothesis.pending for hypothesis in self.judge.hypotheses or ()):
            self._topics.follow(self._delivery.taken_since)  # who answers reports what it takes
            self._delivery.wake_by(self._takes.expected.due)
        until = now_ns - self._latency
        if self._topics.is_ordered:
            until = self._delivery.known(until, now_ns)
        verdicts: list[Verdict] = []
        if self._unconfirmed.kept:
            verdicts += self._conclusion.reported(progress.reported_ns, progress.gap)
        return verdicts + self._delivery.advance(until) if until >= self.wake else verdicts

    def advance(self, now_ns: int) -> list[Verdict]:
        """Time has passed: what can no longer change is judged, and what is overdue is found.

        Args:
            now_ns: on the clock of ``Observation.received_ns``.
        """
        verdicts = self._delivery.pass_until(now_ns - self._latency)
        if self._unconfirmed.kept:
            until_ns, by_time = now_ns - self._latency, self.losses.are_over_by_time
            verdicts += self._conclusion.silent(
                lambda since_ns: self._sources.is_reached(self.node, since_ns, until_ns),
                until_ns,
                by_time,
            )
        return verdicts

    def told(self) -> list[Verdict]:
        """Other nodes may have reported something: violations that are certain by that."""
        if not self._unconfirmed.kept:
            return []
        return self._conclusion.told(self._sources, self.bounds.skew)

    def to_ask(self) -> set[str]:
        """The nodes to be asked how far they have reported, to make a violation certain; each once."""
        return self._unconfirmed.to_ask(self.node) if self._unconfirmed.kept else set()

    def has_acted(self, since_ns: int) -> bool:
        """Whether the node did something since then (ns) that was not received, by its callers' reports."""
        return self._other_ends.has_any(since_ns)

    # --- how it stands --------------------------------------------------------------------------------

    def verdict(self, stamp_ns: int = 0) -> Verdict:
        """The verdict as it stands."""
        return self._conclusion.verdict(stamp_ns)

    @property
    def suspected(self) -> Verdict | None:
        """The violation that makes the verdict inconclusive, as it is not certain; None: none does."""
        return self._conclusion.suspected

    @property
    def outcome(self) -> Outcome:
        """Of the verdict as it stands."""
        return self._conclusion.outcome

    @property
    def violations(self) -> int:
        """How many were certain."""
        return self._conclusion.violations

    @property
    def inputs(self) -> int:
        """How many were received, or were sent to it."""
        return self._delivery.inputs

    @property
    def late(self) -> int:
        """Observations that came after their time, and others that could not be used."""
        return self._delivery.late + self._unreadable

    @property
    def wake(self) -> int:
        """Until all that happened by then (ns) was received, time alone changes nothing."""
        wake = self._delivery.wake
        return min(wake, self._unconfirmed.silent_ns) if self._unconfirmed.kept else wake

    @property
    def judged_until(self) -> int:
        """What was taken or made by then (ns) has been judged."""
        return self._delivery.judged_until

    @property
    def silent_ns(self) -> int:
        """From then on (ns) it decides something if the node did nothing more, and the node can say so.

        FOREVER: nothing is due, or the node's word would not be enough.
        """
        if (
            not self._topics.is_ordered
            or not self.is_synchronised
            or not self._progress.reported_ns
        ):
            return FOREVER
        due = self._delivery.due_ns
        return due if due > self._delivery.watermark else FOREVER

    def take_unreached(self) -> set[str]:
        """Nodes of which it has to be known whether they can be reached: they are to be asked."""
        unreached = self._delivery.unreached
        if unreached:
            self._delivery.unreached = set()
        return unreached

    def take_findings(self, until_ns: int) -> list[str]:
        """What was found of links, one sentence each."""
        return self._delivery.take_findings(until_ns)

    @property
    def is_synchronised(self) -> bool:
        """Whether it is known what the machine may be doing."""
        return self.judge.hypotheses is not None

    @property
    def hypotheses(self) -> list[Hypothesis]:
        """What the machine may be doing, by all that was received until now."""
        return self._delivery.foreseen()

    def states(self) -> list[str]:
        """Names of the states in which the machine may be."""
        program = self._program.parts[0]
        return sorted({program.states[h.instances[0][0]].name for h in self.hypotheses})
