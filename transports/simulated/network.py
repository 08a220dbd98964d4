"""What becomes of a message under way in a simulated world: when it arrives, how often, or not at all."""

from __future__ import annotations

import random
from collections.abc import Iterable, Sequence

from transports.simulated.conditions import Bounds, Conditions, Cut, Pause, Slowdown

NS = 10**9


class Link:
    """Where messages keep their order: one channel from one node to another, or to one of its taps.

    Attributes:
        source: the node that sends.
        channel: on which.
        node: the node that receives.
        in_order_ns: when the last message arrives of those that keep the order.
        latest_ns: when the last of the others arrives.
        count: how many were sent, where any is to be lost.
    """

    __slots__ = ("channel", "count", "in_order_ns", "latest_ns", "node", "source")

    def __init__(self, source: str, channel: str, node: str) -> None:
        self.source = source
        self.channel = channel
        self.node = node
        self.in_order_ns = 0
        self.latest_ns = 0
        self.count = 0


class Range:
    """Draws durations in ns between two bounds."""

    def __init__(self, bounds_s: Bounds, source: random.Random) -> None:
        self.least = round(bounds_s[0] * NS)
        self.width = round(bounds_s[1] * NS) - self.least
        self.random = source.random
        self.most = self.least + self.width

    def draw(self) -> int:
        """One of them."""
        return self.least + int(self.random() * self.width) if self.width else self.least


class Network:
    """All links of one world.

    Args:
        conditions: how well they work.
        began_ns: virtual time as the world begins.
        draws: the world's choices.
        seed: of further choices, so that conditions which need none do not change the others.
    """

    def __init__(
        self, conditions: Conditions, began_ns: int, draws: random.Random, seed: int
    ) -> None:
        self._conditions = conditions
        self._random = draws
        self._more = random.Random(f"{seed} network")
        self._delay = Range(conditions.delay_s, draws)
        self._tap_delay = Range(conditions.tap_delay_s, draws)
        self._discovery = Range(conditions.discovery_s, self._more)
        self.finds_at_once = not self._discovery.most
        """Whether ends find each other without delay."""
        self._cuts = [(cut, *_span(cut, began_ns)) for cut in conditions.cuts]
        self._slowdowns = [
            (frozenset(slow.nodes), *_span(slow, began_ns), round(slow.by_s * NS))
            for slow in conditions.slowdowns
        ]
        self._lease_ns = round(conditions.lease_s * NS)
        self._lost = {(one.source, one.channel, one.node, one.number) for one in conditions.lost}
        self._reordered = {
            (one.source, one.channel, one.node): (
                Range((0.0, one.by_s), self._more),
                one.probability,
            )
            for one in conditions.reordered
        }
        self._links: dict[tuple[str, str, str], Link] = {}
        self.is_kept = not (self._cuts or self._lost or self._reordered or self._slowdowns)
        """Whether what is sent arrives in its order, but for what is lost or doubled by chance."""
        self.shows_all = self.is_kept and not (conditions.duplication or conditions.tap_loss)
        """Whether a tap receives each observation once, in order."""

    def link(self, source: str, channel: str, node: str) -> Link:
        """The link of ``channel`` between two nodes, which keeps its order though they are started again."""
        place = (source, channel, node)
        link = self._links.get(place)
        if link is None:
            link = self._links[place] = Link(source, channel, node)
        return link

    def in_turn(self, link: Link, now_ns: int) -> int:
        """When what is sent now on ``link`` arrives, where nothing that is sent is lost (``is_kept``)."""
        return _in_turn(link, now_ns + self._delay.draw())

    def shown(self, link: Link, now_ns: int) -> int:
        """The same for what a tap receives of all (``shows_all``)."""
        return _in_turn(link, now_ns + self._tap_delay.draw())

    def discovery_ns(self) -> int:
        """How long two ends take to find each other."""
        return self._discovery.draw()

    @property
    def longest_discovery_ns(self) -> int:
        """How long they take at most."""
        return self._discovery.most

    def copies(self, loss: float) -> int:
        """How often a message arrives that is lost with probability ``loss``: 0, 1 or 2 times."""
        if loss and self._random.random() < loss:
            return 0
        doubled = self._conditions.duplication
        return 2 if doubled and self._random.random() < doubled else 1

    def message(
        self, link: Link, now_ns: int, is_lossy: bool, behind: Iterable[Link] = ()
    ) -> Sequence[int]:
        """When a message arrives that is sent now (ns): never, once or twice.

        Args:
            link: on which.
            now_ns: virtual time.
            is_lossy: whether the middleware may lose it.
            behind: links whose messages that are under way arrive before it.
        """
        copies = self.copies(self._conditions.loss) if is_lossy else 1
        if self._is_lost(link, link.node):
            return []
        least_ns = max((max(one.in_order_ns, one.latest_ns) for one in behind), default=0)
        delay, node = self._delay, link.node
        found = [
            self._arrival(link, node, delay, now_ns, least_ns, is_lossy) for _ in range(copies)
        ]
        return [due_ns for due_ns in found if due_ns is not None]

    def observation(self, link: Link, now_ns: int) -> Sequence[int]:
        """The same for what a tap receives; the link ends at the tap's node."""
        copies = self.copies(self._conditions.tap_loss)
        if self._is_lost(link, ""):
            return []
        found = [self._arrival(link, "", self._tap_delay, now_ns) for _ in range(copies)]
        return [due_ns for due_ns in found if due_ns is not None]

    def _is_lost(self, link: Link, node: str) -> bool:
        if not self._lost:
            return False
        link.count += 1
        return (link.source, link.channel, node, link.count - 1) in self._lost

    def _arrival(
        self,
        link: Link,
        node: str,
        delay: Range,
        now_ns: int,
        least_ns: int = 0,
        is_lossy: bool = False,
    ) -> int | None:
        """When one copy arrives; None: it does not, as the network is cut."""
        uncut_ns = now_ns + delay.draw() + self._slowed_ns(link.source, now_ns)
        due_ns = self._after_cuts(link, uncut_ns, now_ns, is_lossy)
        if due_ns is None:
            return None
        due_ns = max(due_ns, least_ns)
        reordered = self._reordered.get((link.source, link.channel, node))
        if reordered is not None and self._more.random() < reordered[1]:
            due_ns += reordered[0].draw()
        else:
            return _in_turn(link, due_ns)
        link.latest_ns = max(link.latest_ns, due_ns)
        return due_ns

    def _slowed_ns(self, node: str, now_ns: int) -> int:
        """How much later comes what ``node`` sends now."""
        return sum(
            by_ns
            for nodes, from_ns, until_ns, by_ns in self._slowdowns
            if from_ns <= now_ns < until_ns and node in nodes
        )

    # --- cuts --------------------------------------------------------------------------------------

    def _after_cuts(self, link: Link, due_ns: int, now_ns: int, is_lossy: bool) -> int | None:
        for cut, from_ns, until_ns in self._cuts:
            if due_ns < from_ns or now_ns >= until_ns or not self._is_between(cut, link):
                continue
            if is_lossy or until_ns - from_ns > self._lease_ns:
                return None
            due_ns = until_ns + due_ns - max(now_ns, from_ns)
        return due_ns

    def _is_between(self, cut: Cut, link: Link) -> bool:
        return self.separates(cut, link.source, link.node)

    def separates(self, cut: Cut, one: str, other: str) -> bool:
        """Whether ``cut`` lies between two nodes."""
        host_of = self._conditions.host_of
        return (host_of(one) in cut.hosts) != (host_of(other) in cut.hosts)

    def healed_ns(self, one: str, other: str, now_ns: int) -> int:
        """When two nodes reach each other (again): ``now_ns``, or when a cut between them is healed."""
        for cut, from_ns, until_ns in self._cuts:
            if from_ns <= now_ns < until_ns and self.separates(cut, one, other):
                now_ns = until_ns
        return now_ns

    def long_cuts(self) -> list[tuple[Cut, int, int]]:
        """Cuts in which each side takes the other for gone: from when until when (ns)."""
        return [
            (cut, from_ns + self._lease_ns, until_ns)
            for cut, from_ns, until_ns in self._cuts
            if until_ns - from_ns > self._lease_ns
        ]


def _in_turn(link: Link, due_ns: int) -> int:
    """When something arrives that keeps the link's order, and would without others at ``due_ns``."""
    if due_ns < link.in_order_ns:
        return link.in_order_ns
    link.in_order_ns = due_ns
    return due_ns


class Pauses:
    """When nodes stand still."""

    def __init__(self, pauses: Iterable[Pause], began_ns: int) -> None:
        self._of: dict[str, list[tuple[int, int]]] = {}
        for pause in sorted(pauses, key=lambda pause: pause.at_s):
            self._of.setdefault(pause.node, []).append(_span(pause, began_ns))

    def after(self, node: str, instant_ns: int) -> int:
        """The first instant from ``instant_ns`` on (ns) at which ``node`` does something."""
        for from_ns, until_ns in self._of.get(node, ()):
            if from_ns <= instant_ns < until_ns:
                instant_ns = until_ns
        return instant_ns


def _span(one: Pause | Cut | Slowdown, began_ns: int) -> tuple[int, int]:
    from_ns = began_ns + round(one.at_s * NS)
    return from_ns, from_ns + round(one.for_s * NS)
