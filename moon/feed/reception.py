"""What is fit to be judged: stamps, types and sources of what is received, looked at before the oracles.

Nothing that comes over a network is trusted to be well-formed. What no oracle can judge is counted,
and it is reported to the oracles that it concerns as missing: never a wrong verdict.
"""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import InterfaceKind, Machine
from m2c.runtime.messages import message_class
from m2c.suggestions import meant_channel
from moon.feed.counts import Counts
from moon.oracle.channels import MIDDLEWARE_CHANNELS, MIDDLEWARE_ENDINGS
from moon.properties.predicates import ANY_CHANNEL
from transports.actions import parts_of
from transports.calls import request_type, response_type
from transports.channel_filter import whole_of
from transports.interface import REQUESTS, RESPONSES, Action, Observation, ObservationKind, Service

MAX_UNKNOWN = 1_000
"""Channels that no model names, counted by name; names come from the wire, and never end."""
_OTHERS = "(others)"


class Reception:
    """Looks at observations before they are judged.

    Args:
        machines: the models.
        library: their message types.
        latency_ns: the latency bound.
        counts: what is counted.
    """

    def __init__(
        self,
        machines: Iterable[Machine],
        library: InterfaceLibrary,
        latency_ns: int,
        counts: Counts,
    ) -> None:
        self._latency_ns = latency_ns
        self._counts = counts
        self._shapes: dict[tuple[str, ObservationKind], _Shape] = {}
        self._known: set[str] = set()
        self._silent: set[str] = set()
        """Channels of models on which nothing was received."""
        self._meant: dict[str, str] = {}
        """Of channels that no model names: the one that each is a slip for, if it is one."""
        for machine in machines:
            for interface in machine.interfaces:
                if interface.channel is None or interface.kind is InterfaceKind.TIMER:
                    continue
                self._known.add(interface.channel)
                self._silent.add(interface.channel)
                self._expect(interface.kind, interface.channel, interface.type_name, library)

    def _expect(
        self, kind: InterfaceKind, channel: str, type_name: str, library: InterfaceLibrary
    ) -> None:
        if kind in (InterfaceKind.PUBLISHER, InterfaceKind.SUBSCRIBER):
            message = message_class(library.message(type_name))
            self._shapes[channel, ObservationKind.MESSAGE] = _Shape(type_name, message)
        elif kind in (InterfaceKind.SERVER, InterfaceKind.CLIENT):
            service = library.service(type_name)
            request, response = message_class(service.request), message_class(service.response)
            self._expect_service(Service(channel, type_name, request, response))
        else:
            action = library.action(type_name)
            parts = parts_of(
                Action(
                    channel,
                    type_name,
                    message_class(action.goal),
                    message_class(action.result),
                    message_class(action.feedback),
                )
            )
            for part in (parts.send_goal, parts.cancel_goal, parts.get_result):
                self._expect_service(part)
            for topic in (parts.feedback, parts.status):
                shape = _Shape(topic.type_name, topic.message)
                self._shapes[topic.name, ObservationKind.MESSAGE] = shape

    def _expect_service(self, service: Service) -> None:
        for kind in REQUESTS:
            self._shapes[service.name, kind] = _Shape(request_type(service), service.request)
        for kind in RESPONSES:
            self._shapes[service.name, kind] = _Shape(response_type(service), service.response)

    def judge(self, seen: Observation, now_ns: int) -> Observation | str:
        """``seen``, perhaps with a more careful stamp.

        Returns:
            If it cannot be judged: what its machines missed by that, for people; "" if they missed nothing.
        """
        counts = self._counts
        counts.received += 1
        channel = seen.channel
        named = channel if channel in self._known else whole_of(channel)
        if named in self._known:
            self._silent.discard(named)
        else:
            self._note_unknown(channel)
        ahead_ns = seen.stamp_ns - now_ns
        if self.is_future(seen.stamp_ns, now_ns):
            counts.future += 1
            return (
                f"an event on {channel} is stamped {ahead_ns / 1e9:.1f} s in the future: "
                "the clocks of its node and of this monitor differ"
            )
        shape = self._shapes.get((channel, seen.kind))
        is_message = seen.kind is ObservationKind.MESSAGE
        is_bare = not is_message and seen.data is None
        if is_bare and not seen.error and shape is not None:
            if shape.has_contents:
                return f"an event on {channel} has no contents: what was said in it is not known"
            seen = msgspec.structs.replace(seen, data={})
        elif shape is not None and not is_bare:
            read = shape.read(seen)
            if read is None:
                counts.mistyped += 1
                if is_message:
                    return ""
                return f"an event on {channel} is not of its type, {shape.type_name}"
            seen = read
        if not is_message:
            return seen
        if not seen.source:
            # perhaps stamped only when it came here: who took it may have had it before
            counts.unnamed += 1
            stamp_ns = seen.stamp_ns - self._latency_ns // 2
            return msgspec.structs.replace(seen, stamp_ns=stamp_ns)
        return seen

    def is_future(self, stamp_ns: int, now_ns: int) -> bool:
        """Whether what is stamped so cannot have been received at ``now_ns``: its clock is another."""
        return stamp_ns - now_ns > self._latency_ns // 2

    def slips(self) -> list[str]:
        """Where something was received that was meant, but for a slip, for a channel of a model on which
        nothing was received; one sentence each.
        """
        return [
            f"no model names {channel}; did you mean {meant}?"
            for channel, meant in self._meant.items()
            if meant in self._silent
        ]

    def is_named(self, channel: str) -> bool:
        """Whether a model or a property names ``channel``, or the action that it is a part of."""
        return channel in self._known or whole_of(channel) in self._known

    def may_concern(self, channel: str) -> bool:
        """Whether a model or a property is about ``channel``; a property may be about any."""
        return self.is_named(channel) or ANY_CHANNEL in self._known

    def know(self, channels: Iterable[str]) -> None:
        """``channels`` are named by somebody, though by no model."""
        self._known.update(channels)

    def _note_unknown(self, channel: str) -> None:
        if channel.startswith(MIDDLEWARE_CHANNELS) or channel.endswith(MIDDLEWARE_ENDINGS):
            return
        unknown = self._counts.unknown
        if channel not in unknown and len(unknown) >= MAX_UNKNOWN:
            channel = _OTHERS
        elif channel not in unknown:
            whole = whole_of(channel)
            self._meant[whole] = meant_channel(whole, self._known)
        unknown[channel] += 1


class _Shape(msgspec.Struct, frozen=True):
    """What a channel carries: a node that expects ``type_name`` takes nothing else."""

    type_name: str
    message: type[msgspec.Struct]

    @property
    def has_contents(self) -> bool:
        """Whether it says anything."""
        return bool(self.message.__struct_fields__)

    def read(self, seen: Observation) -> Observation | None:
        """``seen`` with what a node makes of its data (fields that are not there have their defaults).

        None if no node takes it: its type is another, or only claims to be this one.
        """
        if seen.type_name and seen.type_name != self.type_name:
            return None
        try:
            data = msgspec.to_builtins(msgspec.convert(seen.data, self.message))
        except (msgspec.ValidationError, TypeError, RecursionError):
            return None
        return seen if data == seen.data else msgspec.structs.replace(seen, data=data)
