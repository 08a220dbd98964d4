"""Events: what both ends of a service report to a tap, and who takes a message; only while one listens.

An event is recorded when it happens (with its stamp) and published a few milliseconds later, with all
others of its node (``outbox``). Publishing at once would wake the tap while the caller waits for its
answer (decision 15). Without a listener nothing is recorded
at all.
"""

# zenoh's stubs leave the results of some methods open
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import msgspec
import zenoh

from transports.interface import Service, Topic
from transports.outbox import Outbox
from transports.service_events import (
    EVENT_SUFFIX,
    TAKEN_SUFFIX,
    TYPE_SUFFIX,
    ServiceEvent,
    ServiceEventInfo,
)
from transports.zenoh.names import key_of, own_key
from transports.zenoh.orders import Moment, Orders
from transports.zenoh.wire import MEDIA_TYPE, attachment

_encode = msgspec.msgpack.Encoder().encode


Call = tuple[str, int, int]
"""A call: its client, its number, and the client's life; or who published a message taken, and its number."""
Recorded = tuple["Events", int, Moment, Call, bytes | None, bytes | None, str]
"""An event that is still to be published, a plain tuple as ``Moment`` is; it is made of this then, when
nobody waits for the node: of which channel it is, what happened and when, in which call, the encoded request
and response, and the error (see ``ServiceEvent``)."""


def publish(recorded: Recorded) -> None:
    """Publish an event; for the outbox, which does so one after the other."""
    recorded[0].publish(recorded)


def _raw(contents: bytes | None) -> msgspec.Raw | None:
    return None if contents is None else msgspec.Raw(contents)


class Events:
    """The events of one channel as one node sees them: of a service, as its server or as its client, or of a
    topic that it takes messages of.

    A service has one server, and any number of clients: what the server reports has the service's own key,
    what a client or a subscriber reports has a key with its name. So access control can say who may report.

    Args:
        session: the node's.
        outbox: what the node has yet to publish.
        channel: whose events.
        node: the node's name.
        is_server: whether the node reports as the server of the service.
        orders: numbers all that the node reports.
        numbers: numbers what the node reports of the channel.
    """

    def __init__(
        self,
        session: zenoh.Session,
        outbox: Outbox[Recorded],
        channel: Service | Topic,
        node: str,
        is_server: bool,
        orders: Orders,
        numbers: Iterator[int],
    ) -> None:
        is_service = isinstance(channel, Service)
        suffix, type_suffix = (EVENT_SUFFIX, TYPE_SUFFIX) if is_service else (TAKEN_SUFFIX, "")
        key = key_of(channel.name) + suffix
        self._keep = outbox.add
        self._publishing = outbox.publishing
        self._has_ended = False
        self.flush_later = outbox.flush_later
        """Publish what is recorded, a little later; from any thread, best when nobody waits for the node."""
        self.flush = outbox.flush
        """Publish what is recorded, in order; from any thread."""
        self._node = node.encode()
        self._numbers = numbers
        self.published = 0
        """How many events were published."""
        self.moment = orders.begin
        """Now: to be asked when something happens. ``record`` or ``forget`` must follow."""
        self.skip = orders.skip
        """Something happens while nobody listens: to be called instead of ``moment``, as it counts, too."""
        self._end = orders.end
        self._publisher = session.declare_publisher(
            key if is_server else own_key(key, node),
            encoding=zenoh.Encoding(f"{MEDIA_TYPE};{channel.type_name}{type_suffix}"),
            # A listener that does not keep up loses events, and sees it by their numbers.
            congestion_control=zenoh.CongestionControl.DROP,
        )
        self.is_tapped = False
        """Whether anybody listens; nothing need be recorded otherwise."""
        self._publisher.declare_matching_listener(
            zenoh.handlers.Callback(self._matching, indirect=False)
        )
        status: Any = self._publisher.matching_status  # the stub says bool: it is none
        if status.matching:  # if not, it is old: a newer status may have come by now
            self.is_tapped = True

    def _matching(self, status: zenoh.MatchingStatus) -> None:
        self.is_tapped = bool(status.matching)

    def record(
        self,
        event_type: int,
        moment: Moment,
        call: Call,
        request: bytes | None,
        response: bytes | None = None,
        error: str = "",
    ) -> None:
        """Keep an event until the outbox is flushed; the contents are encoded messages."""
        self._keep((self, event_type, moment, call, request, response, error))
        self._end(moment[1])

    def forget(self, moment: Moment | None) -> None:
        """What was to happen at ``moment``, if anything, did not: there is no event of it."""
        if moment is not None:
            self._end(moment[1])

    def publish(self, recorded: Recorded) -> None:
        """Publish an event; one thread at a time."""
        if self._has_ended:
            return
        _, event_type, (stamp, order), (client, call, life), request, response, error = recorded
        stamp_ns = int(stamp.get_time_as_ntp64().as_nanos())
        event = ServiceEvent(
            ServiceEventInfo(event_type, stamp_ns, client, call, life),
            _raw(request),
            _raw(response),
            error,
        )
        sent_as = attachment(next(self._numbers), order, self._node)
        self.published += 1
        self._publisher.put(_encode(event), attachment=sent_as)

    def undeclare(self) -> None:
        """Publish no more: what is kept of these events is dropped, while other nodes go on."""
        with self._publishing:
            self._has_ended = True
            self._publisher.undeclare()
