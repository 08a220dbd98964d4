"""The observations that a page shows: those of a recording, thinned out where there are too many.

All of them are read, a bounded number is kept. Those that led to a violation are kept first; of the
others every second one, then every fourth and so on, so that what is left is spread over the whole
recording and does not depend on how long it is.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Sequence

import msgspec

from m2c.printable import printable
from moon.wording import Wording
from transports.interface import Observation, ObservationKind

MAX_SHOWN = 150_000
"""A page of so many observations opens within two seconds, and takes some 3 MB."""
MAX_NEAR = 50_000
"""Of these, at most so many because a violation followed."""
NEAR_NS = 2_000_000_000
"""What was received so long before a violation may have led to it."""
MAX_CHANNELS, MAX_SOURCES = 400, 2_000
"""Names come from the wire, and need not end: so many channels and nodes are distinguished."""
MAX_TEXT = 120
MAX_TEXTS = 4_000_000
"""Characters of distinct texts that a page has; what is received after that is shown without its contents."""

_SIGNS = {
    ObservationKind.MESSAGE: "m",
    ObservationKind.REQUEST_SENT: "q",
    ObservationKind.REQUEST_RECEIVED: "q",
    ObservationKind.RESPONSE_SENT: "r",
    ObservationKind.RESPONSE_RECEIVED: "r",
}
FAILED = "x"


class Shown(msgspec.Struct, frozen=True, gc=False):
    """One observation: its number on its channel, when it was received, and what it says.

    ``sign`` is ``m`` (message), ``q`` (request), ``r`` (response) or ``x`` (failed call); ``text`` and
    ``source`` are indices.
    """

    number: int
    received_ns: int
    sign: str
    text: int
    source: int
    near: bool


class Channel(msgspec.Struct):
    """A channel's observations; ``received`` counts those that are not shown, too."""

    name: str
    type_name: str
    received: int = 0
    shown: list[Shown] = []


class Shelf:
    """Collects observations channel by channel.

    Args:
        violations_ns: when violations were reported, on the recorder's clock.
        wording: the definitions by which numbers have names.

    Attributes:
        received: all that it was handed.
        of_other_channels: what is left out because there are too many channels.
    """

    def __init__(self, violations_ns: Iterable[int], wording: Wording | None = None) -> None:
        self._wording = wording or Wording()
        self._violations = sorted(violations_ns)
        self._channels: dict[str, Channel] = {}
        self._texts: dict[str, int] = {"": 0}
        self._characters = 0
        self._sources: dict[str, int] = {"": 0}
        self._stride = 1
        self._near = self._far = 0
        self.received = self.of_other_channels = 0

    def take(self, seen: Observation) -> None:
        """Keep ``seen``, or not: which nodes took a message is not shown."""
        if seen.kind is ObservationKind.MESSAGE_TAKEN:
            return
        self.received += 1
        channel = self._channels.get(seen.channel)
        if channel is None:
            if len(self._channels) >= MAX_CHANNELS:
                self.of_other_channels += 1
                return
            channel = Channel(printable(seen.channel), printable(seen.type_name), shown=[])
            self._channels[seen.channel] = channel
        number = channel.received
        channel.received += 1
        near = self._near < MAX_NEAR and self._is_near(seen.received_ns)
        if not near and number % self._stride:
            return
        sign = FAILED if seen.error else _SIGNS[seen.kind]
        source = self._sources.get(printable(seen.source), 0)
        if not source and len(self._sources) < MAX_SOURCES:
            source = self._sources.setdefault(printable(seen.source), len(self._sources))
        text = self._text(seen)
        channel.shown.append(Shown(number, seen.received_ns, sign, text, source, near))
        if near:
            self._near += 1
            return
        self._far += 1
        if self._far > MAX_SHOWN - MAX_NEAR:
            self._thin_out()

    @property
    def shown(self) -> int:
        """How many are kept."""
        return self._near + self._far

    def channels(self) -> list[Channel]:
        """By name; in each, in the order in which they were received."""
        found = [self._channels[name] for name in sorted(self._channels)]
        for channel in found:
            channel.shown.sort(key=lambda one: one.received_ns)
        return found

    def texts(self) -> Sequence[str]:
        """What :attr:`Shown.text` counts."""
        return list(self._texts)

    def sources(self) -> Sequence[str]:
        """What :attr:`Shown.source` counts."""
        return list(self._sources)

    def _is_near(self, received_ns: int) -> bool:
        after = bisect_right(self._violations, received_ns - 1)
        return after < len(self._violations) and self._violations[after] - received_ns <= NEAR_NS

    def _text(self, seen: Observation) -> int:
        words = printable(seen.error) if seen.error else ""
        if not words and seen.data is not None:
            words = self._wording.message(seen.data, seen.type_name)
        if seen.client:
            words = f"#{seen.call} of {printable(seen.client)}  {words}".rstrip()
        words = words if len(words) <= MAX_TEXT else words[: MAX_TEXT - 1] + "…"
        found = self._texts.get(words)
        if found is None:
            if self._characters + len(words) > MAX_TEXTS:
                return 0
            self._characters += len(words)
            found = self._texts[words] = len(self._texts)
        return found

    def _thin_out(self) -> None:
        self._stride *= 2
        self._far = 0
        for channel in self._channels.values():
            channel.shown = [
                one for one in channel.shown if one.near or not one.number % self._stride
            ]
            self._far += sum(not one.near for one in channel.shown)
