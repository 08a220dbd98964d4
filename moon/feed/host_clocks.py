"""Whether clocks of other hosts agree with the monitor's: one that is set shows in the lags of its nodes.

The lag of a report is the time from its stamp to its reception. When the clock of a node's host is set, the
lags of all that the node reports change by as much, at once, and stay so. What comes before it was sent is
certain. What comes later than ever is a doubt: a network may be slow for a while, a node may hold its reports
back. So the node is asked: its answer is stamped between the question and its reception, or its clock is
another (as in NTP, RFC 5905, 10). On a busy host all that a node reports is late, and its answers are, too:
one that answers is asked again until it does. Of one that never answers, lags that all rose by the same tell.

What a node sends on topics leaves at once. What it did in calls it reports in bursts
(``transports.outbox``). Each of the two has its usual lags.

A clock that was set is not relied on until what its node reports comes as before.

Two nodes may have clocks that differ and never were set while anybody looked. Their calls tell: what one
received, by its clock, before the other had sent it.
"""

from __future__ import annotations

from collections.abc import Iterable

from moon.feed.clock import NS, PERIOD_NS, SET_NS
from transports.bounded import BoundedDict
from transports.interface import Observation, ObservationKind
from transports.outbox import SELDOM_S

KEPT_LAGS = 32
"""The lags of so many reports, and of up to as many before them, say what is usual of a node."""
FEW_LAGS = 4
"""So many that are usual, one after the other, end a doubt."""
MANY_LAGS = 2 * FEW_LAGS
"""So many, one after the other, tell that it is so from now on."""
MOST_NODES = 1000
"""Nodes that are followed; their names come from the wire, and never end."""
KEPT_ENDS = 1000
"""Calls and messages of which one end waits for the report of another."""
HELD_NS = round(SELDOM_S * NS)
"""So long a node holds back what it did in calls, at most (ns)."""
_RECEIVED = {
    ObservationKind.MESSAGE: ObservationKind.MESSAGE_TAKEN,
    ObservationKind.REQUEST_SENT: ObservationKind.REQUEST_RECEIVED,
    ObservationKind.RESPONSE_SENT: ObservationKind.RESPONSE_RECEIVED,
}
"""For each kind of what is sent: as what who receives it reports it."""
_LEAST, _MOST = -(1 << 62), 1 << 62


class UsualLags:
    """The lags that are usual of what a node sends at once, or of what it holds back.

    Attributes:
        least, most: of them (ns).
        is_known: whether there are any: what comes much later than the first report is a doubt.
    """

    def __init__(self) -> None:
        self.is_known = False
        self.least, self.most = _MOST, _LEAST
        self._least, self._most, self._count = _MOST, _LEAST, 0

    def note(self, lag_ns: int) -> None:
        """So late a report may come: as what is usual."""
        if self._count == KEPT_LAGS:
            self.least, self.most = self._least, self._most
            self._least, self._most, self._count = _MOST, _LEAST, 0
        self._count += 1
        self.is_known = True
        if lag_ns < self._least:
            self._least = lag_ns
            self.least = min(lag_ns, self.least)
        if lag_ns > self._most:
            self._most = lag_ns
            self.most = max(lag_ns, self.most)

    @property
    def middle_ns(self) -> int:
        """Between the least and the most; 0 if none is known."""
        return (self.least + self.most) // 2 if self.is_known else 0


class HostClock:
    """The clock of one node's host, as its reports show it.

    Attributes:
        differs: whether it does from the monitor's, by more than delays can be mistaken for.
        at_once, held: the usual lags of what the node sends at once, and of what it holds back.
        unusual: the lags of the last reports, of which none was usual (ns), and what would have been.
        open: so many more reports have to be usual before a doubt about the clock ends; 0: there is none.
        since_ns: when the first of ``unusual`` was received (ns).
        asked_ns: when it was asked last (ns).
        until_ns: a doubt ends then (ns), even if nothing more is received.
        slow: so many reports in a row lagged more than the fastest of the last ones, by more than clocks may
            differ. A slow clock makes each lag longer; the monitor doubts it until a lag is shorter.
        usual_ns: when a report was last received as usual (ns).
        went_back_ns: when its stamps were last found to go back (ns).
        answers: whether the node says what its clock shows when it is asked: it has, or it numbers all that
            it reports.
        agreed: so many reports were usual, one after the other, since it differs.
        agreed_ns: when the first of those was received (ns).
        is_confirmed: whether it answered since then that its clock agrees.
    """

    def __init__(self) -> None:
        self.usual_ns = self.went_back_ns = self.set_ns = 0
        self.since_ns = self.until_ns = self.asked_ns = self.open = self.slow = 0
        self.at_once, self.held = UsualLags(), UsualLags()
        self.unusual: list[tuple[int, UsualLags]] = []
        self.differs = self.answers = False
        self.agreed = self.agreed_ns = 0
        self.is_confirmed = False

    def usual(self, is_held: bool) -> UsualLags:
        """The lags that are usual of such a report; of the others while none is known."""
        own, other = (self.held, self.at_once) if is_held else (self.at_once, self.held)
        return other if other.is_known and not own.is_known else own

    def most_ns(self, is_held: bool) -> int:
        """The lag that such a report has at most (ns), if nothing is the matter and some are known."""
        usual = self.usual(is_held)
        return usual.most + (HELD_NS if is_held and usual is self.at_once else 0)

    def note(self, lag_ns: int, is_held: bool) -> None:
        """So late a report may come: as what is usual."""
        (self.held if is_held else self.at_once).note(lag_ns)

    @property
    def has_moved(self) -> bool:
        """Whether many lags rose by more than they differ among them: those of a busy monitor do not."""
        if len(self.unusual) < KEPT_LAGS:
            return False
        rose = [lag_ns - usual.most for lag_ns, usual in self.unusual]
        return max(rose) - min(rose) < min(rose)

    @property
    def is_as_wide(self) -> bool:
        """Whether many unusual lags differ no more than the usual ones: those of a slow network, or of a host
        that is busy for a moment, do.
        """
        if len(self.unusual) < KEPT_LAGS:
            return False
        rose = [lag_ns - usual.least for lag_ns, usual in self.unusual]
        widest_ns = max(usual.most - usual.least for _, usual in self.unusual)
        return max(rose) - min(rose) <= widest_ns + SET_NS

    def set_by(self, lag_ns: int, usual_ns: int) -> int:
        """The clock differs, as a report shows by its lag: by how much it was set (ns)."""
        self.unusual.clear()
        self.open = self.agreed = 0
        self.is_confirmed = False
        self.differs, self.set_ns = True, usual_ns - lag_ns
        return self.set_ns or 1

    def agrees(self) -> int:
        """It agrees again: by how much it was set (ns)."""
        self.differs, self.agreed = False, 0
        return -self.set_ns or 1


class HostClocks:
    """The clocks of all nodes' hosts.

    Args:
        latency_ns: nothing is received later than this after it was sent.
        differ_ns: clocks differ by at most this.

    Attributes:
        now_ns: time has passed up to then.
        differ_ns: as above.
        are_own: whether each host stamps by a clock of its own; else by a hybrid logical clock nothing is
            received before it is sent.
        are_told: whether nodes say by which clock they stamp (``TellsClocks.clock_of``).
    """

    def __init__(self, latency_ns: int, differ_ns: int = 0) -> None:
        self.now_ns = 0
        self.differ_ns = differ_ns
        self.are_own = self.are_told = False
        self._latency_ns = latency_ns
        self._known: dict[str, HostClock] = {}
        self._to_ask: dict[str, None] = {}
        self._sent: BoundedDict[tuple[object, ...], tuple[str, int]] = BoundedDict(KEPT_ENDS)
        """Who sent what, and when by its clock (ns)."""
        self._had: BoundedDict[tuple[object, ...], tuple[str, int]] = BoundedDict(KEPT_ENDS)
        """Who received it last, likewise."""
        self._crossed: BoundedDict[tuple[str, str], int] = BoundedDict(MOST_NODES)
        """Of a sender and a receiver: how many messages in a row have a stamp of reception before that of
        sending. While a pair is kept here, both clocks are in doubt.
        """

    def _of(self, node: str) -> HostClock | None:
        clock = self._known.get(node)
        if clock is None and len(self._known) < MOST_NODES:
            clock = self._known[node] = HostClock()
        return clock

    def heard(
        self,
        node: str,
        stamp_ns: int,
        now_ns: int,
        is_held: bool = False,
        is_numbered: bool = False,
    ) -> int:
        """Something of ``node``, stamped ``stamp_ns`` by its clock, is received at ``now_ns``.

        Args:
            node: its name.
            stamp_ns: ns since the epoch.
            now_ns: ns since the epoch.
            is_held: nodes hold such reports back (``HELD_NS``).
            is_numbered: the node numbers all that it reports; such a node answers.

        Returns:
            By how much its clock was set (ns); 0: it was not, as far as is known.
        """
        clock = self._of(node)
        if clock is None:
            return 0
        if is_numbered:
            clock.answers = True
        if now_ns > self.now_ns:
            self.now_ns = now_ns
        lag_ns = now_ns - stamp_ns
        is_early = lag_ns < -self.differ_ns
        usual = clock.usual(is_held)
        is_late = usual.is_known and lag_ns > clock.most_ns(is_held) + PERIOD_NS
        if clock.differs:
            return self._may_agree(node, clock, not (is_early or is_late), now_ns)
        if is_early:
            return clock.set_by(lag_ns, usual.middle_ns)
        if is_late:
            return self._late(node, clock, lag_ns, usual, now_ns)
        clock.usual_ns = now_ns
        if clock.open:
            clock.open -= 1
            clock.unusual.clear()
        if self.are_own:
            clock.slow = clock.slow + 1 if lag_ns > usual.least + self.differ_ns else 0
        clock.note(lag_ns, is_held)
        return 0

    def crossed(self, seen: Observation) -> tuple[str, str, int] | None:
        """``seen`` may be what another node received of what one sent, or what it sent.

        Returns:
            Who sent it, who received it, and how long before it was sent by their clocks (ns), if that shows
            now that these differ.
        """
        if not self.are_own:
            return None
        received = _RECEIVED.get(seen.kind)
        if seen.kind is ObservationKind.MESSAGE:
            place = (received, seen.channel, seen.source, seen.sequence, seen.life)
        else:
            place = (received or seen.kind, seen.channel, seen.client, seen.call, seen.client_life)
        here = (seen.source, seen.stamp_ns)
        ends, others = (self._sent, self._had) if received else (self._had, self._sent)
        ends[place] = here
        other = others.get(place)
        if other is None:
            return None
        (sender, sent_ns), (receiver, received_ns) = (here, other) if received else (other, here)
        return self._compare(sender, receiver, sent_ns - received_ns)

    def _compare(self, sender: str, receiver: str, before_ns: int) -> tuple[str, str, int] | None:
        pair = sender, receiver
        if not sender or not receiver or sender == receiver:
            return None
        if before_ns <= self.differ_ns:
            self._crossed.pop(pair, None)
            return None
        count = self._crossed[pair] = self._crossed.get(pair, 0) + 1
        if count < FEW_LAGS:
            return None
        clocks = [clock for clock in map(self._of, pair) if clock is not None]
        for clock, set_ns in zip(clocks, (before_ns, -before_ns), strict=False):
            clock.agreed = 0
            if not clock.differs:
                clock.differs, clock.set_ns = True, set_ns
                # what was usual may be so of a clock that is wrong
                clock.at_once, clock.held = UsualLags(), UsualLags()
        return (sender, receiver, before_ns) if count == FEW_LAGS else None

    def _may_agree(self, node: str, clock: HostClock, is_usual: bool, now_ns: int) -> int:
        """A report of a clock that differs: as usual, or not."""
        if not is_usual:
            clock.agreed, clock.is_confirmed = 0, False
            return 0
        if not clock.agreed:
            clock.agreed_ns = now_ns
        clock.agreed += 1
        if clock.agreed < MANY_LAGS or now_ns <= clock.agreed_ns + self._latency_ns:
            return 0
        if any(node in pair and count >= FEW_LAGS for pair, count in self._crossed.items()):
            return 0
        if clock.answers and not clock.is_confirmed:
            self._to_ask[node] = None
            return 0
        return clock.agrees()

    def _late(self, node: str, clock: HostClock, lag_ns: int, usual: UsualLags, now_ns: int) -> int:
        if not clock.unusual:
            clock.since_ns = now_ns
        if not clock.unusual or now_ns > clock.asked_ns + self._latency_ns:
            clock.asked_ns = now_ns
            self._to_ask[node] = None
        clock.open = FEW_LAGS
        clock.until_ns = now_ns + lag_ns + self._latency_ns
        # what a slow link held up comes at once when it goes on
        is_over = now_ns > clock.since_ns + self._latency_ns
        goes_on = now_ns - lag_ns > clock.since_ns or is_over
        clock.unusual.append((lag_ns, usual))
        del clock.unusual[:-KEPT_LAGS]
        if len(clock.unusual) < MANY_LAGS or not goes_on or clock.answers:
            return 0
        least_ns, usual = min(clock.unusual, key=lambda item: item[0])
        is_far = least_ns > self._latency_ns // 2
        if clock.has_moved or (self._is_alone(clock) and (is_far or clock.is_as_wide)):
            return clock.set_by(least_ns, usual.middle_ns)
        return 0

    def _is_alone(self, clock: HostClock) -> bool:
        """Whether another node was heard as usual since this one was not."""
        return any(other.usual_ns > clock.since_ns for other in self._known.values())

    def answered(self, node: str, asked_ns: int, stamp_ns: int, now_ns: int) -> int:
        """``node``, asked at ``asked_ns``, answers that its clock shows ``stamp_ns``; received at ``now_ns``.

        Returns:
            By how much its clock was set (ns); 0: it was not, as far as is known.
        """
        clock = self._of(node)
        if clock is None:
            return 0
        clock.answers = True
        if asked_ns - self.differ_ns <= stamp_ns <= now_ns + self.differ_ns:
            clock.is_confirmed = True
            for lag_ns, usual in clock.unusual:
                usual.note(lag_ns)
            clock.unusual.clear()
            if not clock.differs:
                clock.open = 0
            return 0
        if clock.differs:
            clock.agreed = 0
            return 0
        return clock.set_by(now_ns - stamp_ns, clock.usual(False).middle_ns)

    def take_questions(self) -> list[str]:
        """The nodes to be asked now what their clocks show."""
        names = list(self._to_ask)
        self._to_ask.clear()
        return names

    def went_back(self, node: str, lag_ns: int) -> bool:
        """The stamps of ``node`` went back, against the numbers of what it sent: whether that is news.

        Args:
            node: its name.
            lag_ns: how long after its stamp the last one was received; where that is late, too, it is so as
                the clock differs now.
        """
        clock = self._known.get(node)
        if clock is None or clock.differs or self._went_back_lately(clock):
            return False
        clock.went_back_ns = self.now_ns
        if clock.unusual or lag_ns > self._latency_ns:
            clock.set_by(lag_ns, clock.usual(False).middle_ns)
        else:
            clock.open, clock.until_ns = FEW_LAGS, self.now_ns + self._latency_ns
        return True

    def _went_back_lately(self, clock: HostClock) -> bool:
        """Whether what its other channels show now is of the same time that it was set."""
        return self.now_ns - clock.went_back_ns < 5 * self._latency_ns

    def differs(self, node: str) -> bool:
        """Whether the clock of ``node`` is known to differ from the monitor's."""
        clock = self._known.get(node)
        return clock is not None and clock.differs

    def doubtful(self, nodes: Iterable[str]) -> set[str]:
        """Those of ``nodes`` whose clocks differ from the monitor's, or perhaps do since a short time."""
        crossed = {node for pair in self._crossed for node in pair}
        clocks = ((node, self._known.get(node)) for node in nodes)
        return {
            node
            for node, clock in clocks
            if node in crossed or (clock is not None and self._is_doubtful(clock))
        }

    def _is_doubtful(self, clock: HostClock) -> bool:
        if clock.differs or clock.slow >= FEW_LAGS:
            return True
        return clock.open > 0 and self.now_ns <= clock.until_ns

    def left(self, node: str) -> None:
        """``node`` has gone away: what others sent it, or had of it, is compared no more."""
        for pair in [pair for pair in self._crossed if node in pair]:
            del self._crossed[pair]

    def restart(self) -> None:
        """The monitor stood still: what comes now is late for that."""
        self._known.clear()
        self._crossed.clear()
        self._sent.clear()
        self._had.clear()
        self._to_ask.clear()

    def clock_set(self) -> None:
        """The monitor's own clock was set: what differs by as much now is of other hosts."""
        self.now_ns = 0
        for clock in self._known.values():
            clock.unusual.clear()
            clock.open = clock.agreed = 0
            clock.usual_ns = clock.went_back_ns = clock.asked_ns = 0
