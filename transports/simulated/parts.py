"""What the parts of a simulated world ask of it and of its nodes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from enum import IntEnum
from typing import Any, Protocol

from transports.refusals import Refusals
from transports.simulated.clocks import Clocks
from transports.simulated.conditions import Conditions
from transports.simulated.network import Link, Network

Event = Callable[[Any], None]


class Rank(IntEnum):
    """What happens first of all that is due at one time, in a world that ranks it."""

    MESSAGE = 0
    STEP = 1
    TIMER = 2


class World(Protocol):
    """See :class:`transports.simulated.world.SimulatedWorld`."""

    conditions: Conditions
    network: Network
    clocks: Clocks
    now_ns: int
    running: str | None

    @property
    def nodes(self) -> Mapping[str, Node]:
        """The nodes that are there, by name."""
        ...

    def stamp_of(self, node: str) -> int:
        """See ``SimulatedWorld.stamp_of``."""
        ...

    def true_stamp(self) -> int:
        """See ``SimulatedWorld.true_stamp``."""
        ...

    def schedule(
        self, delay_ns: int, event: Event, argument: Any, rank: Rank = Rank.MESSAGE
    ) -> None:
        """See ``SimulatedWorld.schedule``."""
        ...

    def next_order(self) -> int:
        """See ``SimulatedWorld.next_order``."""
        ...

    def schedule_at(self, due_ns: int, order: int, event: Event, argument: Any) -> None:
        """See ``SimulatedWorld.schedule_at``."""
        ...

    def enter(self, event: Event, argument: Any) -> None:
        """See ``SimulatedWorld.enter``."""
        ...

    def send(
        self,
        link: Link,
        event: Event,
        argument: Any,
        behind: Iterable[Link] = (),
        is_lossy: bool = False,
    ) -> None:
        """See ``SimulatedWorld.send``."""
        ...

    def send_to_tap(self, link: Link, event: Event, argument: Any) -> None:
        """See ``SimulatedWorld.send_to_tap``."""
        ...

    def run(self, until: Callable[[], object], deadline_ns: int) -> bool:
        """See ``SimulatedWorld.run``."""
        ...


class Node(Protocol):
    """See :class:`transports.simulated.world.SimulatedTransport`."""

    alive: bool
    connected_ns: int
    since_ns: int
    life: int
    listens: bool
    refusals: Refusals

    @property
    def world(self) -> World:
        """Where it is."""
        ...

    @property
    def node(self) -> str:
        """Its name."""
        ...

    @property
    def is_announced(self) -> bool:
        """Whether it counts as up."""
        ...

    def now_ns(self) -> int:
        """The clock of its host."""
        ...

    def still_ns(self) -> int:
        """How long it stands still from now on."""
        ...

    def work(self, handler: Callable[[Any], None], argument: Any) -> None:
        """Run ``handler(argument)`` as its next piece of work."""
        ...

    def post(self, handler: Callable[[], None]) -> None:
        """Run ``handler`` as its work."""
        ...
