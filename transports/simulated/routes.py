"""Who receives what in a simulated world: subscribers, servers, and taps with their observations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from transports.channel_filter import channel_filter
from transports.interface import Answer, Observation, ObservationKind, Service
from transports.losses import Losses
from transports.payloads import PayloadError, plain
from transports.service_events import EVENT_SUFFIX, TAKEN_SUFFIX

if TYPE_CHECKING:
    from transports.simulated.services import Server
    from transports.simulated.transport import SimulatedTransport, Subscription
    from transports.simulated.world import SimulatedWorld

_REQUESTS = (ObservationKind.REQUEST_SENT, ObservationKind.REQUEST_RECEIVED)
_SUFFIXES = {ObservationKind.MESSAGE: "", ObservationKind.MESSAGE_TAKEN: TAKEN_SUFFIX}
"""What is appended to a channel for each kind that is no event of a service."""
_ASKING = "asked"
"""Stands for a channel where a link is named on which questions and answers go."""


class Sent(NamedTuple):
    """A message of a topic: who published it, its number on its channel, and what it is."""

    source: str
    number: int
    type_name: str
    payload: bytes


class Routes:
    """The routing table of one world, and what is reported to its taps."""

    def __init__(self, world: SimulatedWorld) -> None:
        self._world = world
        self._subscriptions: dict[str, list[Subscription]] = {}
        self._servers: dict[str, list[Server]] = {}
        self.transient_local: dict[str, dict[str, Sent]] = {}
        """Channel → source → its last message."""
        self._taps: list[Tap] = []
        self._sequences: dict[tuple[str, str], int] = {}
        """Last numbers per source and channel; of all channels together under \"\"."""

    def subscriptions(self, channel: str) -> list[Subscription]:
        """Who is subscribed to ``channel``."""
        return self._subscriptions.setdefault(channel, [])

    def servers(self, channel: str) -> list[Server]:
        """Who serves ``channel``; a call reaches the first."""
        return self._servers.setdefault(channel, [])

    def add(self, tap: Tap) -> None:
        """``tap`` listens from now on."""
        self._taps.append(tap)

    def remove(self, tap: Tap) -> None:
        """``tap`` listens no more."""
        if tap in self._taps:
            self._taps.remove(tap)

    def message(self, message: Sent, channel: str) -> None:
        """Tell taps of a message, which has its number."""
        source = message.source
        order = self.number(source, "")
        if self._taps:
            self._report(
                channel,
                source,
                {
                    "stamp_ns": self._world.stamp(),
                    "channel": channel,
                    "kind": ObservationKind.MESSAGE,
                    "type_name": message.type_name,
                    "source": source,
                    "sequence": message.number,
                    "order": order,
                },
                message.payload,
            )

    def taken(self, node: str, message: Sent, channel: str) -> None:
        """Tell taps that ``node`` begins to handle a message; without a tap, nothing is recorded."""
        if self._taps:
            self._report(
                channel,
                node,
                {
                    "stamp_ns": self._world.stamp(),
                    "channel": channel,
                    "kind": ObservationKind.MESSAGE_TAKEN,
                    "type_name": message.type_name,
                    "source": node,
                    "sequence": self.number(node, channel + TAKEN_SUFFIX),
                    "order": self.number(node, ""),
                    "client": message.source,
                    "call": message.number,
                },
                None,
            )

    def reported(self, node: str) -> Answer:
        """Up to where ``node`` has reported everything: here all is sent when it happens."""
        return Answer(self._world.stamp(), self._sequences.get((node, ""), 0))

    def service_event(
        self,
        source: str,
        service: Service,
        kind: ObservationKind,
        payload: bytes | None,
        client: str,
        call: int,
        error: str = "",
    ) -> None:
        """Tell taps what happened in a call; without a tap, nothing is recorded."""
        if not self._taps:
            return
        suffix = "_Request" if kind in _REQUESTS else "_Response"
        self._report(
            service.name,
            source,
            {
                "stamp_ns": self._world.stamp(),
                "channel": service.name,
                "kind": kind,
                "type_name": service.type_name + suffix,
                "source": source,
                "sequence": self.number(source, service.name + EVENT_SUFFIX),
                "order": self.number(source, ""),
                "client": client,
                "call": call,
                "error": error,
            },
            payload,
        )

    def number(self, source: str, channel: str) -> int:
        """The next number of ``source`` on ``channel``."""
        place = (source, channel)
        sequence = self._sequences.get(place, 0)
        self._sequences[place] = sequence + 1
        return sequence

    def _report(
        self, channel: str, source: str, fields: dict[str, Any], payload: bytes | None
    ) -> None:
        for tap in self._taps:
            if tap.wants(channel):
                link = (source, _SUFFIXES.get(fields["kind"], EVENT_SUFFIX), channel, tap)
                tap.links.setdefault(source, {})[link] = None
                self._world.send_to_tap(link, tap.arrive, (fields, payload))


class Tap:
    """A passive listener; see ``transports.interface.Tap``."""

    def __init__(
        self,
        node: SimulatedTransport,
        globs: Sequence[str],
        handler: Callable[[Observation], None],
    ) -> None:
        self._node = node
        self.wants = channel_filter(globs)
        self._handler = handler
        self._losses = Losses()
        self._closed = False
        self.links: dict[str, dict[object, None]] = {}
        """Of each source, the links on which it has reported to this tap."""
        node.routes.add(self)

    @property
    def is_complete(self) -> bool:
        """It receives everything at once."""
        return True

    def ask(
        self, node: str, answered: Callable[[Answer | None], None], within_s: float = 1.0
    ) -> None:
        """See ``transports.interface.Tap``: question and answer take as long as any message."""
        here, world = self._node, self._node.world
        open_ = [answered]

        def end(answer: Answer | None) -> None:
            if open_ and not self._closed:
                open_.pop()(answer)

        def asked(_: object) -> None:
            asked_node = world.nodes.get(node)
            if asked_node is None or not asked_node.is_announced:
                return  # it has gone
            answer = here.routes.reported(node)
            came = self.links.get(node, ())
            world.send((node, _ASKING, here.node), arrived, answer, behind=came)

        def arrived(answer: Answer) -> None:
            here.work(end, answer)

        there = world.nodes.get(node)
        if there is None or not there.is_announced:
            world.schedule(0, lambda _: here.work(end, None), None)
            return
        world.schedule(max(0, round(within_s * 1e9)), lambda _: here.work(end, None), None)
        world.send((here.node, _ASKING, node), asked, None)

    def is_contested(self, name: str) -> bool:
        """A world has one node of each name."""
        return False

    def take_dropped(self) -> Sequence[tuple[str, str]]:
        """Nothing: a world waits for its taps."""
        return ()

    def peers(self) -> Sequence[str]:
        """Names of the other nodes: in one world all are linked."""
        return sorted(name for name in self._node.world.nodes if name != self._node.node)

    def problems(self) -> Sequence[str]:
        """What was lost or could not be decoded."""
        return self._losses.sentences()

    def close(self) -> None:
        """Stop listening; idempotent."""
        self._closed = True
        self._node.routes.remove(self)

    def arrive(self, sent: tuple[dict[str, Any], bytes | None]) -> None:
        """An observation is here."""
        self._node.work(self._receive, sent)

    def _receive(self, sent: tuple[dict[str, Any], bytes | None]) -> None:
        if self._closed:
            return
        fields, payload = sent
        channel, source = fields["channel"], fields["source"]
        events = _SUFFIXES.get(fields["kind"], EVENT_SUFFIX)
        self._losses.number(channel + events, source, fields["sequence"], fields["stamp_ns"])
        try:
            data = None if payload is None else plain(payload)
        except PayloadError as error:
            self._losses.undecodable(channel, source, error)
            return
        self._handler(Observation(received_ns=self._node.world.now_ns, data=data, **fields))
