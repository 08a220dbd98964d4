"""What is fit to be judged: stamps, types and sources of what is heard, looked at before the oracles.

Nothing that comes over a network is trusted to be well-formed. What no oracle can judge is counted,
and the oracles that it concerns are told that they missed something: never a wrong verdict.
"""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import InterfaceKind, Machine
from m2c.runtime.messages import message_class
from moon.monitor.status import Counts, Rejected
from moon.oracle.channels import MIDDLEWARE_CHANNELS, MIDDLEWARE_ENDINGS
from transports.interface import Observation, ObservationKind

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
        self._topics: dict[str, tuple[str, type[msgspec.Struct]]] = {}
        self._known: set[str] = set()
        for machine in machines:
            for interface in machine.interfaces:
                if interface.channel is None or interface.kind is InterfaceKind.TIMER:
                    continue
                self._known.add(interface.channel)
                if interface.kind in (InterfaceKind.PUBLISHER, InterfaceKind.SUBSCRIBER):
                    structure = library.message(interface.type_name)
                    self._topics[interface.channel] = (
                        interface.type_name,
                        message_class(structure),
                    )

    def judge(self, seen: Observation, now_ns: int) -> Observation | Rejected:
        """``seen``, perhaps with a more careful stamp, or why it cannot be judged."""
        counts = self._counts
        counts.heard += 1
        channel = seen.channel
        if channel not in self._known and channel.partition("/_action/")[0] not in self._known:
            self._note_unknown(channel)
        ahead_ns = seen.stamp_ns - now_ns
        if ahead_ns > self._latency_ns // 2:
            counts.future += 1
            return Rejected(
                f"an event on {channel} is stamped {ahead_ns / 1e9:.1f} s in the future: "
                "the clocks of its node and of this monitor differ"
            )
        if seen.kind is not ObservationKind.MESSAGE:
            return seen
        expected = self._topics.get(channel)
        if expected is not None and not _is_of(seen, *expected):
            counts.mistyped += 1
            return Rejected()
        if not seen.source:
            # perhaps stamped only when it came here: who took it may have had it before
            counts.unnamed += 1
            stamp_ns = seen.stamp_ns - self._latency_ns // 2
            return msgspec.structs.replace(seen, stamp_ns=stamp_ns)
        return seen

    def know(self, channels: Iterable[str]) -> None:
        """``channels`` are named by somebody, though by no model."""
        self._known.update(channels)

    def _note_unknown(self, channel: str) -> None:
        if channel.startswith(MIDDLEWARE_CHANNELS) or channel.endswith(MIDDLEWARE_ENDINGS):
            return
        unknown = self._counts.unknown
        if channel not in unknown and len(unknown) >= MAX_UNKNOWN:
            channel = _OTHERS
        unknown[channel] += 1


def _is_of(seen: Observation, type_name: str, message: type[msgspec.Struct]) -> bool:
    """Whether a node that expects ``type_name`` takes the message (else its transport drops it)."""
    if seen.type_name and seen.type_name != type_name:
        return False
    if seen.type_name and seen.sequence >= 0:
        return True  # encoded by a typed publisher
    try:
        msgspec.convert(seen.data, message)
    except msgspec.ValidationError:
        return False
    return True
