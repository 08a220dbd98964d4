"""From observations to lines: requests are matched with their responses, both ends of a call merged."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

import msgspec

from transports.interface import Observation, ObservationKind

MAX_OPEN_CALLS = 10_000
"""Calls remembered while their response is awaited; the oldest is forgotten beyond that."""

CLIENT_SILENCE_S = 0.5
"""How long the client's end of an answered call is awaited before the server's is shown."""

Key = tuple[str, str, int]

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
    """An open call: the end of its request that counts, and the server's answer if it was heard."""

    request: Observation
    answer: Observation | None = None


class CallMatcher:
    """Turns observations into lines, each request and each response once.

    A call is heard at both ends where both publish service events, in an order that need not be the
    order in which things happened. The request is shown when its first end is heard. The response
    is shown from the client's end, because its round trip is the one a user feels; if that end stays
    silent (a client of somebody else's), from the server's, a moment later.
    """

    def __init__(self) -> None:
        self._open: OrderedDict[Key, _Call] = OrderedDict()
        self._closed: OrderedDict[Key, None] = OrderedDict()

    @property
    def open_calls(self) -> int:
        """How many requests await their response."""
        return len(self._open)

    def feed(self, seen: Observation) -> Line | None:
        """The line for ``seen``; None if nothing is to be shown (yet)."""
        if seen.kind is ObservationKind.MESSAGE:
            return Line(
                seen.stamp_ns, "message", seen.channel, seen.source, seen.data, seen.type_name
            )
        key = (seen.channel, seen.client, seen.call)
        if key in self._closed:
            return None
        if seen.kind in _REQUESTS:
            return self._request(key, seen)
        return self._response(key, seen)

    def _request(self, key: Key, seen: Observation) -> Line | None:
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

    def _response(self, key: Key, seen: Observation) -> Line | None:
        call = self._open.get(key)
        if call is None:
            return None
        if seen.kind is ObservationKind.RESPONSE_SENT:
            call.answer = seen
            return None
        return self._close(key, call, seen)

    def _close(self, key: Key, call: _Call, seen: Observation) -> Line:
        del self._open[key]
        self._closed[key] = None
        if len(self._closed) > MAX_OPEN_CALLS:
            self._closed.popitem(last=False)
        same_end = (seen.kind in _CLIENT_END) == (call.request.kind in _CLIENT_END)
        trip = (seen.stamp_ns - call.request.stamp_ns) / 1000 if same_end else None
        source = call.answer.source if call.answer is not None else ""
        return Line(
            seen.stamp_ns,
            "response",
            seen.channel,
            source,
            seen.data,
            seen.type_name,
            client=seen.client,
            call=seen.call,
            round_trip_us=trip,
            error=seen.error,
        )

    def answered_unheard(self, now_ns: int) -> list[Line]:
        """Responses whose client's end has stayed silent for :data:`CLIENT_SILENCE_S`."""
        return [
            self._close(key, call, call.answer)
            for key, call in list(self._open.items())
            if call.answer is not None and now_ns - call.answer.received_ns > CLIENT_SILENCE_S * 1e9
        ]

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
            self._closed[key] = None
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
