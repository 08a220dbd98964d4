"""What is observed in a simulated world: taps, and what they receive."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import msgspec

from transports.channel_filter import channel_filter
from transports.interface import (
    NAMELESS,
    REQUESTS,
    Answer,
    BlindSpot,
    BlindSpotKind,
    Closes,
    Observation,
    ObservationKind,
    Service,
)
from transports.losses import Losses
from transports.payloads import PayloadError, plain
from transports.service_events import EVENT_SUFFIX, TAKEN_SUFFIX
from transports.simulated.conditions import Conditions, Introspection, Rules
from transports.simulated.network import Link
from transports.simulated.parts import Node, World
from transports.simulated.presence import View

_SUFFIXES = {ObservationKind.MESSAGE: "", ObservationKind.MESSAGE_TAKEN: TAKEN_SUFFIX}
"""What is appended to a channel for each kind that is no event of a service."""
_ASKING = "asked"
"""Stands for a channel where a link is named on which questions and answers go."""


class Sent(NamedTuple):
    """A message of a topic: who published it, its number on its channel, what it is, when it was published,
    and in which life of its publisher.
    """

    source: str
    number: int
    type_name: str
    payload: bytes
    stamp_ns: int
    life: int = 0


class Numbers:
    """What the nodes of a world count, each from 0 in each of its lives."""

    def __init__(self) -> None:
        self._next: dict[str, dict[str, int]] = {}

    def begin(self, source: str) -> None:
        """``source`` begins, perhaps once more."""
        self._next[source] = {}

    def next(self, source: str, what: str) -> int:
        """The number that will be given next."""
        return self._next.get(source, {}).get(what, 0)

    def take(self, source: str, what: str) -> int:
        """The next number of ``what``, which is empty for all that ``source`` does."""
        counts = self._next.get(source)
        if counts is None:
            counts = self._next[source] = {}
        number = counts.get(what, 0)
        counts[what] = number + 1
        return number


class Report(msgspec.Struct):
    """What a node reports to taps: as in ``Observation``, with what it is made of.

    Attributes:
        payload: of ``data``.
        place: the channel, distinct for each kind that is numbered for itself.
    """

    stamp_ns: int
    channel: str
    kind: ObservationKind
    type_name: str
    payload: bytes | None
    source: str
    life: int
    client: str = ""
    client_life: int = 0
    call: int = 0
    error: str = ""
    place: str = ""
    sequence: int = -1
    order: int = -1

    def observation(
        self, stamp_ns: int, received_ns: int, data: Any, sequence: int, order: int, client: str
    ) -> Observation:
        """What somebody sees of it."""
        return Observation(
            stamp_ns=stamp_ns,
            received_ns=received_ns,
            channel=self.channel,
            kind=self.kind,
            type_name=self.type_name,
            data=data,
            source=self.source,
            sequence=sequence,
            order=order,
            client=client,
            call=self.call,
            error=self.error,
            life=self.life,
            client_life=self.client_life,
        )


class Routes:
    """The taps of one world, and what is reported to them."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._rules = world.conditions.rules
        self._taps: list[Tap] = []
        self.numbers = Numbers()
        self._witnesses: list[Callable[[Observation], None]] = []
        """Who is told of all that happens (``SimulatedWorld.witness``)."""
        self._is_heard = False
        """Whether anybody listens. If not, what a node does is numbered, and no more."""
        self._true_numbers = Numbers()

    def add(self, tap: Tap) -> None:
        """``tap`` listens from now on."""
        self._taps.append(tap)
        self._is_heard = True

    def witness(self, handler: Callable[[Observation], None]) -> None:
        """``handler`` is told of all that happens from now on."""
        self._witnesses.append(handler)
        self._is_heard = True

    def remove(self, tap: Tap) -> None:
        """``tap`` listens no more."""
        if tap in self._taps:
            self._taps.remove(tap)
        self._is_heard = bool(self._taps or self._witnesses)

    def begin(self, node: str) -> None:
        """A node of this name begins: it numbers anew."""
        self.numbers.begin(node)
        self._true_numbers.begin(node)

    def message(self, message: Sent, channel: str) -> None:
        """Tell taps of a message, which has its number."""
        if not self._is_heard:
            self.numbers.take(message.source, "")
            return
        report = Report(
            message.stamp_ns,
            channel,
            ObservationKind.MESSAGE,
            message.type_name,
            message.payload,
            message.source,
            message.life,
        )
        self._report(report, message.number)

    def taken(self, node: str, message: Sent, channel: str) -> None:
        """Tell taps that ``node`` begins to handle a message."""
        if not self._is_heard:
            self.numbers.take(node, "")
            return
        if self._rules is Rules.ROS2 and not self._witnesses:
            return
        report = Report(
            self._world.stamp_of(node),
            channel,
            ObservationKind.MESSAGE_TAKEN,
            message.type_name,
            None,
            node,
            self._life_of(node),
            message.source,
            message.life,
            message.number,
        )
        self._report(report)

    def reported(self, node: str) -> Answer:
        """Up to where ``node`` has reported everything: here all is sent when it happens."""
        clock_ns = self._world.stamp_of(node)
        return Answer(clock_ns, self.numbers.next(node, ""), clock_ns, life=self._life_of(node))

    def service_event(
        self,
        source: str,
        service: Service,
        kind: ObservationKind,
        payload: bytes | None,
        client: Node,
        call: int,
        error: str = "",
    ) -> None:
        """Tell taps what happened in a call."""
        if not self._is_heard:
            self.numbers.take(source, "")
            return
        suffix = "_Request" if kind in REQUESTS else "_Response"
        report = Report(
            self._world.stamp_of(source),
            service.name,
            kind,
            service.type_name + suffix,
            payload,
            source,
            self._life_of(source),
            client.node,
            client.life,
            call,
            error,
        )
        self._report(report)

    def _life_of(self, node: str) -> int:
        there = self._world.nodes.get(node)
        return 0 if there is None else int(there.life)

    def _report(self, report: Report, number: int | None = None) -> None:
        """Tell taps; ``number`` is of what is numbered whether anybody listens or not."""
        kind, source, channel = report.kind, report.source, report.channel
        report.place = channel + _SUFFIXES.get(kind, EVENT_SUFFIX)
        if self._witnesses:
            self._bear_witness(report)
        is_ros = self._rules is Rules.ROS2
        if is_ros and kind is ObservationKind.MESSAGE_TAKEN:
            return
        if source in self._world.conditions.plain and kind is not ObservationKind.MESSAGE:
            shown = self._world.conditions.introspection_of(source, channel)
            if shown is Introspection.OFF or report.error:
                return
            if shown is Introspection.METADATA:
                report.payload = None
        report.order = -1 if is_ros else self.numbers.take(source, "")
        found = [(tap, tap.heard(source, channel, kind)) for tap in self._taps]
        links = [(tap, link) for tap, link in found if link is not None]
        if not links:
            return
        if number is None:
            # ROS 2 has no event of a call that failed
            is_numbered = not (is_ros and report.error)
            number = self.numbers.take(source, report.place) if is_numbered else -1
        report.sequence = number
        for tap, link in links:
            self._world.send_to_tap(link, tap.arrive, report)

    def _bear_witness(self, report: Report) -> None:
        source, world, payload = report.source, self._world, report.payload
        stamp_ns = world.true_stamp() if world.clocks.differ else report.stamp_ns
        sequence = self._true_numbers.take(source, report.place)
        order = self._true_numbers.take(source, "")
        data = None if payload is None else plain(payload)
        seen = report.observation(stamp_ns, stamp_ns, data, sequence, order, report.client)
        for witness in self._witnesses:
            witness(seen)


class Ends(Protocol):
    """Who serves and calls what; see ``transports.simulated.services.Services``."""

    def without_introspection(self, conditions: Conditions) -> set[tuple[str, str]]:
        """Services, each with a node that shows no call; there is a server of that kind, and a client."""
        ...


class Listening(Node, Protocol):
    """A node that may have taps."""

    routes: Routes
    view: View

    @property
    def services(self) -> Ends:
        """Who serves and calls what in the world."""
        ...


class Tap(Closes):
    """A passive listener; see ``transports.interface.Tap``."""

    def __init__(
        self,
        node: Listening,
        globs: Sequence[str],
        handler: Callable[[Observation], None],
    ) -> None:
        self._node = node
        self.wants = channel_filter(globs)
        self._handler = handler
        self._losses = Losses()
        self._closed = False
        world = node.world
        self._began_ns = world.now_ns
        self._finds_at_once = world.network.finds_at_once
        self._unread = world.conditions.unread
        self._names_late = world.conditions.rules is Rules.ROS2 and not world.network.finds_at_once
        """Whether a name is known some time after its node."""
        self._found: dict[Link, tuple[int, int]] = {}
        """Of each link, when its source connected and from when on it is heard (ns)."""
        self._named_ns: dict[str, tuple[int, int]] = {}
        """Of each client, when it connected and from when on its name is known (ns)."""
        self._nameless: dict[tuple[str, str, int, int], str] = {}
        """What stands for a client's name in each call that was heard before that is known."""
        """From when on nothing shows of the calls of each service of which nothing does (ns)."""
        self._links: dict[tuple[str, str, bool], Link] = {}
        self._links_of: defaultdict[str, list[Link]] = defaultdict(list)
        """Of each source, the same links."""
        node.listens = True
        node.routes.add(self)

    @property
    def is_complete(self) -> bool:
        """Whether it has found all that were there when it was opened."""
        world = self._node.world
        return world.now_ns >= self._began_ns + world.network.longest_discovery_ns

    def heard(self, source: str, channel: str, kind: ObservationKind) -> Link | None:
        """On which this kind of observation comes here, in its order.

        None: this tap does not want it, or ``source`` has not found this tap on ``channel``.
        """
        if not self.wants(channel):
            return None
        place = (source, channel, kind is ObservationKind.MESSAGE_TAKEN)
        link = self._links.get(place)
        if link is None:
            suffix = TAKEN_SUFFIX if place[2] else ""
            link = self._links[place] = Link(source, channel + suffix, self._node.node)
            self._links_of[source].append(link)
        return link if self._finds_at_once or self._is_found(link, source) else None

    def _is_found(self, link: Link, source: str) -> bool:
        world = self._node.world
        there = world.nodes.get(source)
        connected_ns = 0 if there is None else there.connected_ns
        if connected_ns >= self._began_ns and world.conditions.rules is Rules.ZENOH:
            return True  # who connects waits for those who are there
        found = self._found.get(link)
        if found is None or found[0] != connected_ns:  # it has started again
            since_ns = max(self._began_ns, connected_ns)
            found = self._found[link] = connected_ns, since_ns + world.network.discovery_ns()
        return found[1] <= world.now_ns

    def ask(
        self, node: str, answered: Callable[[Answer | None], None], within_s: float = 1.0
    ) -> None:
        """See ``transports.interface.Tap``: question and answer take as long as any message."""
        here, world = self._node, self._node.world
        network = world.network
        open_ = [answered]

        def end(answer: Answer | None) -> None:
            if open_ and not self._closed:
                open_.pop()(answer)

        def asked(_: object) -> None:
            asked_node = world.nodes.get(node)
            if asked_node is None or not asked_node.is_announced:
                return  # it has gone
            answer = here.routes.reported(node)
            came = self._links_of.get(node, ())
            world.send(network.link(node, _ASKING, here.node), arrived, answer, behind=came)

        def arrived(answer: Answer) -> None:
            here.work(end, answer)

        there = world.nodes.get(node)
        cannot = world.conditions.rules is Rules.ROS2 or here.view.contested.is_contested(node)
        if cannot or there is None or not there.is_announced:
            world.schedule(0, lambda _: here.work(end, None), None)
            return
        world.schedule(max(0, round(within_s * 1e9)), lambda _: here.work(end, None), None)
        world.send(network.link(here.node, _ASKING, node), asked, None)

    def is_contested(self, name: str) -> bool:
        """See ``transports.interface.Tap``."""
        return self._node.view.contested.is_contested(name)

    def take_dropped(self) -> Sequence[tuple[str, str]]:
        """Nothing: a world waits for its taps."""
        return ()

    def blind_spots(self) -> Mapping[BlindSpot, str]:
        """See ``transports.interface.Tap``: what the world's conditions say."""
        received = BlindSpotKind.NOT_RECEIVED
        found = {
            BlindSpot(received, channel): f"{channel} is not received: its type is not there"
            for channel in self._unread
        }
        world = self._node.world
        if world.conditions.plain:
            found |= {
                BlindSpot(
                    received, *end
                ): f"calls on {end[0]} are not received: it has no introspection"
                for end in self._node.services.without_introspection(world.conditions)
            }
        return found

    def peers(self) -> Sequence[str]:
        """Names of the other nodes: in one world all are linked."""
        return sorted(name for name in self._node.world.nodes if name != self._node.node)

    def problems(self) -> Sequence[str]:
        """What was lost or could not be decoded."""
        return [*self._losses.sentences(), *dict.fromkeys(self.blind_spots().values())]

    def close(self) -> None:
        """Stop listening; idempotent."""
        self._closed = True
        self._node.routes.remove(self)

    def arrive(self, report: Report) -> None:
        """An observation is here."""
        self._node.work(self._receive, report)

    def _receive(self, report: Report) -> None:
        if self._closed or report.channel in self._unread:
            return
        payload = report.payload
        if report.sequence >= 0:
            self._losses.number(report.place, report.source, report.sequence, report.stamp_ns)
        try:
            data = None if payload is None else plain(payload)
        except PayloadError as error:
            self._losses.undecodable(report.channel, report.source, error)
            return
        client = report.client
        if self._names_late and report.kind not in _SUFFIXES and not report.error:
            client = self._caller(report.channel, client, report.call, report.client_life)
        here_ns = self._node.now_ns()
        self._handler(
            report.observation(
                report.stamp_ns, here_ns, data, report.sequence, report.order, client
            )
        )

    def _caller(self, service: str, client: str, call: int, life: int) -> str:
        """Who made a call, the same for all events of it, where a name is known some time after a node."""
        world = self._node.world
        place = (service, client, call, life)
        there = world.nodes.get(client)
        if there is None or there.life != life:  # what it was called stays
            return self._nameless.get(place, client)
        connected_ns = there.connected_ns
        named = self._named_ns.get(client)
        if named is None or named[0] != connected_ns:
            since_ns = max(connected_ns, self._began_ns)
            named = self._named_ns[client] = connected_ns, since_ns + world.network.discovery_ns()
        if place not in self._nameless and world.now_ns < named[1]:
            self._nameless[place] = f"{NAMELESS}{client.encode().hex()}{connected_ns:x}"
        return self._nameless.get(place, client)
