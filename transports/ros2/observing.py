"""What a tap took from a topic, as an observation: a message, an event of a service, or how a call ended."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any, Protocol

from transports import ros_forms
from transports.bounded import BoundedDict
from transports.channel_filter import matches
from transports.fields_read import FieldsRead
from transports.interface import NAMELESS, Observation, ObservationKind
from transports.losses import Losses
from transports.payloads import PayloadError
from transports.refusals import MOST_PLACES, shown
from transports.ros2 import cdr, event_cdr, native
from transports.ros2.graph import Graph
from transports.ros2.native import Taken
from transports.ros2.numbering import Numbers
from transports.ros2.roster import Roster
from transports.service_events import EVENT_SUFFIX, KIND_OF_EVENT

Place = tuple[bytes, int]
"""The GID of who called, and the number of the call."""


class Notes:
    """What a tap keeps of all that it has received.

    Args:
        graph: who knows names.
        roster: which participants are whose.
        prefix: put before every channel.
    """

    def __init__(self, graph: Graph, roster: Roster, prefix: str) -> None:
        self.graph = graph
        self._roster = roster
        self.prefix = prefix
        self.losses = Losses()
        self.without_contents: dict[str, str] = {}
        """By service, that its events have no contents."""
        self.other_clock: dict[str, str] = {}
        """By service, that its events are stamped by another clock than DDS's."""
        self._numbers = Numbers()
        self._foreign: dict[tuple[str, bytes], int] = {}
        """Messages in the name of a node that another participant is."""
        self._nameless_calls: BoundedDict[tuple[bytes, int], str] = BoundedDict(_KEPT_CALLS)
        """What stands for the client's name in each of them."""
        self.unanswered: BoundedDict[tuple[str, bytes, int], None] = BoundedDict(_KEPT_CALLS)
        """Service, client and number of each call that a server took which is not one of ours."""

    def numbered(self, topic: str, channel: str, taken: Taken) -> tuple[str, int, int] | None:
        """Who published, the number of it, and in which life; what is missing before it is noted.

        None where it is in the name of a node that has announced itself, and is another participant.
        """
        source = self.graph.publisher_of(topic, taken.gid)
        if not self.is_of(source, taken.gid):
            return None
        number = self._numbers.number(channel, source, taken.gid, taken.number)
        life = ros_forms.life_of(taken.gid)
        if number >= 0:
            self.losses.number(channel, source, number, taken.source_ns, life)
        return source, number, life

    def follow_call(self, service: str, server: str, kind: ObservationKind, place: Place) -> None:
        """Note which calls ``server`` has taken and not answered; ours report in any case how calls end."""
        if kind is ObservationKind.RESPONSE_SENT:
            self.unanswered.pop((service, *place), None)
        elif kind is ObservationKind.REQUEST_RECEIVED and not self._roster.is_there(server):
            self.unanswered[service, *place] = None

    def is_of(self, name: str, gid: bytes) -> bool:
        """Whether an endpoint may be of the node ``name``; it is noted if not."""
        if not name or self._roster.is_of(name, gid):
            return True
        place = (name, native.participant_of(gid))
        if place in self._foreign or len(self._foreign) < MOST_PLACES:
            self._foreign[place] = self._foreign.get(place, 0) + 1
        return False

    def foreign(self) -> list[str]:
        """Who sends in whose name, one sentence each."""
        return [
            f"{count} message{'s' * (count != 1)} in the name of {shown(name)}, but sent by another "
            f"participant, {participant.hex()}: treated as unnamed"
            for (name, participant), count in sorted(self._foreign.copy().items())
        ]

    def caller(self, service: str, gid: bytes, call: int) -> str:
        """Who made a call, by the client's GID; the same for all events of the call, a name or not.

        Who receives the events of a call matches them by it: they must not change sides when the graph shows
        the name in between.
        """
        calls = self._nameless_calls
        known = calls.get((gid, call)) if calls else None
        if known is None:
            known = self.graph.client_of(service, gid)
            if not known:
                known = calls[gid, call] = NAMELESS + gid.hex()
        return known


_KEPT_CALLS = 4096
"""Calls that are remembered, of clients without a name, and of those that wait for their answer."""


_OTHER_CLOCK_NS = 10_000_000_000
"""An event is published within this after it was stamped, however busy its node is."""


class Observing(Protocol):
    """Makes observations of what was taken from one topic (data: as ``read`` reads it)."""

    def read_only(self, fields: FieldsRead) -> None:
        """Only ``fields`` need be read from now on (see ``transports.interface.ReadsParts``)."""
        ...

    @property
    def read(self) -> Callable[[bytes], Any]:
        """Reads a payload; it raises CdrError."""
        ...

    def stamp_ns(self, taken: Taken, data: Any) -> int:
        """When it happened."""
        ...

    def nameless(self, taken: Taken, data: Any) -> tuple[bytes, ...]:
        """The GIDs in it that have no name yet, but may still get one."""
        ...

    def observation(self, taken: Taken, data: Any) -> Observation | None:
        """What happened; None if that is no concern of the tap's."""
        ...


class Messages:
    """Of an ordinary topic."""

    def __init__(self, notes: Notes, topic: str, type_name: str, ros: Any) -> None:
        self.read: Callable[[bytes], Any] = cdr.reader(ros)
        self._ros = ros
        self._notes = notes
        self._topic = topic
        self._channel = topic.removeprefix(notes.prefix)
        self._type_name = type_name

    def read_only(self, fields: FieldsRead) -> None:
        """See ``Observing``."""
        self.read = cdr.reader(self._ros, fields(self._channel))

    def stamp_ns(self, taken: Taken, data: Any) -> int:
        """See ``Observing``."""
        return taken.source_ns

    def nameless(self, taken: Taken, data: Any) -> tuple[bytes, ...]:
        """See ``Observing``."""
        return () if self._notes.graph.publisher_of(self._topic, taken.gid) else (taken.gid,)

    def observation(self, taken: Taken, data: Any) -> Observation | None:
        """See ``Observing``."""
        source, number, life = self._notes.numbered(self._topic, self._channel, taken) or (
            "",
            -1,
            0,
        )
        received_ns = taken.received_ns or time.time_ns()
        stamp_ns = taken.source_ns if taken.source_ns > 0 else received_ns
        received = ros_forms.Received(received_ns, source, number, life)
        return ros_forms.of_message(self._channel, self._type_name, data, stamp_ns, received)


class Events:
    """Of a service's event topic."""

    def __init__(self, notes: Notes, topic: str, type_name: str, ros: Any) -> None:
        self.read: Callable[[bytes], Any] = event_cdr.reader(ros)
        self._ros = ros
        self._notes = notes
        self._topic = topic
        self._service = topic.removesuffix(EVENT_SUFFIX)
        self._channel = self._service.removeprefix(notes.prefix)
        self._type_name = type_name

    def read_only(self, fields: FieldsRead) -> None:
        """See ``Observing``."""
        self.read = event_cdr.reader(self._ros, fields(self._channel))

    def stamp_ns(self, taken: Taken, data: event_cdr.Event) -> int:
        """See ``Observing``."""
        return data.stamp_ns

    def nameless(self, taken: Taken, data: event_cdr.Event) -> tuple[bytes, ...]:
        """See ``Observing``."""
        graph, client = self._notes.graph, data.gid
        known = graph.publisher_of(self._topic, taken.gid)
        asker = graph.client_of(self._service, client)
        if known and asker:
            return ()
        return (*(() if known else (taken.gid,)), *(() if asker else (client,)))

    def observation(self, taken: Taken, data: event_cdr.Event) -> Observation | None:
        """See ``Observing``."""
        numbered = self._notes.numbered(self._topic, self._channel, taken)
        if numbered is None:
            return None
        source, number, life = numbered
        event_type, source_ns = data.event_type, taken.source_ns
        fault = None
        if event_type >= len(KIND_OF_EVENT):
            fault = PayloadError(f"unknown event type {event_type}")
        elif data.stamp_ns < 0 or data.call < 0:
            fault = PayloadError(f"stamped {data.stamp_ns} ns, number {data.call}: less than 0")
        if fault is not None:
            self._notes.losses.undecodable(self._topic, source, fault)
            return None
        if source_ns and abs(source_ns - data.stamp_ns) > _OTHER_CLOCK_NS:
            self._notes.other_clock.setdefault(
                self._service,
                f"the events of {self._service} are stamped by another clock than the time of day: give "
                "configure_introspection a Clock(clock_type=ClockType.SYSTEM_TIME)",
            )
        place = data.gid, data.call
        self._notes.follow_call(self._service, source, KIND_OF_EVENT[event_type], place)
        if data.contents is None:
            self._notes.without_contents.setdefault(
                self._service,
                f"the events of {self._service} carry no contents: ask for "
                "ServiceIntrospectionState.CONTENTS instead of METADATA",
            )
        event = ros_forms.CallEvent(
            event_type=event_type,
            stamp_ns=data.stamp_ns,
            call=data.call,
            client=self._notes.caller(self._service, data.gid, data.call),
            client_life=ros_forms.life_of(data.gid),
            contents=data.contents,
        )
        received = ros_forms.Received(taken.received_ns or time.time_ns(), source, number, life)
        return ros_forms.of_event(self._channel, self._type_name, event, received)


class Errors:
    """Of the topic on which it is reported how calls ended without a response."""

    def __init__(self, notes: Notes, topic: str, globs: Sequence[str], ros: Any) -> None:
        self.read: Callable[[bytes], Any] = cdr.reader(ros)
        self._notes = notes
        self._topic = topic
        self._globs = globs

    def read_only(self, fields: FieldsRead) -> None:
        """All of it is read."""

    def stamp_ns(self, taken: Taken, data: Any) -> int:
        """See ``Observing``."""
        return taken.source_ns

    def nameless(self, taken: Taken, data: Any) -> tuple[bytes, ...]:
        """See ``Observing``."""
        return () if self._notes.graph.publisher_of(self._topic, taken.gid) else (taken.gid,)

    def observation(self, taken: Taken, data: Any) -> Observation | None:
        """See ``Observing``."""
        notes = self._notes
        try:
            error = ros_forms.read_call_error(data["data"])
        except PayloadError as fault:
            source = notes.graph.publisher_of(self._topic, taken.gid)
            notes.losses.undecodable(self._topic, source, fault)
            return None
        if not matches(error.service, self._globs) or not notes.is_of(error.node, taken.gid):
            return None
        return ros_forms.of_call_error(
            error,
            error.service.removeprefix(notes.prefix),
            taken.received_ns or time.time_ns(),
            ros_forms.life_of(taken.gid),
        )
