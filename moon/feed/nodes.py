"""How far all nodes of a system have reported, and so up to when a judge of several of them knows all."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from moon.feed.host_clocks import HostClocks
from moon.feed.lives import ANOTHER, PAST, Lives
from moon.feed.numbers import goes_on
from moon.feed.progress import Progress
from moon.feed.reachability import Reachability
from moon.judge import Gap, Missing
from transports.bounded import BoundedDict
from transports.interface import Answer, Observation

KEPT_SOURCES = 10_000
"""Nodes that are remembered; their names come from the wire, and never end."""


LEASE_NS = 20_000_000_000
"""A node that cannot be reached is missed within this time (Zenoh's lease is 10 s, DDS's 20 s)."""

UNHEARD_NS = 1_000_000_000
"""A node that has gone, and of which nothing is known for so long before that, may only be out of reach.

A node that ends is missed at once. One that is cut off is missed after the middleware's lease, and was not
heard meanwhile; leases are longer than this (Zenoh's is 10 s, DDS's 20 s).
"""


class Node:
    """One node, as far as it was received.

    Attributes:
        progress: by the numbers of its reports.
        lives: of which life they are.
        is_numbered: whether it numbers all that it reports, as far as is known.
        is_up: whether it is there; None: only its observations say so.
        since_ns: since when it is there (ns), or when it went away; 0: that is not known.
        answers: whether it has answered how far it has reported.
        anew_ns: it numbers anew since then (ns); what it did last before that may be missing.
        is_out_of_reach: whether it has gone, and may do something all the same.
        met_ns: what was first received of it happened then (ns), and was not the first that it did, though
            nobody had said yet that it is there; 0: that was not so.
    """

    def __init__(self) -> None:
        self.progress = Progress()
        self.lives = Lives()
        self.is_numbered = True
        self.is_up: bool | None = None
        self.since_ns = 0
        self.answers = False
        self.anew_ns = 0
        self.is_out_of_reach = False
        self.met_ns = 0


class Nodes:
    """The nodes of one system.

    Args:
        latency_ns: nothing is received later than this after its stamp.
        differ_ns: clocks differ by at most this.
    """

    def __init__(self, latency_ns: int, differ_ns: int = 0) -> None:
        self._latency_ns = latency_ns
        self.clocks = HostClocks(latency_ns, differ_ns)
        self.reachability = Reachability(latency_ns)
        self.known: BoundedDict[str, Node] = BoundedDict(KEPT_SOURCES)
        """By name."""
        self.listening_ns = 0
        """Since when all is received that there is (ns); 0: that is not known."""
        self.are_found = False
        """Whether somebody says which of them are there."""
        self.are_asked = False
        """Whether one of them has answered: here they can be asked."""

    def _of(self, name: str) -> Node:
        source = self.known.get(name)
        if source is None:
            source = self.known[name] = Node()
        return source

    def take(self, seen: Observation, now_ns: int, is_timed: bool = True) -> Gap | None:
        """``seen`` was received at ``now_ns``; what is missing before it, if that is certain by now.

        Args:
            seen: what was received.
            now_ns: when.
            is_timed: whether its stamp tells when it happened; else its number counts, and no more.
        """
        source = self.known.get(seen.source) or self._of(seen.source)
        progress, order = source.progress, seen.order
        stamp = seen.stamp_ns if is_timed else progress.reported_ns
        if seen.life != source.lives.present:
            # by its own clock, as when it started is
            which = source.lives.see(seen.life, seen.stamp_ns)
            if which == PAST:
                return None
            if which == ANOTHER:
                progress.restart()
                source.anew_ns = stamp
        if order == progress.next and not progress.ahead and progress.answer is None:
            progress.next, progress.reported_ns = order + 1, stamp
            return None
        if order < 0:
            source.is_numbered = False
            return None
        source.is_numbered = True
        if not seen.life and order < progress.next and stamp > progress.reported_ns:
            progress.restart()  # it has started again, and numbers anew; who names its life does not
            source.anew_ns = stamp
        if source.is_up is None and not (progress.reported_ns or progress.ahead):
            source.met_ns = stamp
        before = progress.reported_ns, progress.gap
        progress.take(order, stamp, now_ns - self._latency_ns)
        return self._gap_of(seen.source, source, before)

    def advance(self, now_ns: int) -> Iterator[Gap]:
        """What was not received up to now (ns) and does not come any more."""
        watermark = now_ns - self._latency_ns
        self.clocks.now_ns = max(self.clocks.now_ns, now_ns)
        for name, source in self.known.items():
            if source.progress.ahead or source.progress.answer is not None:
                before = source.progress.reported_ns, source.progress.gap
                source.progress.advance(watermark)
                gap = self._gap_of(name, source, before)
                if gap is not None:
                    yield gap

    def is_past(self, name: str, answer: Answer) -> bool:
        """Whether ``answer`` is of an earlier life of ``name``: of the present one it tells nothing."""
        source = self.known.get(name)
        return source is not None and source.lives.is_over(answer.life, answer.stamp_ns)

    def answered(self, name: str, number: int, stamp_ns: int) -> None:
        """``name`` says that all that it did until ``stamp_ns`` has a number below ``number``."""
        source = self._of(name)
        source.answers = self.are_asked = True
        source.progress.answered(number, stamp_ns)

    def to_ask(self) -> list[str]:
        """The nodes that are there and say how far they have reported, as far as is known."""
        return [
            name
            for name, source in self.known.items()
            if source.is_up and source.is_numbered and (source.answers or self.are_asked)
        ]

    def may_be_there(self, name: str) -> bool:
        """Whether ``name`` was received, and is not known to have gone."""
        source = self.known.get(name)
        return source is not None and source.is_up is not False

    def are_next(self, seen: Iterable[Observation], answers: Mapping[str, Answer]) -> bool:
        """Whether the order numbers of these observations follow those of before, and each other, without a
        gap, and no node says that it has reported more.
        """
        orders: dict[str, set[int]] = {name: set() for name in answers}
        for one in seen:
            source = self.known.get(one.source)
            if one.order < 0:
                continue
            if source is None or one.life != source.lives.present:
                return False
            orders.setdefault(one.source, set()).add(one.order)
        for name, found in orders.items():
            source = self.known.get(name)
            if source is None:
                return False
            after = goes_on(found.union(source.progress.ahead), source.progress.next)
            answer = answers.get(name)
            if after is None or (
                answer is not None and (self.is_past(name, answer) or answer.next_order > after)
            ):
                return False
        return True

    def take_findings(self, now_ns: int) -> list[str]:
        """What was found of the links of this monitor up to now (ns), one sentence each.

        Who stamps by a clock that differs may seem to come late.
        """
        return [
            f"what {name} reported came up to {lag_ns / 1e9:.1f} s late: the link between it and this "
            "monitor was down or slow, or its host was busy"
            for name, lag_ns in self.reachability.take_late(now_ns).items()
            if not self.clocks.differs(name)
        ]

    def changed(self, name: str, is_up: bool, when_ns: int) -> None:
        """``name`` came up, having begun to connect at ``when_ns``, or went away then."""
        source = self._of(name)
        if is_up:
            source.lives.start(when_ns)
        else:
            self.clocks.left(name)
        if is_up and source.progress.reported_ns < when_ns:
            source.anew_ns = when_ns if source.progress.reported_ns else 0
            source.progress.restart()  # it numbers anew
        source.is_up, source.since_ns = is_up, when_ns
        is_unheard = source.progress.reported_ns < when_ns - UNHEARD_NS
        source.is_out_of_reach = not is_up and is_unheard and self.is_answering(source)

    def up_since(self, name: str) -> int:
        """When ``name`` began to connect (ns); 0: that is not known, or it is not there."""
        source = self.known.get(name)
        return source.since_ns if source is not None and source.is_up else 0

    def restart(self) -> None:
        """Nothing is known any more of what any of them reported."""
        for source in self.known.values():
            source.progress.restart()

    def clock_set(self, now_ns: int, since_ns: int) -> None:
        """The monitor's clock was set, and is ``now_ns``: numbers go on, and times before ``since_ns`` are
        not compared with those after it.
        """
        for source in self.known.values():
            progress, following = source.progress, source.progress.next
            source.progress = Progress()
            if progress.reported_ns and not progress.ahead:
                source.progress.next, source.progress.reported_ns = following, since_ns - 1
            source.anew_ns = 0
            source.since_ns = min(source.since_ns, now_ns - 1)
        self.reachability.clear()

    def known_ns(self, names: Iterable[str], now_ns: int) -> int:
        """All that ``names`` did until then (ns) was received, by their numbers; 0: numbers do not show it.

        A node that was never there does nothing; one that has ended has done nothing since, which is certain
        when the latency bound is over.
        """
        known_ns = now_ns
        is_any = False
        for name in names:
            source = self.known.get(name)
            if source is None or self.is_over(source, now_ns):
                continue
            if not source.is_numbered:
                return 0
            is_any = True
            reported_ns = source.progress.reported_ns
            if reported_ns < known_ns:
                known_ns = reported_ns
        return known_ns if is_any else 0

    def is_numbered(self, name: str) -> bool:
        """Whether the node ``name`` numbers all that it reports, in this life or the one before."""
        source = self.known.get(name)
        return source is not None and source.is_numbered

    def is_announced(self, name: str) -> bool:
        """Whether the node ``name`` has said that it is there, now or before."""
        source = self.known.get(name)
        return source is not None and source.is_up is not None

    def is_answering(self, source: Node) -> bool:
        """Whether it numbers all that it reports, and says how far it is when it is asked."""
        return source.answers and source.is_numbered

    def is_reached(self, name: str, since_ns: int, now_ns: int) -> bool:
        """Whether the network between ``name`` and this monitor is whole, by what came since then (ns).

        It was heard in time, or is still there when it would have been missed.
        """
        if self.reachability.reached_ns((name,), since_ns) is not None:
            return True
        source = self.known.get(name)
        return now_ns > since_ns + LEASE_NS and source is not None and source.is_up is not False

    def missing_between(self, name: str, since_ns: int, until_ns: int) -> list[tuple[int, int]]:
        """Something that ``name`` did between these stamps is missing: after when and before when it may have
        happened (ns).
        """
        source = self.known.get(name)
        if source is None or not source.is_numbered or source.anew_ns >= until_ns:
            return [(since_ns, until_ns)]
        # the last of its life before may be missing; those of this one are numbered
        began_ns = max(since_ns, source.anew_ns - 1)
        before = [(since_ns, began_ns + 1)] if began_ns > since_ns else []
        return before + source.progress.missing(began_ns, until_ns)

    def is_whole(self, name: str, since_ns: int, until_ns: int) -> bool:
        """Whether all that ``name`` did from ``since_ns`` to ``until_ns`` was received, by its numbers."""
        source = self.known.get(name)
        if source is None or not source.is_numbered:
            return False
        progress = source.progress
        return max(progress.gap, source.anew_ns) <= since_ns and progress.reported_ns > until_ns

    def behind(self, names: Iterable[str], until_ns: int, now_ns: int) -> list[str]:
        """Those of ``names`` of which it is not known what they did until ``until_ns``, and who can say so.

        Empty, too, where one of them does not number what it reports, or cannot be reached: then it does not
        help to ask others.
        """
        found = []
        for name in names:
            source = self.known.get(name)
            if source is None or self.is_over(source, now_ns):
                continue
            if not source.is_numbered or source.is_out_of_reach:
                return []
            if source.progress.reported_ns < until_ns:
                found.append(name)
        return found

    def _gap_of(self, name: str, source: Node, before: tuple[int, int]) -> Gap | None:
        """What is missing of what ``name`` reported, if that was found since it was as ``before``.

        Of one that was there before all was received, the first number tells nothing.
        """
        reported_ns, gap_ns = before
        progress = source.progress
        if progress.gap == gap_ns:
            return None
        from_ns = reported_ns + 1
        if not reported_ns:
            if not source.is_up or not 0 < self.listening_ns <= source.since_ns:
                return None
            from_ns = source.since_ns
        why = f"observations of {name} were lost"
        return Gap("", name, from_ns, progress.gap + 1, why, cause=Missing.NUMBERED)

    def missed_ns(self, name: str, source: Node) -> int | None:
        """When ``name`` went away (ns), if it was not heard for long before: it may be out of reach."""
        if source.is_up is not False:
            return None
        is_unheard = self.reachability.heard_ns(name) < source.since_ns - UNHEARD_NS
        return source.since_ns if is_unheard else None

    def is_over(self, source: Node, now_ns: int) -> bool:
        """Whether it has ended, and all that it did was received, or is lost."""
        is_gone = source.is_up is False and source.since_ns < now_ns - self._latency_ns
        return is_gone and not source.is_out_of_reach
