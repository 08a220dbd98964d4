"""From observations to lines: requests are matched with their responses, both ends of a call merged."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

import msgspec

from moon.tap.action_parts import SEPARATOR, action_of, part_of, waits_for_the_goal
from transports.bounded import BoundedDict
from transports.interface import CLIENT_END, REQUESTS, CallOutcome, Observation, ObservationKind

MAX_OPEN_CALLS = 10_000
"""Calls remembered while their response is awaited, and calls remembered as ended; the oldest is
forgotten beyond that. Also the number of services whose server is remembered."""

MAX_OPEN_BYTES = 64 * 1024 * 1024
"""What the messages of these calls may take, as they travelled; the oldest are forgotten beyond that, too."""

OTHER_END_SILENCE_S = 0.5
"""How long the other end of an answered call is awaited before one end alone is shown."""

Key = tuple[str, str, int, int]

_NOBODY_ANSWERED = (CallOutcome.TIMEOUT.value, CallOutcome.UNAVAILABLE.value)


TAKEN = "taken"
"""The kind of a line that says that a node took a message."""


class Line(msgspec.Struct, frozen=True, omit_defaults=True):
    """One thing that happened, as the tap shows it.

    Attributes:
        stamp_ns: when, where it happened (ns since the epoch).
        kind: ``message``, ``request``, ``response``, ``unanswered`` or ``taken``.
        channel: topic or service.
        source: who published, asked, answered or took; empty where that is not known.
        data: the message's fields.
        type_name: its type.
        client: who asked, for responses; whose message was taken.
        call: number of the call at its client, or of the message that was taken.
        round_trip_us: request to response at the client (or, if only the server's end is observed, there).
        error: how a call without a response ended.
        action: the action that the channel is a part of.
        part: which part: ``goal``, ``goal response``, ``feedback``, ``result request``, ``result``,
            ``cancel``, ``cancel response`` or ``status``.
        received_ns: when the tap received it, on the tap's clock (ns since the epoch).
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
    action: str = ""
    part: str = ""
    received_ns: int = 0


def nobody_answered(error: str) -> bool:
    """Whether a call that ended with ``error`` had no answer at all (not even an error's)."""
    return error.partition(":")[0] in _NOBODY_ANSWERED


class _Call(msgspec.Struct):
    """A call whose response has not been shown.

    Attributes:
        request: its request, as observed at the end that counts; None if it was not received.
        server: who serves it, once that end was observed.
        answer: the server's end of the response.
        returned: the client's end of the response, kept back until the server's name is known.
        reported: whether it was shown as unanswered.
        size: of the messages that are kept here, bytes.
    """

    request: Observation | None
    server: str = ""
    answer: Observation | None = None
    returned: Observation | None = None
    reported: bool = False
    size: int = 0


def _size_of(seen: Observation) -> int:
    """Of the message, as it travelled, bytes."""
    return 0 if seen.data is None else len(_encode(seen.data))


_encode = msgspec.msgpack.Encoder().encode


class CallMatcher:
    """Turns observations into lines, each request and each response once.

    A call is observed at both ends where both publish service events, in an order that need not be the
    order in which things happened. The request is shown when its first end is observed. The response
    is shown from the client's end, because its round trip is the one a user feels; if that end stays
    silent (a client of somebody else's), from the server's, a moment later. Who answered is known
    from the server's end only: from the same call if it was received in time, else from the calls
    before; the first response of a service waits a moment for it.

    Attributes:
        forgotten: how many calls were dropped because more than :data:`MAX_OPEN_CALLS` were open, or
            their messages took more than :data:`MAX_OPEN_BYTES`.
    """

    def __init__(self) -> None:
        self.forgotten = 0
        self._open: OrderedDict[Key, _Call] = OrderedDict()
        self._closed: BoundedDict[Key, None] = BoundedDict(MAX_OPEN_CALLS)
        self._lives: BoundedDict[str, int] = BoundedDict(MAX_OPEN_CALLS)
        """In which life each client is: it counts its calls anew in the next."""
        self._servers: BoundedDict[str, str] = BoundedDict(
            MAX_OPEN_CALLS
        )  # "": its server says nothing
        self._evicted: list[Line] = []
        self._bytes = 0

    @property
    def open_calls(self) -> int:
        """How many requests await their response."""
        return len(self._open)

    def feed(self, seen: Observation) -> Line | None:
        """The line for ``seen``; None if nothing is to be shown (yet)."""
        if seen.kind is ObservationKind.MESSAGE:
            return _line(seen, "message", seen.source)
        if seen.kind is ObservationKind.MESSAGE_TAKEN:
            return _line(seen, TAKEN, seen.source, client=seen.client)
        if seen.kind not in CLIENT_END and seen.source:
            self._servers[seen.channel] = seen.source
        if not seen.client:  # a tool that numbers no calls: nothing tells one from the next
            return self._unmatched(seen)
        if seen.client_life:
            self._lives[seen.client] = seen.client_life
        key = (seen.channel, seen.client, seen.call, self._lives.get(seen.client, 0))
        if key in self._closed:
            return None
        if seen.kind in REQUESTS:
            return self._request(key, seen)
        return self._response(key, seen)

    def _unmatched(self, seen: Observation) -> Line:
        if seen.kind in REQUESTS:
            return _line(seen, "request", "")
        return _line(seen, "response", seen.source)

    def _request(self, key: Key, seen: Observation) -> Line | None:
        call = self._open.get(key)
        if call is None:
            call = self._opened(key)
        shown_before = call.request is not None
        if not shown_before or seen.kind is ObservationKind.REQUEST_SENT:
            call.request = seen
            self._note_size(call, _size_of(seen))
        if seen.kind is ObservationKind.REQUEST_RECEIVED:
            call.server = seen.source
            if call.returned is not None:
                return self._close(key, call, call.returned)
        return None if shown_before else _line(seen, "request", seen.client)

    def _response(self, key: Key, seen: Observation) -> Line | None:
        call = self._open.get(key)
        if call is None:  # it began before the tap listened, or its request was lost
            call = self._opened(key)
        if seen.kind is ObservationKind.RESPONSE_SENT:
            call.server = seen.source
            call.answer = seen
            self._note_size(call, _size_of(seen))
            return None if call.returned is None else self._close(key, call, call.returned)
        if (
            not call.server
            and seen.channel not in self._servers
            and not nobody_answered(seen.error)
        ):
            call.returned = seen
            self._note_size(call, _size_of(seen))
            return None
        return self._close(key, call, seen)

    def _opened(self, key: Key) -> _Call:
        call = self._open[key] = _Call(None)
        if len(self._open) > MAX_OPEN_CALLS:
            self._forget_oldest()
        return call

    def _note_size(self, call: _Call, size: int) -> None:
        """So much more of ``call`` is kept; others may have to go for it."""
        call.size += size
        self._bytes += size
        while self._bytes > MAX_OPEN_BYTES and next(iter(self._open.values())) is not call:
            self._forget_oldest()

    def _forget_oldest(self) -> None:
        oldest, evicted = self._open.popitem(last=False)
        self._bytes -= evicted.size
        response = evicted.returned or evicted.answer
        if response is not None:
            self._evicted.append(self._shown_response(evicted, response))
            self._closed[oldest] = None
        elif not evicted.reported:
            self.forgotten += 1

    def _close(self, key: Key, call: _Call, seen: Observation) -> Line:
        del self._open[key]
        self._bytes -= call.size
        self._closed[key] = None
        return self._shown_response(call, seen)

    def _shown_response(self, call: _Call, seen: Observation) -> Line:
        trip = None
        if call.request is not None:
            same_end = (seen.kind in CLIENT_END) == (call.request.kind in CLIENT_END)
            trip = (seen.stamp_ns - call.request.stamp_ns) / 1000 if same_end else None
        server = call.server or self._servers.get(seen.channel, "")
        return _line(
            seen,
            "response",
            "" if nobody_answered(seen.error) else server,
            client=seen.client,
            round_trip_us=trip,
        )

    def one_ended(self, now_ns: int) -> list[Line]:
        """Responses whose other end has stayed silent for :data:`OTHER_END_SILENCE_S`.

        ``now_ns`` is the tap's clock.
        """
        shown, self._evicted = self._evicted, []
        before_ns = now_ns - int(OTHER_END_SILENCE_S * 1e9)
        for key, call in list(self._open.items()):
            response = call.returned or call.answer
            if response is None or response.received_ns >= before_ns:
                continue
            if call.returned is not None:  # its server publishes no events: do not wait again
                self._servers.setdefault(key[0], "")
            shown.append(self._close(key, call, response))
        return shown

    def unanswered(self, now_ns: int, after_s: float) -> list[Line]:
        """Requests received more than ``after_s`` ago whose response was not; each is reported once.

        ``now_ns`` is the tap's clock, and so is the age of a request: the stamp of its node may be
        of a clock that is wrong. A response that comes later is still shown. A goal's result is
        never late: it comes when the goal ends.
        """
        before_ns = now_ns - int(after_s * 1e9)
        shown = []
        for (channel, client, _, _), call in self._open.items():
            request = call.request
            if (
                request is None
                or request.received_ns >= before_ns
                or call.reported
                or call.answer is not None
                or call.returned is not None
                or waits_for_the_goal(channel)
            ):
                continue
            call.reported = True
            shown.append(
                _line(request, "unanswered", client, error=f"no response for {after_s:g} s")
            )
        return shown


def _line(
    seen: Observation,
    kind: str,
    source: str,
    *,
    client: str = "",
    round_trip_us: float | None = None,
    error: str = "",
) -> Line:
    channel = seen.channel
    action = action_of(channel) if SEPARATOR in channel else ""
    return Line(
        seen.stamp_ns,
        kind,
        channel,
        source=source,
        data=seen.data,
        type_name=seen.type_name,
        client=client,
        call=max(seen.call, 0),
        round_trip_us=round_trip_us,
        error=error or seen.error,
        action=action,
        part=part_of(channel, kind) if action else "",
        received_ns=seen.received_ns,
    )
