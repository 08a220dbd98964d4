"""Whether a property is false whenever what was observed happened, as far as that is known.

Each observation happened up to some time before its stamp: the latency bound, where stamps are times of
reception; else by how much stamps of different clocks may be wrong against each other. What one sender
sends on a channel is in order. What comes from others within that time may have happened in another order,
and from one instant to another it may have been longer, or less long, by as much.

All these orders are followed, as far as they make a difference: what changes no predicate is left out, and
orders that lead to the same state of the monitor are one from then on. In each order everything happened as
late as it can have: when it is stamped, or just before what is stamped earlier and happened later. No
instant is moved by more than that time, so that a run in which the property holds is, in its order, one in
which the property holds with bounds that are longer by it (:func:`moon.properties.formula.loosened`).
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

from msgspec.structs import replace

from m2c.model.walk import variables_of
from moon.properties.formula import loosened
from moon.properties.monitor import PropertySet
from moon.properties.network import NEVER
from moon.properties.predicates import ANY_CHANNEL, UNKNOWN_ERRORS, Binding, PortGroup, value_of
from moon.properties.property import Property, Status, Verdict
from transports.bounded import BoundedDict
from transports.interface import Observation, ObservationKind
from transports.service_events import KIND_OF_EVENT

MOST_ORDERS = 256
"""So many that differ are followed; what happened meanwhile may have been anything if there are more."""
_BEFORE_NS = 1_000
"""So long before what was received earlier does something happen that is taken to have happened first."""
_APART_NS = 2
"""So far at least are two things that are put in another order: an event lasts for one tick."""
_MOST_CALLS = 10_000
_Line = tuple[str, str, str]
"""What comes in order, from one sender: a channel; of a service also the kind, and the client; of a topic of
several publishers also which of its lines.
"""
_Call = tuple[str, str, int]


class _Edge(NamedTuple):
    """What may change a predicate.

    Attributes:
        seen: it.
        earliest_ns: the earliest instant at which it can have happened.
        cause: the line, and the place on it, of what happened before it in any case: of a response, the
            request; None: there is nothing of the kind.
    """

    seen: Observation
    earliest_ns: int
    cause: tuple[int, int] | None


class _Order(NamedTuple):
    """One order, or all that lead here.

    Attributes:
        taken: how many observations have happened, by line.
        last_ns: when the last of them did.
        due_ns: before this instant nothing changes by itself.
        times: how often the property was false at least.
        fell_ns: when it became so last.
        state: of the monitor.
    """

    taken: tuple[int, ...]
    last_ns: int
    due_ns: int
    times: int
    fell_ns: int
    state: Any


class AnyOrder:
    """Monitors a property over observations of which it is not known exactly when they happened.

    Args:
        item: the property.
        open_ns: an observation happened within this time before its stamp.
        most: so many orders are followed.
        shared: topics with several publishers, of which it is not known who published what.
        loose_ns: durations are known to this; by default, to ``open_ns``.

    Attributes:
        open_ns, loose_ns: as above.
        times: how often it was false in every order.
        fell_ns: in none of them before this instant did it become false for the last of these times.
        reported: how often somebody was told; theirs to set.
    """

    def __init__(
        self,
        item: Property,
        open_ns: int,
        most: int = MOST_ORDERS,
        shared: frozenset[str] = frozenset(),
        loose_ns: int | None = None,
    ) -> None:
        self.times = 0
        self.fell_ns = 0
        self.reported = 0
        self.loose_ns = open_ns if loose_ns is None else loose_ns
        loose = replace(item, formula=loosened(item.formula, self.loose_ns + 2 * _BEFORE_NS))
        self._set = PropertySet([loose], remembered=1)
        (self._group,) = self._set.groups
        self._channels = self._set.channels()
        self.open_ns = open_ns
        self._most = most
        self._shared = shared
        self._own = {
            ports.name: _own(ports, self._group.binding) for ports in self._group.binding.groups
        }
        """Of each group of ports, its predicates; None if others decide some of them, too."""
        self._values: dict[str, tuple[Any, ...]] = {}
        """What each group of ports was last set to, in every order."""
        self._unknown_ns = 0
        """What was received before that may have happened while something was missing."""
        self._slots: dict[_Line, int] = {}
        self._newest: list[int] = []
        """Of each line, the stamp of the last one."""
        self._edges: list[deque[_Edge]] = []
        """Of each line, what has not happened in some order."""
        self._gone: list[int] = []
        """Of each line, how many happened in every order."""
        self._calls: BoundedDict[_Call, tuple[int, int, int]] = BoundedDict(_MOST_CALLS)
        """How far each call has come, on which line that is, and its place there."""
        self._begin_ns = 0
        self._initial = self._set.snapshot()
        self._orders: list[_Order] = [_Order((), -1, 0, 0, 0, self._initial)]
        self._last_edge_ns = 0
        self._is_begun = self._is_over = False

    def start(self, since_ns: int) -> None:
        """Observation begins at ``since_ns``, with what is received at that instant."""
        self._begin_ns = since_ns

    def start_late(self, since_ns: int) -> None:
        """Observation begins at ``since_ns``; what happened before, or may have, may have been anything."""
        self._begin_ns = since_ns
        self._is_begun = True
        self._restart(since_ns - 1)

    def observe(self, seen: Observation) -> None:
        """Take in ``seen``, stamped with its reception; nothing that follows was received before."""
        if seen.stamp_ns < self._begin_ns or not self._may_change(seen):
            return
        stamp_ns, last_ns = seen.stamp_ns, self._last_edge_ns
        self._last_edge_ns = max(last_ns, stamp_ns)
        if not self._orders:
            if stamp_ns - last_ns <= self.open_ns:
                return
            self._restart(last_ns)
        slot = self._slot_of(seen)
        if slot == len(self._edges):
            self._edges.append(deque())
            self._gone.append(0)
            self._newest.append(0)
            self._orders = [it._replace(taken=(*it.taken, 0)) for it in self._orders]
        self._newest[slot] = stamp_ns
        cause = self._cause(seen, slot) if seen.kind in KIND_OF_EVENT else None
        self._edges[slot].append(_Edge(seen, stamp_ns - self.open_ns, cause))

    def _slot_of(self, seen: Observation) -> int:
        """The line of ``seen``; on a topic of several publishers one on which all was certainly before."""
        line = _line(seen)
        slot = self._slots.setdefault(line, len(self._edges))
        is_shared = seen.channel in self._shared and seen.kind is ObservationKind.MESSAGE
        number = 0
        while (
            is_shared
            and slot < len(self._edges)
            and self._newest[slot] >= seen.stamp_ns - self.open_ns
        ):
            number += 1
            slot = self._slots.setdefault((*line[:2], str(number)), len(self._edges))
        return slot

    def advance(self, now_ns: int) -> None:
        """All that was received before ``now_ns`` was taken in."""
        if not self._is_over:
            self._pass_to(now_ns - self.open_ns, now_ns)

    def finish(self, known_ns: int) -> None:
        """Nothing follows, and time ends at ``known_ns``."""
        self._pass_to(known_ns, known_ns + _BEFORE_NS + 1)
        self._is_over = True

    def lose(self, channel: str, from_ns: int, until_ns: int) -> None:
        """What was received on ``channel`` in ``[from_ns, until_ns)`` is missing."""
        if channel not in self._channels and ANY_CHANNEL not in self._channels:
            return
        self._forget_values(until_ns)
        orders = []
        for it in self._orders:
            self._set.restore(it.state)
            was_false = self._is_false()
            # what is stamped so long after it may have happened before it
            self._set.lose(channel, max(from_ns - self.open_ns, 0), until_ns + self.open_ns)
            times = max(it.times - (was_false and not self._is_false()), self.reported)
            orders.append(self._order(it.taken, it.last_ns, times, it.fell_ns))
        self._orders = orders
        self.times = min((it.times for it in orders), default=self.times)

    def _cause(self, seen: Observation, slot: int) -> tuple[int, int] | None:
        """What happened before ``seen``, a step of a call on the line ``slot``, in any case."""
        call, step = (seen.channel, seen.client, seen.call), KIND_OF_EVENT.index(seen.kind)
        before = self._calls.get(call)
        if before is not None and before[0] >= step:
            return None  # by stamps the call went back: they tell nothing
        self._calls[call] = step, slot, self._gone[slot] + len(self._edges[slot])
        return None if before is None else before[1:]

    # --- what makes a difference -----------------------------------------------------------------

    def _may_change(self, seen: Observation) -> bool:
        """Whether ``seen`` may change a predicate."""
        found = False
        for ports in self._group.binding.groups:
            if ports.channel == ANY_CHANNEL:
                found = True
            elif ports.channel == seen.channel and seen.kind in ports.kinds:
                found |= self._sets(ports, seen) or seen.channel in self._shared
        return found

    def _sets(self, ports: PortGroup, seen: Observation) -> bool:
        binding = self._group.binding
        states = [port for port in ports.ports if not port.event]
        try:
            happens = any(
                binding.conditions[port.name](seen.data) for port in ports.ports if port.event
            )
            values = {port.name: value_of(port, seen.data) for port in states}
            own = tuple(values[port.name] for port in states)
            if (texts := self._own[ports.name]) is not None:
                own = tuple(binding.evaluate[text](values) for text in texts)
        except UNKNOWN_ERRORS:
            self._values.pop(ports.name, None)
            return True
        if seen.stamp_ns < self._unknown_ns:
            return True
        before = self._values.get(ports.name)
        self._values[ports.name] = own
        return happens or before != own

    def _forget_values(self, until_ns: int) -> None:
        """Something may be missing until then (ns); in some order, what was received later was before it."""
        self._values.clear()
        self._unknown_ns = max(self._unknown_ns, until_ns + 2 * self.open_ns)

    # --- orders ----------------------------------------------------------------------------------

    def _pass_to(self, limit_ns: int, now_ns: int) -> None:
        """What was received up to ``limit_ns`` happened, and nothing else will have before ``now_ns``."""
        if not self._orders:
            if now_ns - self._last_edge_ns <= self.open_ns:
                return
            self._restart(self._last_edge_ns)
        if not self._is_begun:
            self._begin()
        levels: defaultdict[int, dict[Any, _Order]] = defaultdict(dict)
        done: dict[Any, _Order] = {}
        for it in self._orders:
            levels[sum(it.taken)][id(it)] = it
        self._orders = []
        while levels:
            level = levels.pop(min(levels))
            if len(level) + len(done) > self._most:
                self._give_up()
                return
            for key, it in level.items():
                heads = self._heads(it)
                if min((edge.seen.stamp_ns for _, edge in heads), default=NEVER) > limit_ns:
                    _keep(done, *self._let_pass(key, it, heads, now_ns))
                    continue
                for found in self._next(it, heads, now_ns):
                    _keep(levels[sum(found[1].taken)], *found)
        self._orders = list(done.values())
        self._forget()
        self.times = min(it.times for it in self._orders)
        self.fell_ns = min(it.fell_ns for it in self._orders if it.times == self.times)

    def _heads(self, order: _Order) -> list[tuple[int, _Edge]]:
        """The next one on each line."""
        found = []
        for slot, edges in enumerate(self._edges):
            place = order.taken[slot] - self._gone[slot]
            if place < len(edges):
                found.append((slot, edges[place]))
        return found

    def _next(
        self, order: _Order, heads: list[tuple[int, _Edge]], now_ns: int
    ) -> Iterator[tuple[Any, _Order]]:
        """What ``order`` may become by one more observation."""
        for slot, edge in heads:
            if edge.cause is not None and order.taken[edge.cause[0]] <= edge.cause[1]:
                continue
            stamp_ns = edge.seen.stamp_ns
            others_ns = min((it.seen.stamp_ns for at, it in heads if at != slot), default=NEVER)
            if edge.earliest_ns > others_ns:
                continue
            if stamp_ns <= others_ns:
                at_ns = stamp_ns if stamp_ns >= order.last_ns else order.last_ns + _APART_NS
                yield self._taken(order, slot, edge, at_ns, now_ns)
            if stamp_ns >= others_ns:
                at_ns = max(order.last_ns + _APART_NS, others_ns - _BEFORE_NS)
                yield self._taken(order, slot, edge, at_ns, now_ns)

    def _taken(
        self, order: _Order, slot: int, edge: _Edge, at_ns: int, now_ns: int
    ) -> tuple[Any, _Order]:
        """``order`` and then ``edge``, at that instant."""
        self._set.restore(order.state)
        times, fell_ns = order.times, order.fell_ns
        found = self._set.observe(_at(edge.seen, at_ns))
        taken = tuple(count + (at == slot) for at, count in enumerate(order.taken))
        after = _Order(taken, at_ns, 0, times, fell_ns, None)
        next_ns = min((it.seen.stamp_ns for _, it in self._heads(after)), default=now_ns)
        if next_ns - _BEFORE_NS - 1 > at_ns:
            found = [*found, *self._set.advance(next_ns - _BEFORE_NS - 1)]
        times, fell_ns = _counted(found, times, fell_ns)
        return self._key(taken), self._order(taken, at_ns, times, fell_ns)

    def _let_pass(
        self, key: Any, order: _Order, heads: list[tuple[int, _Edge]], now_ns: int
    ) -> tuple[Any, _Order]:
        """``order`` when time has passed to the next observation, or to ``now_ns``."""
        until_ns = min((it.seen.stamp_ns for _, it in heads), default=now_ns) - _BEFORE_NS - 1
        if order.due_ns > until_ns:
            return key, order
        self._set.restore(order.state)
        if until_ns <= self._set.sealed_ns:
            return key, order
        found = self._set.advance(until_ns)
        times, fell_ns = _counted(found, order.times, order.fell_ns)
        return self._key(order.taken), self._order(order.taken, order.last_ns, times, fell_ns)

    def _order(self, taken: tuple[int, ...], last_ns: int, times: int, fell_ns: int) -> _Order:
        """The one that the monitor stands for now."""
        due_ns = self._set.next_deadline()
        state = self._set.snapshot()
        return _Order(taken, last_ns, NEVER if due_ns is None else due_ns, times, fell_ns, state)

    def _key(self, taken: tuple[int, ...]) -> Any:
        """What tells two orders apart from now on."""
        return taken, self._group.form(3 * self.open_ns)

    def _is_false(self) -> bool:
        return any(it.status is Status.FALSE for it in self._set.verdicts().values())

    def _forget(self) -> None:
        """What happened in every order is not needed any more."""
        for slot, edges in enumerate(self._edges):
            gone = min(it.taken[slot] for it in self._orders)
            for _ in range(gone - self._gone[slot]):
                edges.popleft()
            self._gone[slot] = gone

    def _begin(self) -> None:
        self._is_begun = True
        orders = []
        for it in self._orders:
            self._set.restore(it.state)
            is_before = self._set.sealed_ns < self._begin_ns - 1
            found = self._set.advance(self._begin_ns - 1) if is_before else ()
            times, fell_ns = _counted(found, it.times, it.fell_ns)
            last_ns = max(it.last_ns, self._begin_ns - 1)
            orders.append(self._order(it.taken, last_ns, times, fell_ns))
        self._orders = orders

    def _give_up(self) -> None:
        """There are too many: it goes on when the order is known again."""
        self._orders = []
        self._calls.clear()
        for edges in self._edges:
            edges.clear()

    def _restart(self, until_ns: int) -> None:
        """What happened up to ``until_ns`` may have been anything."""
        self._forget_values(until_ns + 1)
        self._set.restore(self._initial)
        for channel in sorted(self._channels):
            # what is stamped so long after it may have happened before
            self._set.lose(channel, 0, until_ns + self.open_ns + 1)
        self._set.advance(until_ns)
        taken = tuple(self._gone)
        self._orders = [self._order(taken, until_ns, self.times, self.fell_ns)]


def _line(seen: Observation) -> _Line:
    """On which line ``seen`` comes."""
    is_message = seen.kind is ObservationKind.MESSAGE
    return (seen.channel, "", "") if is_message else (seen.channel, str(seen.kind), seen.client)


def _own(ports: PortGroup, binding: Binding) -> tuple[str, ...] | None:
    """The predicates of states that ``ports`` decide; None if others decide some of them, too."""
    names = {port.name for port in ports.ports}
    texts = tuple(text for text in ports.atoms if text not in binding.events)
    used = {name for text in texts for name in variables_of(binding.atoms[text].expression)}
    return texts if used <= names else None


def _keep(orders: dict[Any, _Order], key: Any, order: _Order) -> None:
    """Add ``order``, unless one of the same state was false less often."""
    other = orders.get(key)
    if other is None or (order.times, order.fell_ns) < (other.times, other.fell_ns):
        orders[key] = order


def _counted(found: Iterable[tuple[str, Verdict]], times: int, fell_ns: int) -> tuple[int, int]:
    """How often the property was false, with what was ``found``, and when it became so last."""
    for _, verdict in found:
        if verdict.status is Status.FALSE:
            times, fell_ns = times + 1, verdict.since_ns
    return times, fell_ns


def _at(seen: Observation, stamp_ns: int) -> Observation:
    """``seen``, at another instant."""
    if seen.stamp_ns == stamp_ns:
        return seen
    return replace(seen, stamp_ns=stamp_ns)
