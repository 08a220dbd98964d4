"""Service events: what both ends of a service tell a tap, and only while one listens.

An event is recorded when it happens (with its stamp) and published later, after the reply has
left: nothing of it is on the way of a call. Without a listener nothing is recorded at all.
"""

# zenoh's stubs leave the results of some methods open
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

from collections import deque
from typing import Any

import msgspec
import zenoh

from transports.interface import Service
from transports.service_events import EVENT_SUFFIX, TYPE_SUFFIX, ServiceEvent, ServiceEventInfo
from transports.zenoh.executor import Executor
from transports.zenoh.names import key_of
from transports.zenoh.topics import Sequence
from transports.zenoh.wire import MEDIA_TYPE, attachment

_encode = msgspec.msgpack.Encoder().encode


class ServiceEvents:
    """The events of one service as one node sees them (as its server, its client, or both)."""

    def __init__(
        self, session: zenoh.Session, executor: Executor, service: Service, node: bytes
    ) -> None:
        self._session = session
        self._executor = executor
        self._node = node
        self._sequence = Sequence()
        self._pending: deque[ServiceEvent] = deque()
        self._publisher = session.declare_publisher(
            key_of(service.name) + EVENT_SUFFIX,
            encoding=zenoh.Encoding(f"{MEDIA_TYPE};{service.type_name}{TYPE_SUFFIX}"),
            # A listener that does not keep up loses events, and sees it by their numbers.
            congestion_control=zenoh.CongestionControl.DROP,
        )
        self.heard = False
        """Whether anybody listens; nothing need be recorded otherwise."""
        self._publisher.declare_matching_listener(
            zenoh.handlers.Callback(self._matching, indirect=False)
        )
        status: Any = self._publisher.matching_status  # the stub says bool: it is none
        self.heard = bool(status.matching)

    def _matching(self, status: zenoh.MatchingStatus) -> None:
        self.heard = bool(status.matching)

    def stamp(self) -> int:
        """Now, on the session's hybrid logical clock, ns since the epoch."""
        return int(self._session.new_timestamp().get_time_as_ntp64().as_nanos())

    def record(
        self,
        event_type: int,
        stamp_ns: int,
        client: str,
        call: int,
        *,
        request: bytes | None = None,
        response: bytes | None = None,
        error: str = "",
    ) -> None:
        """Keep an event for ``flush``; the contents are encoded messages."""
        self._pending.append(
            ServiceEvent(
                ServiceEventInfo(event_type, stamp_ns, client, call),
                None if request is None else msgspec.Raw(request),
                None if response is None else msgspec.Raw(response),
                error,
            )
        )

    def flush_soon(self) -> None:
        """Publish what is recorded as soon as the executor is free."""
        self._executor.put((_flush, self))

    def flush(self) -> None:
        """Publish what is recorded, in order; from any thread."""
        pending, sequence = self._pending, self._sequence
        with sequence.lock:
            while pending:
                payload = _encode(pending.popleft())
                self._publisher.put(payload, attachment=attachment(sequence.next, self._node))
                sequence.next += 1

    def undeclare(self) -> None:
        """Publish no more."""
        self._publisher.undeclare()


def _flush(events: ServiceEvents) -> None:
    events.flush()
