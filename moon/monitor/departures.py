"""Who is not there owes nothing: what nodes that leave, or are still to come, mean to properties.

Of the response patterns:

To the models a node that goes away owes nothing any more (:mod:`moon.monitor.machines`); to a property its
silence would be a violation, as when ``m2c run`` is stopped. So each response of such a pattern is one
*or a departure*, an observation that is made here:

* when the last node leaves that could respond, what is owed by then is owed no more;
* as long as nobody is there who could respond or could ask, nothing is owed. (A state that asks goes on
  asking when all have left.)

What is asked while the responder is away is owed, and so was what had its deadline before it left. A node
that was killed cannot be distinguished from one that left. Who could respond or ask are the nodes whose
models say so and those of which that was observed.

Of a recurrence, and of an existence within a time:

* one that no scope begins begins with the first occurrence, or when all nodes of the system were found,
  whichever is first: else a monitor that is started before a system would find it false;
* nothing is owed any more once who runs the system begins to end its nodes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import msgspec

from m2c.language.expressions import Variable
from m2c.model.machine import Machine
from m2c.model.walk import variables_of
from moon.feed.places import Place, nodes_at
from moon.properties.formula import Formula, Or, Predicate, predicates
from moon.properties.patterns import PatternName, Scope, ScopeName, pattern_formula
from moon.properties.property import Port, Property
from transports.interface import Observation, ObservationKind

PREFIX = "@departure "
"""How the names of what is made here begin: of ports, predicates and channels. Nobody else's can."""
STARTED = f"{PREFIX}started"
"""The port, predicate and channel of what says that all nodes were found."""
ENDING = f"{PREFIX}ending"
"""The port, predicate and channel of what says that who runs the nodes is about to end them."""
MOST_NODES = 10_000
"""Nodes that are remembered; names come from the wire, and never end."""

_IN_TIME = (PatternName.RECURRENCE, PatternName.EXISTENCE)
"""What has to happen in time, whatever else happens."""

_SENT = {
    ObservationKind.MESSAGE: ObservationKind.MESSAGE,
    ObservationKind.REQUEST_SENT: ObservationKind.REQUEST_SENT,
    ObservationKind.REQUEST_RECEIVED: ObservationKind.REQUEST_SENT,
    ObservationKind.RESPONSE_SENT: ObservationKind.RESPONSE_SENT,
    ObservationKind.RESPONSE_RECEIVED: ObservationKind.RESPONSE_SENT,
}
"""As what was sent what is observed."""


class _Response(msgspec.Struct):
    """A response that nodes owe.

    Attributes:
        name: of what is made here for it.
        answers, asks: where it comes from, and what asks for it.
        keeps: what leaves is not forgotten before it comes back: an answer may not come at once.
        waived: whether nobody is left who owes it.
        reported_ns: the stamp of what was reported of it last; one instant has one value.
    """

    name: str
    answers: frozenset[Place]
    asks: frozenset[Place]
    keeps: bool
    waived: bool = False
    reported_ns: int = -1

    def report(self, waived: bool, now_ns: int) -> Observation:
        """The observation that it is waived from now on, or no longer."""
        self.reported_ns = max(now_ns, self.reported_ns + 1)
        return _made(self.name, self.reported_ns, is_on=waived)


class Departures:
    """Watches the nodes that owe what ``properties`` demand.

    Args:
        properties: as they were read.
        machines: the models of nodes that may be there.
        awaited: all nodes of the system; empty: they are not known, and nothing waits for them.

    Attributes:
        properties: the same, with departures in their formulas.
        channels: those on which it matters who sends.
        beginning: the names of those that begin when all nodes were found, or with their first occurrence.
        missing: the nodes that were never found.
    """

    def __init__(
        self,
        properties: Iterable[Property],
        machines: Iterable[Machine] = (),
        awaited: Iterable[str] = (),
    ) -> None:
        self._responses: list[_Response] = []
        self.missing = set(awaited)
        self.beginning: list[str] = []
        self._are_in_time = False
        """Whether something has to happen in time."""
        self._are_ending = False
        """Whether the nodes are about to be ended, or were."""
        self.properties = tuple(self._while_it_runs(self._with_departures(it)) for it in properties)
        places = {place for item in self._responses for place in item.answers | item.asks}
        self.channels = frozenset(channel for channel, _ in places)
        self._senders = {
            place: set(names) for place, names in nodes_at(machines).items() if place in places
        }
        self._there: dict[str, bool] = {}
        """Of each node that is known, whether it is there."""

    def _with_departures(self, item: Property) -> Property:
        pattern = item.pattern
        if pattern is None or pattern.name not in (
            PatternName.RESPONSE,
            PatternName.RESPONSE_CHAIN,
        ):
            return item
        ports = {port.name: port for port in item.ports}
        asks = _places(pattern.events[0], ports)
        events, added = [pattern.events[0]], []
        for number, response in enumerate(pattern.events[1:]):
            name = f"{PREFIX}{item.name} {number}"
            answers = _places(response, ports)
            self._responses.append(_Response(name, answers, asks, pattern.bound.lower > 0))
            events.append(Or((response, Predicate(name, Variable(name=name)))))
            added.append(_switch(name))
        formula = pattern_formula(msgspec.structs.replace(pattern, events=tuple(events)))
        return msgspec.structs.replace(item, formula=formula, ports=(*item.ports, *added))

    def _while_it_runs(self, item: Property) -> Property:
        """``item``, if something has to happen in time: while the system runs."""
        pattern = item.pattern
        if pattern is None or pattern.bound.upper is None or pattern.name not in _IN_TIME:
            return item
        event, ports = pattern.events[0], [_switch(ENDING)]
        scope = pattern.scope
        if scope.name is ScopeName.GLOBALLY and self.missing:
            self.beginning.append(item.name)
            begin = Or((event, Predicate(STARTED, Variable(name=STARTED))))
            scope = Scope(ScopeName.AFTER, begin=begin)
            ports.append(_switch(STARTED))
        self._are_in_time = True
        events = (Or((event, Predicate(ENDING, Variable(name=ENDING)))),)
        formula = pattern_formula(msgspec.structs.replace(pattern, events=events, scope=scope))
        return msgspec.structs.replace(item, formula=formula, ports=(*item.ports, *ports))

    def started(self, now_ns: int) -> Iterator[Observation]:
        """All nodes were found by ``now_ns`` (ns), or nobody says which are there."""
        self.missing.clear()
        if self.beginning:
            yield _made(STARTED, now_ns, is_on=True)

    def ending(self, now_ns: int) -> Iterator[Observation]:
        """The nodes are about to be ended (ns)."""
        self._are_ending = True
        if self._are_in_time:
            yield _made(ENDING, now_ns, is_on=True)

    def received(self, seen: Observation) -> None:
        """``seen``, on one of :attr:`channels`, was received: who sent it is there, and sends there."""
        kind = seen.kind
        who = seen.source
        if kind is ObservationKind.REQUEST_RECEIVED:
            # it will have to answer
            self._note((seen.channel, ObservationKind.RESPONSE_SENT), seen.source)
            who = seen.client
        elif kind is ObservationKind.RESPONSE_RECEIVED:
            return
        self._note((seen.channel, _SENT[kind]), who)

    def _note(self, place: Place, node: str) -> None:
        if node and (node in self._there or len(self._there) < MOST_NODES):
            self._there.setdefault(node, True)
            self._senders.setdefault(place, set()).add(node)

    def found(self, node: str, now_ns: int) -> Iterator[Observation]:
        """``node`` is there (ns): it says so, or it did something, as nodes do that are not ours."""
        if node in self.missing:
            self.missing.remove(node)
            if not self.missing:
                yield from self.started(now_ns)

    def changed(self, node: str, up: bool, now_ns: int) -> Iterator[Observation]:
        """``node`` came up, or left; what that means to the properties."""
        if up:
            yield from self.found(node, now_ns)
        if node not in self._there and (not up or len(self._there) >= MOST_NODES):
            return
        self._there[node] = up
        for item in self._responses:
            left = self._has_left(item.answers)
            waived = left and (item.keeps or not self._is_there(item.asks))
            if waived != item.waived:
                yield item.report(waived, now_ns)
            elif left and not up and node in self._known(item.answers) and not waived:
                yield item.report(True, now_ns)
                yield item.report(False, now_ns)
            item.waived = waived

    def again(self, now_ns: int) -> Iterator[Observation]:
        """What holds, for properties that begin anew at ``now_ns``."""
        for item in self._responses:
            item.reported_ns = -1
            if item.waived:
                yield item.report(True, now_ns)
        if self._are_ending:
            yield from self.ending(now_ns)

    def _is_there(self, places: Iterable[Place]) -> bool:
        return any(self._there.get(node) for node in self._known(places))

    def _has_left(self, places: Iterable[Place]) -> bool:
        """Whether some were there who send at ``places``, and none is left."""
        known = [self._there[node] for node in self._known(places) if node in self._there]
        return bool(known) and not any(known)

    def _known(self, places: Iterable[Place]) -> set[str]:
        return {node for place in places for node in self._senders.get(place, ())}


def _switch(name: str) -> Port:
    """The port of what is off, and is on from some time on."""
    return Port(name, name, path=("on",), initial=False)


def _made(channel: str, stamp_ns: int, is_on: bool) -> Observation:
    """What no node reports: the switch ``channel`` is on, or off, from now on."""
    return Observation(
        stamp_ns=stamp_ns,
        received_ns=stamp_ns,
        channel=channel,
        kind=ObservationKind.MESSAGE,
        type_name="",
        data={"on": is_on},
        source="",
    )


def _places(formula: Formula, ports: Mapping[str, Port]) -> frozenset[Place]:
    """Where the observations come from that ``formula`` speaks of."""
    return frozenset(
        (ports[name].channel, _SENT[ports[name].kinds[0]])
        for atom in predicates(formula).values()
        for name in variables_of(atom.expression)
        if name in ports and ports[name].kinds
    )
