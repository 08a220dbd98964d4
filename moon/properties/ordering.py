"""Properties over observations that arrive late.

Observations are held back until nothing older can come (the latency bound); then they count, in the
order of their stamps.

What is *presumably false* (RV-LTL) is false if nothing is on its way any more that was stamped earlier.
It is never reported. It tells when it is worth asking nodes how far they have reported: what they answer
makes it certain. :class:`Presumption` finds it with a second set of monitors, which is given what was
received so far, in order of stamps; when something comes late, or was lost, it goes back to where the
first set stands.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import msgspec

from moon.feed.held import Held
from moon.properties.monitor import PropertySet, TimeOrderError
from moon.properties.network import NEVER
from moon.properties.predicates import ANY_CHANNEL
from moon.properties.property import Property, Status, Verdict
from transports.interface import Observation

Change = tuple[str, Verdict]


class OrderedProperties:
    """Monitors properties over observations that arrive late.

    Args:
        properties: what to monitor.
        latency_ns: nothing arrives later than this after its stamp.
    """

    def __init__(self, properties: Iterable[Property], latency_ns: int) -> None:
        self._properties = tuple(properties)
        self._set = PropertySet(self._properties)
        self._presumption: Presumption | None = None
        self._channels = self._set.channels()
        self._latency_ns = latency_ns
        self._held: Held[Observation] = Held()
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
        if until_ns <= self._closed_ns:
            return ()
        found: list[Change] = []
        for item in self._held.take(self._held.count(until_ns)):
            found += self._set.observe(item)
        self._closed_ns = until_ns
        found += self._set.advance(until_ns)
        return [change for change in found if self._is_news(*change)]

    def conclude(self, until_ns: int) -> Sequence[tuple[str, Verdict]]:
        """What is false by what was received up to ``until_ns``, whatever else happened since :meth:`seal`.

        Nothing follows: observation has ended, and what was under way is not known.
        """
        if until_ns <= self._closed_ns:
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
        if self._verdicts[name].status is not Status.FALSE:
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
        presumed while something is unknown.
        """
        if self._presumption is None:
            self._presumption = Presumption(self._properties)
        return self._presumption.advance(until_ns, self._set, self._held.observations)

    @property
    def presume_ns(self) -> int:
        """Before this instant :meth:`presume` finds nothing, if nothing is received; 0: not known."""
        if self._presumption is None:
            return 0
        if not (self._presumption.follows or self._set.is_certain):
            return NEVER
        return self._presumption.due_ns

    def presume_nothing(self) -> None:
        """Presume nothing for a while: it costs nothing then."""
        if self._presumption is not None:
            self._presumption.stop()

    def lose(self, channel: str, from_ns: int, until_ns: int) -> Sequence[tuple[str, Verdict]]:
        """Messages of ``channel`` stamped in ``[from_ns, until_ns)`` were lost (:meth:`PropertySet.lose`).

        Raises:
            TimeOrderError: ``until_ns`` is before ``from_ns``, or one of them is no time.
        """
        self.presume_nothing()
        for name, verdict in self._verdicts.items():
            if verdict.final and verdict.since_ns >= from_ns:
                self._verdicts[name] = msgspec.structs.replace(verdict, final=False)
        changes = self._set.lose(channel, from_ns, until_ns)
        found = [change for change in changes if self._is_news(*change)]
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
        return due

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

    def _is_news(self, name: str, verdict: Verdict) -> bool:
        """Whether it differs from what was reported last; it is what was reported last from now on."""
        before = self._verdicts[name]
        if before.final or (verdict.status, verdict.reason) == (before.status, before.reason):
            return False
        self._verdicts[name] = verdict
        return True


def _is_wrong(verdict: Verdict) -> bool:
    return verdict.status is Status.FALSE


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
