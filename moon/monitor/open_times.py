"""The properties of which it is open when what they are about happened, as clocks tell it.

The host of the monitor has one clock. When that is set, the monitor sees it: what the nodes of its host
stamp is in order, and lasts as long as it says. A clock of another host may be set unseen, by as much as
clocks are taken to differ (``HostClocks.differ_ns``): durations are known to that only. What nodes of
several hosts do, by clocks of their own, is in an order that is open by as much, too.

A property of such nodes is violated only if it is whatever happened when
(:class:`moon.properties.any_order.AnyOrder`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable

from moon.feed.held import Held
from moon.feed.nodes import KEPT_SOURCES
from moon.properties.any_order import AnyOrder
from moon.properties.formula import has_duration
from moon.properties.property import Property
from transports.bounded import BoundedDict
from transports.interface import HERE, Observation


class OpenTimes:
    """What is known of them in any order.

    Args:
        properties: all that are monitored.

    Attributes:
        orders: of each property whose times are open.
        timed: those that say how long something takes.
    """

    def __init__(self, properties: Iterable[Property]) -> None:
        self._items = {item.name: item for item in properties}
        self.orders: dict[str, AnyOrder] = {}
        self._chosen: dict[str, int] = {}
        """Of each of which somebody else knows by how much it is open (ns)."""
        self._shared: frozenset[str] = frozenset()
        self._clocks: dict[str, BoundedDict[str, str]] = {
            name: BoundedDict(KEPT_SOURCES) for name in self._items
        }
        """Of each property, by which clock each node stamps that sends to it; "": that is not known."""
        self.timed = {item.name for item in self._items.values() if has_duration(item.formula)}
        self._unordered: Held[Observation] = Held()
        """What is handed to ``orders`` when all of before is known."""
        self._since_ns = self._differ_ns = 0
        self._known_ns = self._seen_ns = 0
        """All up to the first was handed to ``orders``; nothing later than the second was observed (ns)."""
        self._is_beginning = True
        """Whether all that was observed is in ``_unordered``, whatever is open."""

    def choose(self, names: Iterable[str], open_ns: int, shared: Iterable[str]) -> None:
        """What ``names`` are about happened within ``open_ns`` before its stamp, and no others are open.

        On the topics ``shared`` several publishers publish.
        """
        self._chosen, self._shared = dict.fromkeys(names, open_ns), frozenset(shared)
        self.restart()

    def restart(self) -> None:
        """Forget everything that was observed."""
        self.orders.clear()
        self._unordered.clear()
        self._known_ns = self._seen_ns = 0
        self._is_beginning = True
        for name in self._items:
            self._open(name)

    def start(self, since_ns: int, differ_ns: int) -> None:
        """Observation begins at ``since_ns``, with what is received at that instant.

        Args:
            since_ns: ns since the epoch.
            differ_ns: clocks of hosts differ by at most this.
        """
        self._since_ns, self._differ_ns = since_ns, differ_ns
        for orders in self.orders.values():
            orders.start(since_ns)

    def meet(self, node: str, clock: str, names: Collection[str]) -> None:
        """``node``, which may send to the properties ``names``, stamps by ``clock``.

        Args:
            node: its name; "" stands for all of whom nobody said that they are there.
            clock: see ``TellsClocks.clock_of``.
            names: properties, beside those to which it was known to send.
        """
        for name, clocks in self._clocks.items():
            before = clocks.get(node)
            if (name in names or before is not None) and before != clock:
                clocks[node] = clock
                if before:  # it has moved: what it did before was by another clock
                    clocks[""] = ""
                self._open(name)

    def open_ns(self, name: str) -> int:
        """What ``name`` is about happened within so long before its stamp (ns)."""
        orders = self.orders.get(name)
        return 0 if orders is None else orders.open_ns

    def _open_ns(self, name: str) -> int | None:
        """By how much it is open when something happened; None: durations are known, too."""
        if self._chosen:
            return self._chosen.get(name)
        known = self._clocks[name]
        clocks = set(known.values())
        if "" in known or len(clocks) > 1 or (len(known) > 1 and "" in clocks):
            return self._differ_ns
        return 0 if name in self.timed and clocks - {HERE} else None

    def _open(self, name: str) -> None:
        open_ns, orders = self._open_ns(name), self.orders.get(name)
        if open_ns is None:
            self.orders.pop(name, None)
        elif orders is None or orders.open_ns != open_ns:
            loose_ns = open_ns if self._chosen else self._differ_ns
            orders = AnyOrder(self._items[name], open_ns, shared=self._shared, loose_ns=loose_ns)
            if self._is_beginning:
                orders.start(self._since_ns)
            else:
                orders.start_late(self._seen_ns + 1)
            self.orders[name] = orders

    def observe(self, seen: Observation) -> None:
        """Take in ``seen``, which the properties have taken."""
        self._seen_ns = max(self._seen_ns, seen.stamp_ns)
        if self.orders and seen.stamp_ns <= self._known_ns:
            self.lose(
                seen.channel, seen.stamp_ns, seen.stamp_ns + 1
            )  # it came too late to be in order
        elif self.orders or self._is_beginning:
            self._unordered.add(seen)

    def lose(self, channel: str, from_ns: int, until_ns: int) -> None:
        """What was stamped in ``[from_ns, until_ns)`` on ``channel`` is missing."""
        for orders in self.orders.values():
            orders.lose(channel, from_ns, until_ns)

    def advance(self, known_ns: int, is_beginning: bool) -> None:
        """All that was stamped up to ``known_ns`` was received.

        Args:
            known_ns: ns since the epoch.
            is_beginning: what holds as observation begins is not known yet.
        """
        self._is_beginning &= is_beginning
        self._known_ns = max(self._known_ns, known_ns)
        self._seen_ns = max(self._seen_ns, known_ns)
        if self.orders:
            self._hand_over(known_ns)
            for orders in self.orders.values():
                orders.advance(known_ns + 1)
        elif not self._is_beginning:
            self._unordered.clear()

    def finish(self, known_ns: int) -> None:
        """Nothing follows, and time ends at ``known_ns``."""
        self._hand_over(None)
        for orders in self.orders.values():
            orders.finish(known_ns)

    def _hand_over(self, until_ns: int | None) -> None:
        held = self._unordered
        count = len(held.stamps) if until_ns is None else held.count(until_ns)
        for seen in held.take(count):
            for orders in self.orders.values():
                orders.observe(seen)
