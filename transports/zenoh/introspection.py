"""Service events: what both ends of a service tell a tap, and only while one listens.

An event is recorded when it happens (with its stamp) and published ``FLUSH_DELAY_S`` later, when
the reply has left and, as a rule, arrived. Publishing at once would wake the tap while the caller
waits for its answer: with two processors that made a tapped call 38 % slower. Without a listener
nothing is recorded at all.
"""

# zenoh's stubs leave the results of some methods open
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import itertools
from collections import deque
from typing import Any, NamedTuple

import msgspec
import zenoh

from transports.interface import Service
from transports.service_events import EVENT_SUFFIX, TYPE_SUFFIX, ServiceEvent, ServiceEventInfo
from transports.zenoh.executor import Executor
from transports.zenoh.names import key_of
from transports.zenoh.topics import Sequence
from transports.zenoh.wire import MEDIA_TYPE, attachment

FLUSH_DELAY_S = 0.002
"""How long an event waits: several times what a call takes, far below what a monitor allows for."""

_encode = msgspec.msgpack.Encoder().encode


class Moment(NamedTuple):
    """When something happened.

    Attributes:
        stamp_ns: on the session's hybrid logical clock, ns since the epoch.
        order: its place among all that the node tells.
    """

    stamp_ns: int
    order: int


class ServiceEvents:
    """The events of one service as one node sees them (as its server, its client, or both)."""

    def __init__(
        self,
        session: zenoh.Session,
        executor: Executor,
        service: Service,
        node: bytes,
        order: itertools.count[int],
    ) -> None:
        self._session = session
        self._executor = executor
        self._node = node
        self._sequence = Sequence()
        self._order = order
        self._scheduled = False
        self._pending: deque[tuple[ServiceEvent, int]] = deque()
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

    def moment(self) -> Moment:
        """Now: to be asked when something happens, on the node's executor."""
        stamp = self._session.new_timestamp().get_time_as_ntp64().as_nanos()
        return Moment(int(stamp), next(self._order))

    def record(
        self,
        event_type: int,
        moment: Moment,
        client: str,
        call: int,
        *,
        request: bytes | None = None,
        response: bytes | None = None,
        error: str = "",
    ) -> None:
        """Keep an event for ``flush``; the contents are encoded messages."""
        self._pending.append(
            (
                ServiceEvent(
                    ServiceEventInfo(event_type, moment.stamp_ns, client, call),
                    None if request is None else msgspec.Raw(request),
                    None if response is None else msgspec.Raw(response),
                    error,
                ),
                moment.order,
            )
        )

    def flush_later(self) -> None:
        """Publish what is recorded in ``FLUSH_DELAY_S`` (on the executor)."""
        if not self._scheduled:
            self._scheduled = True
            self._executor.after(FLUSH_DELAY_S, self.flush)

    def flush(self) -> None:
        """Publish what is recorded, in order; from any thread."""
        self._scheduled = False  # before looking: what is recorded from now on schedules again
        pending, sequence = self._pending, self._sequence
        with sequence.lock:
            while pending:
                recorded, order = pending.popleft()
                sent_as = attachment(sequence.next, order, self._node)
                self._publisher.put(_encode(recorded), attachment=sent_as)
                sequence.next += 1

    def undeclare(self) -> None:
        """Publish what is left, and no more."""
        self.flush()
        self._publisher.undeclare()
