"""From observations to lines: requests are matched with their responses, both ends of a call merged."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

import msgspec

from transports.interface import Observation, ObservationKind

MAX_OPEN_CALLS = 10_000
"""Calls remembered while their response is awaited; the oldest is forgotten beyond that."""

_REQUESTS = (ObservationKind.REQUEST_SENT, ObservationKind.REQUEST_RECEIVED)
_CLIENT_END = (ObservationKind.REQUEST_SENT, ObservationKind.RESPONSE_RECEIVED)


class Line(msgspec.Struct, frozen=True, omit_defaults=True):
    """One thing that happened, as the tap shows it.

    Attributes:
        stamp_ns: when, where it happened.
        kind: ``message``, ``request``, ``response`` or ``unanswered``.
        channel: topic or service.
        source: who published, asked or answered.
        data: the message's fields.
        type_name: its type.
        client: who asked, for responses.
        call: number of the call at its client.
        round_trip_us: request to response at the client (or, if only the server is heard, there).
        error: how a call without a response ended.
    """

    stamp_ns: int
    kind: str
    channel: str
    source: str
    data: Any = None
    type_name: str = ""
    client: str = ""
    call: int = 0
    round_trip_us: float | None = None
    error: str = ""


class _Call(msgspec.Struct):
    """An open call, with the end of its request that counts."""

    request: Observation


class CallMatcher:
    """Turns observations into lines, each request and each response once.

    A call is heard at both ends where both publish service events: the request is shown when the
    first end is heard. The response is shown from the client's end if that is heard to have sent
    the request, because its round trip is the one a user feels.
    """

    def __init__(self) -> None:
        self._open: OrderedDict[tuple[str, str, int], _Call] = OrderedDict()

    @property
    def open_calls(self) -> int:
        """How many requests await their response."""
        return len(self._open)

    def feed(self, seen: Observation) -> Line | None:
        """The line for ``seen``; None if its other end was shown already."""
        if seen.kind is ObservationKind.MESSAGE:
            return Line(
                seen.stamp_ns, "message", seen.channel, seen.source, seen.data, seen.type_name
            )
        key = (seen.channel, seen.client, seen.call)
        if seen.kind in _REQUESTS:
            return self._request(key, seen)
        return self._response(key, seen)

    def _request(self, key: tuple[str, str, int], seen: Observation) -> Line | None:
        known = self._open.get(key)
        if known is not None:
            if seen.kind is ObservationKind.REQUEST_SENT:
                known.request = seen
            return None
        self._open[key] = _Call(seen)
        if len(self._open) > MAX_OPEN_CALLS:
            self._open.popitem(last=False)
        return Line(
            seen.stamp_ns,
            "request",
            seen.channel,
            seen.client or seen.source,
            seen.data,
            seen.type_name,
            call=seen.call,
        )

    def _response(self, key: tuple[str, str, int], seen: Observation) -> Line | None:
        call = self._open.get(key)
        if call is None:
            return None
        if seen.kind is ObservationKind.RESPONSE_SENT:
            if call.request.kind is ObservationKind.REQUEST_SENT:
                return None  # the client's end follows
        del self._open[key]
        same_end = (seen.kind in _CLIENT_END) == (call.request.kind in _CLIENT_END)
        trip = (seen.stamp_ns - call.request.stamp_ns) / 1000 if same_end else None
        return Line(
            seen.stamp_ns,
            "response",
            seen.channel,
            seen.source if seen.kind is ObservationKind.RESPONSE_SENT else "",
            seen.data,
            seen.type_name,
            client=seen.client,
            call=seen.call,
            round_trip_us=trip,
            error=seen.error,
        )

    def unanswered(self, now_ns: int, after_s: float) -> list[Line]:
        """Requests that have waited longer than ``after_s``; each is reported once."""
        late = [
            (key, call)
            for key, call in self._open.items()
            if now_ns - call.request.stamp_ns > after_s * 1e9
        ]
        lines = []
        for key, call in late:
            del self._open[key]
            request = call.request
            lines.append(
                Line(
                    request.stamp_ns,
                    "unanswered",
                    request.channel,
                    request.client or request.source,
                    request.data,
                    call=request.call,
                    error=f"no response for {after_s:g} s",
                )
            )
        return lines
