"""Properties at work in a monitor: what it received goes to them in order of stamps, with what it missed.

Observations count once all that was stamped before was received: by the numbers of all nodes that may send
on the channels of the properties, else when the latency bound is over. Where only silence stands in the way
of a violation (:class:`moon.properties.ordering.Presumption`), those nodes are asked how far they have
reported.

What was missed (gaps in the numbers of a source, what came too late) makes whatever depends on it
inconclusive, from the instant at which it was missed (:meth:`moon.properties.monitor.PropertySet.lose`).
A violation is reported once it holds whatever was not received until then, or nothing is missing
(:mod:`moon.feed.unreceived`). Until then the property is inconclusive.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence

import msgspec

from m2c.suggestions import first_of
from moon.feed.clock import EventTimeClock
from moon.feed.nodes import Nodes
from moon.feed.unreceived import Place, Stretch, Unreceived
from moon.judge import Gap, Intake, Missing, NodeChange
from moon.monitor.call_ends import CallEnds
from moon.monitor.careful import CarefulProperties
from moon.monitor.departures import PREFIX, Departures
from moon.monitor.open_times import OpenTimes
from moon.monitor.property_verdicts import OUTCOMES, verdict_on
from moon.monitor.status import PROPERTY, UNSEEN, MachineStatus
from moon.monitor.turns import BEHIND_NS
from moon.oracle.bounds import FOREVER
from moon.oracle.confirmation import KEPT_VIOLATIONS, UNCONFIRMED
from moon.properties.describe import duration
from moon.properties.monitor import TimeOrderError
from moon.properties.predicates import ANY_CHANNEL
from moon.properties.property import Property, Status
from moon.properties.property import Verdict as PropertyVerdict
from moon.sources.source import Reach
from moon.verdict import Outcome, Verdict
from moon.wording import Wording
from transports.bounded import BoundedDict
from transports.interface import Answer, Observation, ObservationKind

MOST_PLACES = 10_000
"""Sources that are remembered; their names come from the wire, and never end."""
REMEMBERED = 256
"""Violations of a property that can still be withdrawn, as a loss is found later than they are."""
KEPT_LOSSES = 16
"""So many losses of a channel are remembered."""
LOOK_NS = 10_000_000
"""So long after an observation it is looked at whether something is presumably false by it: what was stamped
before has mostly been received then. Where things are later than that, so long as they were of late."""

TIMES_OPEN = "violated as it is stamped, but perhaps not as it happened, which is known to {}: "
"""How the reason begins of what is inconclusive because of that."""


class _Loss(msgspec.Struct):
    """Messages of ``channel`` stamped in ``[start, end)`` that were missed.

    ``stands``: what was violated was so by what was certain then, and is not withdrawn. ``is_shown``: numbers
    show it; else it may be that some were.
    """

    start: int
    end: int
    channel: str
    stands: bool = False
    is_shown: bool = True

    def covers(self, start_ns: int, end_ns: int) -> bool:
        """Whether all of ``[start_ns, end_ns)`` is of it."""
        return self.start <= start_ns and end_ns <= self.end


class _Unconfirmed(msgspec.Struct):
    """A violation that is not certain yet: something may be missing, or a clock may have been set.

    Attributes:
        name: of the property.
        verdict: the violation.
        places: where something that was not received may be the reason.
    """

    name: str
    verdict: PropertyVerdict
    places: tuple[Place, ...]


class _Tally:
    """What was received and reported of one property."""

    __slots__ = ("channels", "last", "outcome", "received", "since", "violations")

    def __init__(self, channels: frozenset[str]) -> None:
        self.channels = channels
        self.received = 0
        self.outcome: Outcome | None = None
        self.violations = 0
        self.since: list[int] = []
        """Since when, of the latest :data:`REMEMBERED`."""
        self.last = ""

    def concerns(self, channel: str) -> bool:
        """Whether the property listens to ``channel``."""
        return channel in self.channels or ANY_CHANNEL in self.channels


class PropertyWatch:
    """Monitors properties over what a tap receives.

    Args:
        properties: what to monitor; names must differ.
        latency_ns: nothing is received later than this after its stamp.
        departures: of ``properties``, with the models of nodes; by default, without any.
        wording: how explanations word messages; by default numbers have no names.
    """

    def __init__(
        self,
        properties: Iterable[Property],
        latency_ns: int,
        departures: Departures | None = None,
        wording: Wording | None = None,
    ) -> None:
        properties = tuple(properties)
        self._departures = departures or Departures(properties)
        self._wording = wording or Wording()
        self.properties = {item.name: item for item in properties}
        self.late = 0
        """Observations that came too late to be judged."""
        self.turns = 0
        """Turns at which there was something to look at."""
        self._open_times = OpenTimes(self._departures.properties)
        self._orders = self._open_times.orders
        """Of each property that is violated only if it is whenever things happened."""
        self._clocks: BoundedDict[str, str] = BoundedDict(MOST_PLACES)
        """By which clock each node stamps that was found; "": that is not known."""
        self._heard: BoundedDict[tuple[str, str], None] = BoundedDict(MOST_PLACES)
        """Who was heard on which channel."""
        self._unheard: frozenset[str] = frozenset()
        """Channels of which nothing is received, whatever happens there."""
        self.withdrawn: Callable[[str, int], None] = lambda name, since_ns: None
        """Called with a violation (of which property, since when) that does not count any more."""
        self.name = "properties"
        self._latency_ns = latency_ns
        self._clock: EventTimeClock | None = None
        self._tallies = {
            name: _Tally(frozenset(port.channel for port in item.ports))
            for name, item in self.properties.items()
        }
        self._sources = Nodes(latency_ns)
        self._unreceived = Unreceived(self._sources)
        """Who may send on the channels of the properties, and what of that may be missing."""
        self._topics = {
            port.channel
            for item in self.properties.values()
            for port in item.ports
            if ObservationKind.MESSAGE in port.kinds
        }
        self._on_other_time: BoundedDict[str, str] = BoundedDict(MOST_PLACES)
        """Nodes whose timers follow another clock, and why; "": any node's may."""
        self._received: set[str] = set()
        """Channels of the properties on which something was received."""
        self._is_anybody = False
        self._sent_by_models: frozenset[str] = frozenset()
        """Channels on which some node sends, by the models."""
        self._modelled: frozenset[str] = frozenset()
        """Those nodes: they send nowhere else."""
        self._lives: BoundedDict[str, tuple[int, int]] = BoundedDict(MOST_PLACES)
        """Of each node that was found, when it began; if it did not say, since when all is received (ns)."""
        self._to_ask: list[str] = []
        self._clear()

    def _clear(self) -> None:
        self._ordered = CarefulProperties(self._departures.properties, self._latency_ns)
        self._hopeful = self._ordered.hopeful
        self._hopeful.presume(-1)  # compiles now what would hold it up later
        self.channels = frozenset(
            name for name in self._hopeful.channels() if not name.startswith(PREFIX)
        )
        self._open_times.restart()
        self._unconfirmed: list[_Unconfirmed] = []
        self._ends = CallEnds()
        self._certain_ns = FOREVER
        """Then time alone may make one of them certain."""
        self._lost: dict[str, deque[_Loss]] = {}
        """The latest of each channel: what is reported again is no news."""
        self._presumed: dict[str, deque[_Loss]] = {}
        """Stretches of each channel in which something may have been missed that no number shows."""
        self._losses = [_Loss(0, FOREVER, channel) for channel in sorted(self._unheard)]
        self._reached_ns = -1
        self._is_begun = True
        self._due_ns = 0
        """Nothing changes before all until this instant (ns) is known, if nothing is received."""
        self._presume_ns = 0
        """The same of what is presumed."""
        self._are_waiting = False
        """Whether those that begin when all nodes were found wait for them."""
        self._wait_ns = LOOK_NS
        self._now_ns = 0

    def rely_on(
        self,
        sources: Nodes,
        senders: Mapping[str, Iterable[str]],
        clock: EventTimeClock | None = None,
    ) -> None:
        """Nodes number what they report, and can be asked.

        Args:
            sources: how far all of them are; kept up to date by whoever calls this.
            clock: of the judges, kept so, too; it says how late observations were of late.
            senders: the nodes that may report something on each channel, by their models; empty: there are
                no models, and any node that comes up may.
        """
        self._sources, self._clock = sources, clock
        self._unreceived = Unreceived(sources)
        self._is_anybody = not senders
        self._sent_by_models = frozenset(senders)
        self._modelled = frozenset().union(*senders.values())
        for channel, names in senders.items():
            if self.concerns(channel):
                for name in names:
                    self._unreceived.expect(name, channel, channel in self._topics)

    def start(self, since_ns: int, linked_ns: int = 0) -> None:
        """Listening begins at ``since_ns``, with what is received at that instant.

        What holds then is known one latency bound later: by then all are found that were there before. It is
        known at once that nobody was, where all that may send have started since.

        Args:
            since_ns: ns since the epoch.
            linked_ns: so long after it was found, a node is linked on all its channels (ns); 0: at once.
        """
        self._unreceived.linked_ns = linked_ns
        clocks = self._sources.clocks
        self._open_times.start(since_ns, clocks.differ_ns)
        if clocks.are_own:  # some nodes may not say on which host they are
            for node in self._unreceived.channels:
                if node not in self._clocks:
                    self._meet(node, "")
            for channel in self.channels - self._sent_by_models:
                self._hear("", channel)
        if linked_ns:
            self._ordered.be_careful()
        self._reached_ns, self._is_begun = since_ns - 1, False
        self._are_waiting = self._sources.are_found and bool(self._departures.missing)
        if not self._are_waiting:
            for started in self._departures.started(since_ns):
                self._hold(started)
        for loss in self._losses:  # of channels of which nothing is received: properties begin now
            loss.start = max(loss.start, since_ns)

    def _meet(self, node: str, clock: str) -> None:
        """``node``, which may send to properties, stamps by ``clock``."""
        if self._clocks.get(node) == clock:
            return
        self._clocks[node] = clock
        names: list[str] = []
        if (sends := self._unreceived.channels.get(node)) is not None:
            tallies = self._tallies.items()
            names = [name for name, it in tallies if not sends or any(map(it.concerns, sends))]
        self._open_times.meet(node, clock, names)

    def _hear(self, node: str, channel: str) -> None:
        """``node`` sends on ``channel``, whether or not a model says so."""
        self._heard[node, channel] = None
        names = [name for name, tally in self._tallies.items() if tally.concerns(channel)]
        is_found = node in self._clocks or node in self._unreceived.channels
        self._open_times.meet(node if is_found else "", self._clocks.get(node, ""), names)

    def _senders_to(self, name: str) -> list[str]:
        """The nodes that may send something to the property."""
        concerns = self._tallies[name].concerns
        senders = self._unreceived.channels.items()
        return [node for node, sends in senders if not sends or any(map(concerns, sends))]

    def miss(self, channels: Iterable[str]) -> None:
        """Of ``channels`` nothing is received, whatever happens there."""
        self._unheard = frozenset(channels)
        self._clear()

    def doubt_times(self, names: Iterable[str], open_ns: int, shared: Iterable[str] = ()) -> None:
        """What ``names`` are about happened within ``open_ns`` before its stamp (``AnyOrder``).

        On the topics ``shared`` several publishers publish.
        """
        self._open_times.choose(names, open_ns, shared)
        self._clear()

    def concerns(
        self, channel: str, source: str = "", kind: ObservationKind = ObservationKind.MESSAGE
    ) -> bool:
        """Whether some property listens to ``channel``."""
        if kind is ObservationKind.MESSAGE_TAKEN:  # of which properties say nothing
            return False
        return channel in self.channels or ANY_CHANNEL in self.channels

    def silent(self) -> list[str]:
        """The channels of the properties on which nothing was received, sorted."""
        return sorted(self.channels - self._received - {ANY_CHANNEL})

    def observe(self, seen: Intake) -> Sequence[Verdict]:
        """Take in what was received; it counts when :meth:`advance` says that its latency is over."""
        for started in self._departures.found(seen.seen.source, seen.seen.received_ns):
            self._hold(started)
        self._observe(seen.seen)
        source = self._sources.known.get(seen.seen.source)
        if source is not None and source.met_ns == seen.seen.stamp_ns:
            self._lose_of(seen.seen.source, 0, source.met_ns)  # what it did before is not known
        return ()

    def _observe(self, seen: Observation) -> None:
        if not self.concerns(seen.channel, seen.source, seen.kind):
            return
        self._received.add(seen.channel)
        clocks = self._sources.clocks
        if clocks.are_told and (seen.source, seen.channel) not in self._heard:
            self._hear(seen.source, seen.channel)
        for tally in self._tallies.values():
            tally.received += seen.channel in tally.channels
        self._unreceived.received(seen)
        self._ends.take(seen)
        if seen.channel in self._departures.channels:
            self._departures.received(seen)
        self._hold(seen)

    def node_changed(self, change: NodeChange) -> Sequence[Verdict]:
        """A node came up or went away: who is not there owes no response."""
        node, up, now_ns = change.node, change.is_up, change.now_ns
        if self._is_anybody and up:
            self._unreceived.expect(node)
        if up and self._sources.clocks.are_told:
            self._meet(node, change.clock)
        if up and node in self._unreceived.channels:
            # whether it answers has to be known before it may be out of reach
            self._to_ask = sorted({*self._to_ask, node})
        if up:
            for channel, from_ns, until_ns in self._unreceived.started(
                node, self._sources.up_since(node)
            ):
                if self.concerns(channel):
                    loss = _Loss(from_ns, until_ns, channel, is_shown=False)
                    self._losses.append(loss)
                    self._remembered(self._presumed, channel).append(loss)
                    self._due_ns = 0
            if not self._is_begun:
                self._due_ns = 0
        for departure in self._departures.changed(node, up, now_ns):
            self._hold(departure)
        if up:
            self._found(change)
        return ()

    def _found(self, change: NodeChange) -> None:
        """A node is there; what it did before all is received is not known.

        Nothing is reported of what should have been before. Of one that was out of reach it is known by its
        numbers what was lost.
        """
        node, listening_ns = change.node, self._sources.listening_ns
        life = change.since_ns, 0 if change.since_ns else listening_ns
        if change.since_ns < listening_ns and self._lives.get(node) != life:
            known = self._sources.known[node]
            is_met = known.is_numbered and known.progress.reported_ns
            since_ns = known.met_ns if is_met else change.now_ns + 1
            self._lose_of(node, 0, max(listening_ns, since_ns))
        self._lives[node] = life

    def ending(self, now_ns: int) -> None:
        """The nodes are about to be ended: what is due after ``now_ns`` (ns) is owed by nobody."""
        for ending in self._departures.ending(now_ns):
            self._hold(ending)

    def _hold(self, seen: Observation) -> None:
        try:
            self._ordered.observe(seen)
        except TimeOrderError:
            self.late += 1
            self.lose(seen.channel, seen.stamp_ns, seen.stamp_ns + 1)
        else:
            self._open_times.observe(seen)
            self._due_ns = min(self._due_ns, seen.stamp_ns)
            self._presume_ns = min(self._presume_ns, seen.stamp_ns)

    def lose(self, channel: str, start_ns: int, end_ns: int) -> None:
        """Messages of ``channel`` stamped in ``[start_ns, end_ns)`` were missed."""
        self._unreceived.is_lossy = True
        self._lose(channel, start_ns, end_ns)

    def _lose(self, channel: str, start_ns: int, end_ns: int) -> None:
        if not self.concerns(channel):
            return
        start_ns = min(start_ns, end_ns)
        known = self._remembered(self._lost, channel)
        if any(loss.covers(start_ns, end_ns) for loss in known):
            return  # by the numbers of a channel, and by those of all that its node reports
        # what was violated was so whatever had been sent there
        presumed = self._remembered(self._presumed, channel)
        stands = any(loss.covers(start_ns, end_ns) for loss in presumed)
        loss = _Loss(start_ns, end_ns, channel, stands)
        known.append(loss)
        self._due_ns = 0
        self._losses.append(loss)

    @staticmethod
    def _remembered(losses: dict[str, deque[_Loss]], channel: str) -> deque[_Loss]:
        """Those of ``channel``."""
        if len(losses) >= MOST_PLACES:
            losses.clear()
        return losses.setdefault(channel, deque(maxlen=KEPT_LOSSES))

    def gap(self, gap: Gap) -> Sequence[Verdict]:
        """Something is missing; where no channel is known, it may be of any on which its source sends."""
        if gap.cause is Missing.OWN_CLOCK_SET:
            return self.begin_anew(gap.until_ns, gap.why)
        if gap.cause is Missing.ANEW or gap.cause is Missing.CLOCK_SET:
            self.clock_set(gap.from_ns, gap.until_ns)
        elif gap.cause is Missing.NOT_RECEIVED:
            self._lose(gap.channel, gap.from_ns, gap.until_ns)
        elif gap.cause is Missing.OTHER_TIME:
            self._on_other_time[gap.source] = gap.why
        elif gap.cause is Missing.MAY_NOT_BE_TAKEN or gap.kind is ObservationKind.MESSAGE_TAKEN:
            pass  # properties say nothing of who takes messages
        else:
            self._unreceived.is_lossy = True
            if gap.channel:
                self._ends.lost(gap)
                self._lose(gap.channel, gap.from_ns, gap.until_ns)
            else:
                self._lose_of(gap.source, gap.from_ns, gap.until_ns)
        return ()

    def _lose_of(self, node: str, start_ns: int, end_ns: int) -> None:
        """Whatever ``node`` sent in ``[start_ns, end_ns)`` may have been missed."""
        self._lose_each(self._sent_by(node), start_ns, end_ns)

    def _sent_by(self, node: str) -> Collection[str]:
        """On which channels ``node`` may send something that concerns a property."""
        if node in self._modelled:
            return self._unreceived.channels.get(node, ())
        return self.channels - self._sent_by_models

    def lose_all(self, start_ns: int, end_ns: int) -> None:
        """Whatever was sent in ``[start_ns, end_ns)`` may have been missed."""
        self._lose_each(self.channels, start_ns, end_ns)

    def _lose_each(self, channels: Iterable[str], start_ns: int, end_ns: int) -> None:
        for channel in sorted(channels):  # what is reported must not depend on a hash
            self._lose(channel, start_ns, end_ns)

    def clock_set(self, from_ns: int, since_ns: int) -> None:
        """Stamps in ``[from_ns, since_ns)`` tell nothing: a node's clock was set, or the monitor stood still.

        What was certain by then stands, and what was not does not become certain by what comes after.
        """
        open_ns = [waiting.verdict.since_ns for waiting in self._unconfirmed]
        start_ns = min(from_ns, since_ns, *open_ns)
        self._unconfirmed.clear()
        for tally in self._tallies.values():
            tally.since.clear()
        self._due_ns = 0
        self._losses += [
            _Loss(start_ns, since_ns, channel, stands=True) for channel in sorted(self.channels)
        ]

    def begin_anew(self, now_ns: int, why: str) -> list[Verdict]:
        """Forget everything that was observed: stamps begin elsewhere. The verdicts on that.

        A violation of before stands: its stamp says nothing of what is lost from now on.
        """
        found = []
        for name, tally in self._tallies.items():
            tally.since.clear()
            if tally.outcome is not None:
                new = PropertyVerdict(Status.INCONCLUSIVE, now_ns, reason=why)
                found += self._news(name, new)
        self._clear()
        self._unreceived.restart()
        self.start(now_ns, self._unreceived.linked_ns)
        self.lose_all(0, now_ns)  # time did not begin now, and nothing of before counts
        for departure in self._departures.again(now_ns):
            self._hold(departure)
        return found

    def advance(self, until_ns: int) -> list[Verdict]:
        """It is ``until_ns``: what was stamped the latency bound before was received, or is lost.

        Returns:
            The verdicts that changed.
        """
        now_ns, lag_ns = until_ns, 0 if self._clock is None else self._clock.lag_ns
        self._wait_ns = min(max(LOOK_NS, lag_ns), self._latency_ns)
        is_early = now_ns < self._look_ns and self._known_ns(now_ns) < self._due_ns
        if is_early and not self._unconfirmed:
            return []
        self.turns += 1
        for channel, start_ns, end_ns in self._ends.missing(self._known_ns(now_ns)):
            self.lose(channel, start_ns, end_ns)
        found: list[Verdict] = []
        for loss in self._losses:
            found += self._missed(loss)
        self._losses.clear()
        self._now_ns = now_ns
        self._open_times.advance(self._known_ns(now_ns), not self._is_begun)
        found += self._begun()
        found += self._confirmed()
        found += self._pass_to(self._known_ns(now_ns))
        self._presume(now_ns)
        found += self._of_beginning()
        self._due_ns = self._ordered.due_ns if self._is_begun else self._reached_ns + 1
        return found

    def _of_beginning(self) -> list[Verdict]:
        """Of those that waited for nodes, which are there by now."""
        if not self._are_waiting or self._departures.missing or not self._is_begun:
            return []
        self._are_waiting = False
        verdicts = self._ordered.verdicts()
        return self._changes([(name, verdicts[name]) for name in self._departures.beginning])

    def finish(self, known_ns: int, end_ns: int) -> list[Verdict]:
        """Listening has ended; the verdicts that changed.

        Args:
            known_ns: all that was stamped until then (ns) was received, or is lost.
            end_ns: nothing later was received.
        """
        self._open_times.finish(known_ns)
        found = self.advance(known_ns + self._latency_ns)
        found += self._confirmed()
        for waiting in self._unconfirmed:  # nothing more is to come
            is_whole = all(window.can_answer for window in self._windows(waiting))
            if is_whole and not self._is_open(waiting, self._unconfirmed):
                found += self._report(waiting.name, waiting.verdict)
        self._unconfirmed.clear()
        self._reached_ns = max(self._reached_ns, end_ns)
        return found + self._changes(self._ordered.conclude(end_ns))

    def _known_ns(self, now_ns: int) -> int:
        """All that was stamped until then (ns) was received, or is lost."""
        if not self._is_begun:
            return now_ns - self._latency_ns
        return max(
            now_ns - self._latency_ns, self._sources.known_ns(self._unreceived.channels, now_ns)
        )

    @property
    def _look_ns(self) -> int:
        """Until then (ns) time alone changes nothing."""
        return min(self._due_ns + self._latency_ns, self._presume_ns + self._wait_ns)

    @property
    def next_ns(self) -> int:
        """Until then (ns) time alone changes nothing; 0: it may at once."""
        return min(self._look_ns, self._certain_ns) if self._due_ns else 0

    def answered(self, node: str, answer: Answer, reach_ns: int) -> list[Verdict]:
        """``node`` said up to where it has reported everything; it is ``reach_ns`` (ns)."""
        return self.advance(reach_ns)

    @property
    def due_ns(self) -> int:
        """When a turn is wanted (ns); 0: at once. It is :attr:`next_ns`, or up to :data:`BEHIND_NS` later."""
        if not self._due_ns:
            return 0
        due_ns = self._due_ns + self._latency_ns + BEHIND_NS * bool(self._hopeful.held)
        return min(due_ns, self._presume_ns + self._wait_ns, self._certain_ns)

    def take_questions(self) -> Sequence[str]:
        """The nodes to be asked now how far they have reported."""
        if not self._to_ask:
            return ()
        names, self._to_ask = self._to_ask, []
        return names

    def _presume(self, now_ns: int) -> None:
        """Ask nodes, if their silence would make something false."""
        until_ns = now_ns - self._wait_ns
        if not self._is_begun:
            self._presume_ns = FOREVER
            return
        names = (
            self._sources.behind(self._unreceived.channels, until_ns, now_ns)
            if self.properties
            else []
        )
        if not names:
            self._hopeful.presume_nothing()
            self._presume_ns = FOREVER
            return
        if self._hopeful.presume(until_ns):
            self._to_ask = sorted({*self._to_ask, *names})
        self._presume_ns = self._hopeful.presume_ns

    def _missed(self, loss: _Loss) -> list[Verdict]:
        """Hand ``loss`` to the properties; a violation of which it leaves nothing is withdrawn."""
        lose = self._ordered.lose if loss.is_shown else self._ordered.may_lose
        changes = dict(lose(loss.channel, loss.start, loss.end))
        self._open_times.lose(loss.channel, loss.start, loss.end)
        verdicts = self._ordered.verdicts()
        found = self._drop_explained(loss)
        for name, tally in self._tallies.items():
            standing = verdicts[name]
            stands = standing.since_ns if standing.status is Status.FALSE else None
            doubted = [ns for ns in tally.since if ns >= loss.start and ns != stands]
            if loss.stands or not doubted or not tally.concerns(loss.channel):
                if name in changes:
                    found += self._news(name, changes[name])
                continue
            tally.since = [ns for ns in tally.since if ns not in doubted]
            tally.violations -= len(doubted)
            for since_ns in doubted:
                self.withdrawn(name, since_ns)
            if standing.status is not Status.FALSE:
                why = f"the violation is withdrawn: messages on {loss.channel} were missed"
                found += self._report(name, msgspec.structs.replace(standing, reason=why))
        return found

    def _begun(self) -> list[Verdict]:
        """What holds at the beginning, if all that may send have started since."""
        if self._is_begun or not self._unreceived.all_have_started():
            return []
        self._is_begun = True
        self._reached_ns += 1
        return self._changes(self._ordered.seal(self._reached_ns))

    def _pass_to(self, instant: int) -> list[Verdict]:
        """Everything stamped up to ``instant`` counts.

        If nothing is due by then nothing is done, which leaves room for what comes later than it
        should.
        """
        if instant <= self._reached_ns:
            return []
        found: list[Verdict] = []
        if not self._is_begun:
            self._is_begun = True
            found = self._changes(self._ordered.seal(self._reached_ns + 1))
        elif self._reached_ns >= 0 and self._ordered.due_ns > instant:
            return []
        self._reached_ns = instant
        return found + self._changes(self._ordered.seal(instant))

    # --- what is reported --------------------------------------------------------------------------

    def _changes(self, changes: Sequence[tuple[str, PropertyVerdict]]) -> list[Verdict]:
        return [made for name, verdict in changes for made in self._news(name, verdict)]

    def _news(self, name: str, verdict: PropertyVerdict) -> list[Verdict]:
        """What is certain now is reported, unless it was before."""
        tally = self._tallies[name]
        if verdict.status is not Status.FALSE and (unheard := tally.channels & self._unheard):
            reason = f"{', '.join(sorted(unheard))}: not recorded"
            verdict = PropertyVerdict(Status.INCONCLUSIVE, verdict.since_ns, reason=reason)
        outcome = OUTCOMES[verdict.status]
        if outcome is tally.outcome and outcome is not Outcome.VIOLATED:
            return []
        if outcome is Outcome.CONFORMING and tally.outcome is None and self._waits_for(name):
            return []
        if outcome is Outcome.CONFORMING and self._is_time_open(name):
            return []
        if outcome is Outcome.VIOLATED:
            places = self._needed(name, verdict.since_ns)
            if places or self._is_untimed(name) or name in self._orders:
                return self._wait_for(name, verdict, places)
        return self._report(name, verdict)

    def _waits_for(self, name: str) -> Collection[str]:
        """The nodes that were never found, if a property waits for them."""
        return self._departures.missing if name in self._departures.beginning else ()

    # --- what is certain ---------------------------------------------------------------------------

    def _needed(self, name: str, until_ns: int) -> list[Stretch]:
        """Where something may be missing that would undo a violation at ``until_ns``."""
        concerns = self._tallies[name].concerns
        until_ns += self._open_times.open_ns(name)
        windows = list(self._unreceived.windows(concerns, until_ns, self._now_ns))
        if self._withstands(name, windows):
            return []
        needed = [window for window in windows if not self._withstands(name, [window])]
        others = [window for window in windows if window not in needed]
        return needed if needed and self._withstands(name, others) else windows

    def _is_untimed(self, name: str) -> bool:
        """Whether a clock may have been set of a node that sends to the property, or time passes differently
        for it, where that makes a difference.
        """
        return bool(self._sources.clocks.doubtful(self._senders_to(name)) or self._other_time(name))

    def _other_time(self, name: str) -> str:
        """Why it is not known how much time passes for those who send to the property; "" if it is."""
        if not self._on_other_time or name not in self._open_times.timed:
            return ""
        senders = self._senders_to(name)
        whys = (why for node, why in self._on_other_time.items() if not node or node in senders)
        return next(whys, "")

    def _is_open(self, waiting: _Unconfirmed, others: Iterable[_Unconfirmed]) -> bool:
        """Whether what ``waiting`` rests on, when something happened, is not certain.

        Of ``others`` with it, the last one is certain by which it was false whenever things happened.
        """
        name = waiting.name
        if self._is_untimed(name):
            return True
        orders = self._orders.get(name)
        if orders is None:
            return False
        if orders.times <= orders.reported:
            return True
        latest_ns = orders.fell_ns + orders.open_ns
        return any(
            other.name == name and waiting.verdict.since_ns < other.verdict.since_ns <= latest_ns
            for other in others
        )

    def _is_time_open(self, name: str) -> bool:
        """Whether it was violated as it was stamped, and perhaps not as it happened."""
        return name in self._orders and any(it.name == name for it in self._unconfirmed)

    def _withstands(self, name: str, windows: Iterable[Stretch]) -> bool:
        """Whether it is violated whatever happened there."""
        open_ns = self._open_times.open_ns(name)
        losses = [
            (channel, max(window.from_ns - open_ns, 0), window.until_ns)
            for window in windows
            for channel in sorted(
                (window.place.channel,)
                if window.place.channel
                else self._sent_by(window.place.node)
            )
        ]
        return not losses or self._ordered.withstands(name, losses)

    def _wait_for(
        self, name: str, verdict: PropertyVerdict, windows: Sequence[Stretch]
    ) -> list[Verdict]:
        """It is violated if nothing is missing; the nodes that may have done something are asked."""
        places = tuple(window.place for window in windows)
        self._unconfirmed.append(_Unconfirmed(name, verdict, places))
        mine = [waiting for waiting in self._unconfirmed if waiting.name == name]
        if len(mine) > KEPT_VIOLATIONS:
            self._unconfirmed.remove(mine[0])
        for window in windows:
            self._certain_ns = min(self._certain_ns, window.ends_ns)
        asked = {window.place.node for window in windows if window.can_answer}
        self._to_ask = sorted({*self._to_ask, *asked})
        tally = self._tallies[name]
        if tally.outcome is Outcome.INCONCLUSIVE:
            return []
        item = self.properties[name]
        because = UNCONFIRMED
        if name in self._orders and not places:
            open_ms = -(-self._orders[name].loose_ns // 1_000_000)
            because = TIMES_OPEN.format(duration(open_ms * 1_000_000))
        if other := self._other_time(name):
            because = f"{other}; if as much time passes for it: "
        why = f"{because}{item.text or item.meaning}"
        return self._report(
            name, PropertyVerdict(Status.INCONCLUSIVE, verdict.since_ns, reason=why)
        )

    def _windows(self, waiting: _Unconfirmed) -> list[Stretch]:
        """What may still be missing that would undo it."""
        until_ns = waiting.verdict.since_ns + self._open_times.open_ns(waiting.name)
        found = (self._unreceived.window(place, until_ns, self._now_ns) for place in waiting.places)
        return [window for window in found if window is not None and window.from_ns <= until_ns]

    def _confirmed(self) -> list[Verdict]:
        """Violations of which it is known by now that nothing was missing."""
        found: list[Verdict] = []
        before, self._unconfirmed = self._unconfirmed, []
        self._certain_ns = FOREVER
        for waiting in before:
            windows = self._windows(waiting)
            if windows or self._is_open(waiting, before):
                self._unconfirmed.append(waiting)
                for window in windows:
                    self._certain_ns = min(self._certain_ns, window.ends_ns)
                continue
            if waiting.name in self._orders:
                self._orders[waiting.name].reported += 1
            found += self._report(waiting.name, waiting.verdict)
            standing = self._ordered.verdicts()[waiting.name]
            if standing.status is not Status.FALSE:
                found += self._news(waiting.name, standing)
        return found

    def _drop_explained(self, loss: _Loss) -> list[Verdict]:
        """Something was lost: what that may have been the reason of was no violation."""
        verdicts = self._ordered.verdicts()
        found: list[Verdict] = []
        left = []
        for waiting in self._unconfirmed:
            standing, since_ns = verdicts[waiting.name], waiting.verdict.since_ns
            stands = standing.status is Status.FALSE and standing.since_ns == since_ns
            concerns = self._tallies[waiting.name].concerns(loss.channel)
            if stands or since_ns < loss.start or not concerns:
                left.append(waiting)
            elif standing.status is not Status.FALSE:
                found += self._news(waiting.name, standing)
        self._unconfirmed = left
        return found

    def _report(self, name: str, verdict: PropertyVerdict) -> list[Verdict]:
        tally, outcome = self._tallies[name], OUTCOMES[verdict.status]
        made = verdict_on(self.properties[name], verdict, self._wording)
        tally.outcome = outcome
        if outcome is Outcome.VIOLATED:
            tally.violations += 1
            tally.since = [*tally.since[1 - REMEMBERED :], verdict.since_ns]
        if made.reason:
            tally.last = made.reason
        return [made]

    @property
    def violations(self) -> int:
        """How often a property was broken."""
        return sum(tally.violations for tally in self._tallies.values())

    def statuses(self) -> list[MachineStatus]:
        """Each property as it stands."""
        return [self._status(name) for name in self.properties]

    def standings(self) -> Iterator[tuple[str, str, str, tuple[str, ...]]]:
        """Name, kind and verdict of each property as it is now; no states."""
        for name, tally in self._tallies.items():
            yield name, PROPERTY, str(tally.outcome or UNSEEN), ()

    def report(self, verdict: Verdict) -> Reach:
        """``verdict``, which it found, is reported: to whom."""
        return Reach.PEOPLE

    def _status(self, name: str) -> MachineStatus:
        tally = self._tallies[name]
        outcome, last = tally.outcome, tally.last
        if outcome is None and (missing := sorted(self._waits_for(name))):
            last = f"not found yet: {first_of(missing)}"
        elif outcome is None:
            last = self._ordered.verdicts()[name].reason
        elif outcome is Outcome.CONFORMING and tally.violations:
            outcome = Outcome.VIOLATED
        return MachineStatus(
            name,
            str(outcome) if outcome is not None else UNSEEN,
            (str(self.properties[name].role),),
            tally.received,
            0,
            tally.violations,
            0,
            None,
            last,
            PROPERTY,
        )
