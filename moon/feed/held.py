"""Observations that do not count yet, in order of their stamps."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable
from typing import Generic, Protocol, TypeVar


class Stamped(Protocol):
    """An observation, or what somebody makes of one."""

    @property
    def stamp_ns(self) -> int:
        """When it happened, ns since the epoch."""
        ...


T = TypeVar("T", bound=Stamped)


class Held(Generic[T]):
    """Keeps observations in order of their stamps, and those of one stamp as they were added.

    To add one that is not older than all others takes the same time however many there are, as does to look
    at the first: at saturation a monitor holds hundreds, and is asked a hundred times a second.

    Args:
        observations: what is held from the beginning, in any order.
    """

    __slots__ = ("observations", "stamps")

    def __init__(self, observations: Iterable[T] = ()) -> None:
        self.stamps: list[int] = []
        """Of each (ns), ascending; to be read only."""
        self.observations: list[T] = []
        """In the order of their stamps; to be read only."""
        for observation in observations:
            self.add(observation)

    def add(self, observation: T) -> None:
        """Hold ``observation``."""
        stamp = observation.stamp_ns
        if not self.stamps or stamp >= self.stamps[-1]:
            self.stamps.append(stamp)
            self.observations.append(observation)
            return
        place = bisect_right(self.stamps, stamp)
        self.stamps.insert(place, stamp)
        self.observations.insert(place, observation)

    def remove(self, observation: T) -> None:
        """``observation``, which is held, is not held any more."""
        place = self.observations.index(observation)
        del self.observations[place], self.stamps[place]

    def count(self, until_ns: int) -> int:
        """How many are stamped up to ``until_ns``."""
        return bisect_right(self.stamps, until_ns)

    def take(self, count: int) -> list[T]:
        """The first ``count``, which are not held any more."""
        taken = self.observations[:count]
        if taken:
            del self.observations[:count], self.stamps[:count]
        return taken

    def clear(self) -> None:
        """Hold nothing any more."""
        self.observations.clear()
        self.stamps.clear()
