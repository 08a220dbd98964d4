"""Verdicts that do not depend on an order that nobody knows.

Stamps come from the clocks of several sources; two observations of different sources whose stamps lie
within the clocks' uncertainty may have happened in either order. Observations are held back until
nothing older can come (the latency bound); those that lie so close together are tried in every order
that the sources allow, from every state that is still possible. A verdict that all of them agree on is
the verdict; where they differ it is inconclusive.

What is *presumably false* (RV-LTL) is false if nothing is on its way any more that was stamped earlier.
It is never reported. It tells when it is worth asking nodes how far they have reported: what they answer
makes it certain. :class:`Presumption` finds it with a second set of monitors, which is given what was
received so far, in order of stamps; when something comes late, or was lost, it goes back to where the
first set stands.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import msgspec

from moon.feed.held import Held
from moon.properties.monitor import PropertySet, TimeOrderError
from moon.properties.monitor_group import Snapshot
from moon.properties.network import NEVER
from moon.properties.predicates import ANY_CHANNEL
from moon.properties.property import Property, Status, Verdict
from transports.interface import Observation

MOST_ORDERS = 120
"""Orders tried of observations that lie together (five that can all be exchanged)."""
MOST_STATES = 16
"""States kept side by side; with more, or more orders, every verdict that is not final stays
inconclusive."""

State = tuple[Snapshot, ...]
Change = tuple[str, Verdict]


class OrderedProperties:
    """Monitors properties over observations that arrive late and in an uncertain order.

    Args:
        properties: what to monitor.
        latency_ns: nothing arrives later than this after its stamp.
        uncertainty_ns: how far stamps of two sources may be wrong against each other; 0: not at all.
    """

    def __init__(
        self, properties: Iterable[Property], latency_ns: int, uncertainty_ns: int = 0
    ) -> None:
        self._properties = tuple(properties)
        self._set = PropertySet(self._properties)
        self._presumption: Presumption | None = None
        self._channels = self._set.channels()
        self._latency_ns = latency_ns
        self._uncertainty_ns = uncertainty_ns
        self._held: Held[Observation] = Held()
        self._states: list[State] | None = None
        """The states that are possible; None while there is one, the set's own."""
        self._gave_up = False
        self._closed_ns = -1
        self._verdicts = self._set.verdicts()

    def observe(self, observation: Observation) -> Sequence[tuple[str, Verdict]]:
        """Take ``observation`` in; it counts once its latency is over (see :meth:`advance`).

        Raises:
            TimeOrderError: it is later than the latency bound allows.
        """
        taken: Any = observation  # its stamp need not be one
        stamp = taken.stamp_ns
        if stamp.__class__ is not int or stamp < 0:
            raise TimeOrderError(f"{stamp!r} is not a stamp in ns")
        if stamp <= self._closed_ns:
            raise TimeOrderError(
                f"an observation of {stamp} ns is too late at {self._closed_ns} ns"
            )
        if observation.channel in self._channels or ANY_CHANNEL in self._channels:
            self._held.add(observation)
            if self._presumption is not None:
                self._presumption.observe(observation)
        return ()

    def advance(self, now_ns: int) -> Sequence[tuple[str, Verdict]]:
        """The time is ``now_ns``: whatever is older than the latency bound counts. Changed verdicts."""
        return self.seal(now_ns - self._latency_ns)

    def seal(self, until_ns: int) -> Sequence[tuple[str, Verdict]]:
        """All that is stamped up to ``until_ns`` was received, or is known to be lost. Changed verdicts."""
        until = until_ns - self._uncertainty_ns
        if until <= self._closed_ns:
            return ()
        ready = self._held.take(self._count(until))
        found: list[Change] = []
        if not self._uncertainty_ns:  # there is one order, and one state
            for item in ready:
                found += [change for change in self._set.observe(item) if self._is_news(*change)]
        else:
            for cluster in _clusters(ready, self._uncertainty_ns):
                found += self._take(cluster)
        # a cluster that has begun keeps time from passing over its first observation
        rest = self._held.stamps
        limit = min(until, rest[0] - self._uncertainty_ns - 1) if rest else until
        if limit > self._closed_ns:
            self._closed_ns = limit
            found += self._each(lambda: self._set.advance(limit))
        return found

    def conclude(self, until_ns: int) -> Sequence[tuple[str, Verdict]]:
        """What is false by what was received up to ``until_ns``, whatever else happened since :meth:`seal`.

        Nothing follows: observation has ended, and what was under way is not known.
        """
        if self._uncertainty_ns or until_ns <= self._closed_ns:
            return ()
        state = self._set.snapshot()
        found: list[Change] = []
        for channel in sorted(self._channels):
            self._set.lose(channel, self._closed_ns + 1, until_ns + 1)
        for item in self._held.take(self._held.count(until_ns)):
            found += self._set.observe(item)
        found += self._set.advance(until_ns)
        self._set.restore(state)
        self._closed_ns = until_ns
        return [change for change in found if _is_wrong(change[1]) and self._is_news(*change)]

    def withstands(self, name: str, losses: Iterable[tuple[str, int, int]]) -> bool:
        """Whether a property that is false now would be so whatever had been lost.

        Args:
            name: of the property.
            losses: channels, and between which stamps (ns) something may have been lost there.
        """
        if self._verdicts[name].status is not Status.FALSE or self._states is not None:
            return False
        state = self._set.snapshot()
        for channel, from_ns, until_ns in losses:
            if from_ns <= self._closed_ns:
                self._set.lose(channel, from_ns, min(until_ns, self._closed_ns + 1))
        still = self._set.verdicts()[name].status is Status.FALSE
        self._set.restore(state)
        return still

    def presume(self, until_ns: int) -> Sequence[tuple[str, Verdict]]:
        """What :meth:`seal` will find false if nothing stamped up to ``until_ns`` is on its way.

        Each is returned once; again, if something came after all that had to be considered. Nothing is
        presumed while something is unknown, or an order may be another.
        """
        if self._uncertainty_ns:
            return ()
        if self._presumption is None:
            self._presumption = Presumption(self._properties)
        return self._presumption.advance(until_ns, self._set, self._held.observations)

    @property
    def presume_ns(self) -> int:
        """Before this instant :meth:`presume` finds nothing, if nothing is received; 0: not known."""
        if self._presumption is None:
            return 0
        if self._uncertainty_ns or not (self._presumption.follows or self._set.is_certain):
            return NEVER
        return self._presumption.due_ns

    def presume_nothing(self) -> None:
        """Presume nothing for a while: it costs nothing then."""
        if self._presumption is not None:
            self._presumption.stop()

    def lose(self, channel: str, from_ns: int, until_ns: int) -> Sequence[tuple[str, Verdict]]:
        """Messages of ``channel`` stamped in ``[from_ns, until_ns)`` were lost (:meth:`PropertySet.lose`).

        What their stamps are worth is what all stamps are: they may have been sent that much earlier or
        later.

        Raises:
            TimeOrderError: ``until_ns`` is before ``from_ns``, or one of them is no time.
        """
        self.presume_nothing()
        reach = self._uncertainty_ns if from_ns < until_ns else 0
        start = max(0, from_ns - reach)
        for name, verdict in self._verdicts.items():
            if verdict.final and verdict.since_ns >= start:
                self._verdicts[name] = msgspec.structs.replace(verdict, final=False)
        found = self._each(lambda: self._set.lose(channel, start, until_ns + reach))
        for name, verdict in self._set.verdicts().items():
            if verdict.final and self._verdicts[name].status is verdict.status:
                self._verdicts[name] = msgspec.structs.replace(self._verdicts[name], final=True)
        return found

    def next_deadline(self) -> int | None:
        """When to call :meth:`advance` next at the latest (ns); None: with the next observation."""
        due = self.due_ns
        return None if due == NEVER else due + self._latency_ns

    @property
    def due_ns(self) -> int:
        """Before this instant (ns), or ``NEVER``, :meth:`seal` changes nothing if nothing is received."""
        own = self._set.next_deadline()
        due = NEVER if own is None else own
        if self._held.stamps:
            due = min(due, self._held.stamps[0])
        return due if due == NEVER else due + self._uncertainty_ns

    @property
    def held(self) -> Sequence[int]:
        """The stamps of what does not count yet (ns), ascending."""
        return self._held.stamps

    def verdicts(self) -> dict[str, Verdict]:
        """The verdict of every property."""
        return dict(self._verdicts)

    def channels(self) -> frozenset[str]:
        """The channels that matter; ``*`` if any may."""
        return self._channels

    def _count(self, until: int) -> int:
        """How many count now: no others may share a cluster with what is to come."""
        stamps = self._held.stamps
        count = self._held.count(until)
        while 0 < count < len(stamps) and stamps[count] - stamps[count - 1] <= self._uncertainty_ns:
            count -= 1
        return count

    def _each(self, *acts: Callable[[], Sequence[Change]]) -> list[Change]:
        """Each of ``acts`` in every possible state; the verdicts that changed by that."""
        if self._states is None and len(acts) == 1:
            return self._agreed([acts[0]()])
        before = self._states if self._states is not None else [self._set.snapshot()]
        after, changes = [], []
        for state in before:
            for act in acts:
                self._set.restore(state)
                changes.append(act())
                after.append(self._set.snapshot())
        self._settle(after)
        return self._agreed(changes)

    def _take(self, cluster: Sequence[Observation]) -> list[Change]:
        orders = [tuple(cluster)]
        if self._uncertainty_ns and len({observation.source for observation in cluster}) > 1:
            orders = []
            for order in _orders(cluster, self._uncertainty_ns):
                if len(orders) == MOST_ORDERS:
                    self._gave_up = True
                    break
                orders.append(order)
        return self._each(*(functools.partial(self._feed, order) for order in orders))

    def _feed(self, order: Sequence[Observation]) -> list[Change]:
        found: list[Change] = []
        stamps = sorted(observation.stamp_ns for observation in order)
        for stamp, observation in zip(stamps, order, strict=True):
            if observation.stamp_ns != stamp:
                fields = {
                    name: getattr(observation, name) for name in observation.__struct_fields__
                }
                observation = Observation(**{**fields, "stamp_ns": stamp})  # noqa: PLW2901
            found += self._set.observe(observation)
        return found

    def _settle(self, states: Sequence[State]) -> None:
        """Keep states that differ; with one left there is no uncertainty any more."""
        kept: list[State] = []
        futures = []
        for state in states:
            future = [group.future for group in state]
            if future not in futures:
                futures.append(future)
                kept.append(state)
        if len(kept) > MOST_STATES:
            self._gave_up = True
            kept = kept[:MOST_STATES]
        self._set.restore(kept[0])
        self._states = kept if len(kept) > 1 else None

    def _agreed(self, branches: Sequence[Sequence[Change]]) -> list[Change]:
        """What to say of the verdicts that changed, in order of time, in each of some futures."""
        if len(branches) == 1 and self._states is None and not self._gave_up:
            return [change for change in branches[0] if self._is_news(*change)]
        now = self._set.verdicts()
        states = self._states if self._states is not None else [self._set.snapshot()]
        standing = [self._verdicts_of(state) for state in states]
        found: list[Change] = []
        for name, verdict in now.items():
            wrong = [
                next((seen for other, seen in branch if other == name and _is_wrong(seen)), None)
                for branch in branches
            ]
            # what was false for a moment only, in all of them or in some
            if wrong[0] is not None and all(wrong) and not self._gave_up:
                found.append((name, wrong[0]))
            elif any(wrong):
                found.append((name, _undecided(verdict)))
            agree = len({verdicts[name].status for verdicts in standing}) == 1 and not self._gave_up
            found.append((name, verdict if agree else _undecided(verdict)))
        return [change for change in found if self._is_news(*change)]

    def _is_news(self, name: str, verdict: Verdict) -> bool:
        """Whether it differs from what was reported last; it is what was reported last from now on."""
        before = self._verdicts[name]
        if before.final or (verdict.status, verdict.reason) == (before.status, before.reason):
            return False
        self._verdicts[name] = verdict
        return True

    def _verdicts_of(self, state: State) -> dict[str, Verdict]:
        names = [name for group in self._set.groups for name in group.names]
        verdicts = [verdict for group in state for verdict in group.verdicts]
        return dict(zip(names, verdicts, strict=True))


def _is_wrong(verdict: Verdict) -> bool:
    return verdict.status is Status.FALSE


def _undecided(verdict: Verdict) -> Verdict:
    reason = "observations may have happened in another order"
    return Verdict(Status.INCONCLUSIVE, verdict.since_ns, reason=reason)


def _clusters(observations: Sequence[Observation], reach: int) -> Iterator[list[Observation]]:
    """Runs of observations (in order of stamps) that lie within ``reach`` of their neighbours."""
    cluster: list[Observation] = []
    for observation in observations:
        if cluster and observation.stamp_ns - cluster[-1].stamp_ns > reach:
            yield cluster
            cluster = []
        cluster.append(observation)
    if cluster:
        yield cluster


def _orders(cluster: Sequence[Observation], reach: int) -> Iterator[tuple[Observation, ...]]:
    """Every order that keeps each source's own, and that of stamps further apart than ``reach``."""
    if not cluster:
        yield ()
        return
    for place, first in enumerate(cluster):
        # only what may come before everything that stands before it
        if all(
            other.source != first.source and first.stamp_ns - other.stamp_ns <= reach
            for other in cluster[:place]
        ):
            rest = [*cluster[:place], *cluster[place + 1 :]]
            for order in _orders(rest, reach):
                yield (first, *order)


class Presumption:
    """What is presumably false: monitors ahead of a set of monitors.

    Args:
        properties: those of the set.
    """

    def __init__(self, properties: Iterable[Property]) -> None:
        self._set = PropertySet(properties)
        self._waiting: Held[Observation] = Held()
        self._reached_ns = -1
        self._follows = False
        """Whether the monitors stand where the others will."""

    def observe(self, seen: Observation) -> None:
        """``seen`` was received."""
        if not self._follows:
            return
        if seen.stamp_ns <= self._reached_ns:
            self.stop()
        else:
            self._waiting.add(seen)

    def stop(self) -> None:
        """What was received is not all: look at the first set again before anything is presumed."""
        self._follows = False
        self._waiting.clear()

    @property
    def follows(self) -> bool:
        """Whether it runs ahead; else it begins when all that is behind is certain."""
        return self._follows

    @property
    def due_ns(self) -> int:
        """Before this instant :meth:`advance` finds nothing, if nothing is received; 0: not known."""
        if not self._follows:
            return 0
        own = self._set.next_deadline()
        due_ns = NEVER if own is None else own
        stamps = self._waiting.stamps
        return min(due_ns, stamps[0]) if stamps else due_ns

    def advance(
        self, until_ns: int, behind: PropertySet, held: Sequence[Observation]
    ) -> list[tuple[str, Verdict]]:
        """Take what was stamped up to ``until_ns`` for complete; what becomes false by that.

        Args:
            until_ns: the instant.
            behind: the monitors whose verdicts are certain; how far they are, is where to begin.
            held: what was received that they do not know yet.
        """
        if not self._follows:
            if not behind.is_certain:
                return []
            self._set.restore(behind.snapshot())
            self._set.listen_as(behind)
            self._reached_ns = behind.sealed_ns
            self._waiting = Held(held)
            self._follows = True
        if until_ns <= self._reached_ns:
            return []
        self._reached_ns = until_ns
        changes: list[tuple[str, Verdict]] = []
        for seen in self._waiting.take(self._waiting.count(until_ns)):
            changes += self._set.observe(seen)
        changes += self._set.advance(until_ns)
        return [change for change in changes if change[1].status is Status.FALSE]
