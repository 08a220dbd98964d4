"""Calls as they were recorded, and which of their answers a request gets now."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Callable, Iterable
from typing import Any, Generic, TypeVar

import msgspec

from moon.tap.stream import nobody_answered
from transports.interface import REQUESTS, SERVER_END, CallOutcome, Observation, ObservationKind
from transports.service_events import KIND_OF_EVENT

MAX_CALLS = 1_000_000
"""Calls kept of one recording: an answer must be at hand when it is asked for."""


class RecordedCall(msgspec.Struct):
    """One call of a service, put together from the events of both ends.

    Attributes:
        channel: the service.
        client: who asked; empty where that is not known.
        server: who answered; empty where that is not known.
        request: what was asked.
        asked_ns: when the server had it, or else when it was sent.
        answered_ns: when it was answered; 0 if it never was.
        response: what was answered; None if nothing was.
        error: why it was not.
        kinds: which of the four events were recorded.
    """

    channel: str
    client: str
    request: Any
    asked_ns: int
    server: str = ""
    answered_ns: int = 0
    response: Any = None
    error: str = ""
    kinds: set[ObservationKind] = msgspec.field(default_factory=set)

    @property
    def is_answered(self) -> bool:
        """Whether its server answered, be it with an error."""
        return bool(self.answered_ns) and not nobody_answered(self.error)

    @property
    def is_served(self) -> bool:
        """Whether its server was there: it had the request, or the client waited for it in vain."""
        unavailable = self.error.partition(":")[0] == CallOutcome.UNAVAILABLE
        return bool(self.server) or (bool(self.answered_ns) and not unavailable)

    @property
    def delay_ns(self) -> int:
        """How long the answer took."""
        return max(0, self.answered_ns - self.asked_ns)


class CallBook:
    """Puts calls together from observations.

    Attributes:
        calls: by service, in the order in which they began.
        left_out: how many were not kept, because there were too many.
    """

    def __init__(self) -> None:
        self.calls: dict[str, list[RecordedCall]] = defaultdict(list)
        self.left_out = 0
        self._kept = 0
        self._open: dict[tuple[str, str, int], deque[RecordedCall]] = defaultdict(deque)

    def note(self, seen: Observation) -> None:
        """Take note of an event of a call."""
        place = (seen.channel, seen.client, seen.call)
        open_calls = self._open[place]
        found = next((call for call in open_calls if seen.kind not in call.kinds), None)
        if seen.kind in REQUESTS:
            if found is None or found.kinds.isdisjoint(REQUESTS):
                found = self._begun(seen, open_calls)
            elif seen.kind is ObservationKind.REQUEST_RECEIVED:
                found.request, found.asked_ns = seen.data, seen.stamp_ns
        elif found is None:
            return  # the answer to what was asked before the recording
        elif seen.kind is ObservationKind.RESPONSE_SENT or not found.answered_ns:
            found.answered_ns, found.response, found.error = seen.stamp_ns, seen.data, seen.error
        found.kinds.add(seen.kind)
        if seen.kind in SERVER_END and seen.source:
            found.server = seen.source
        while open_calls and (
            len(open_calls[0].kinds) == len(KIND_OF_EVENT)
            or (len(open_calls) > 1 and open_calls[0].answered_ns)
        ):
            open_calls.popleft()

    def _begun(self, seen: Observation, open_calls: deque[RecordedCall]) -> RecordedCall:
        made = RecordedCall(seen.channel, seen.client, seen.data, seen.stamp_ns)
        open_calls.append(made)
        if self._kept < MAX_CALLS:
            self._kept += 1
            self.calls[seen.channel].append(made)
        else:
            self.left_out += 1
        return made


_Recorded = TypeVar("_Recorded")


class Answers(Generic[_Recorded]):
    """What was answered to recorded requests: each is given once.

    A request that was asked then and had no answer is one of them: the like of it has none now.

    Args:
        recorded: calls or goals, in order.
        request_of: what was asked by one.
        is_answered: whether one had an answer.
    """

    def __init__(
        self,
        recorded: Iterable[_Recorded],
        request_of: Callable[[_Recorded], Any],
        is_answered: Callable[[_Recorded], bool],
    ) -> None:
        self._unused = dict(enumerate(recorded))
        self._answered = deque(number for number, item in self._unused.items() if is_answered(item))
        self._by_request: dict[bytes, deque[int]] = defaultdict(deque)
        for number, item in self._unused.items():
            self._by_request[_key(request_of(item))].append(number)

    def __len__(self) -> int:
        return len(self._unused)

    def to(self, request: Any) -> tuple[_Recorded | None, bool]:
        """The next one of an equal request, else the next answered one; whether it is of an equal one.

        ``(None, False)`` when all have been given.
        """
        equal = self._by_request.get(_key(request))
        while equal:
            found = self._unused.pop(equal.popleft(), None)
            if found is not None:
                return found, True
        while self._answered:
            found = self._unused.pop(self._answered.popleft(), None)
            if found is not None:
                return found, False
        return None, False


def _key(request: Any) -> bytes:
    return msgspec.json.encode(request, order="deterministic")
