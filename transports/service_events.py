"""What nodes publish for whoever listens: about a call, both ends of a service; of a message, who takes it.

The wire form of ``<service>/_service_event`` on transports whose middleware has no service
introspection of its own. It carries what ROS 2's ``service_msgs/msg/ServiceEventInfo`` carries,
plus the contents: the request with REQUEST_*, the response with RESPONSE_*. The same form without contents,
on ``<topic>/_message_taken``, says that a node begins to handle a message.
"""

from __future__ import annotations

from typing import Annotated, Any

import msgspec

from transports.interface import ObservationKind

EVENT_SUFFIX = "/_service_event"
"""Appended to a service's channel name, as ROS 2 does."""

TYPE_SUFFIX = "_Event"
"""Appended to a service's type name (``pkg/srv/Name_Event``), as ROS 2 does."""

TAKEN_SUFFIX = "/_message_taken"
"""Appended to a topic's channel name."""

REQUEST_SENT = 0
REQUEST_RECEIVED = 1
RESPONSE_SENT = 2
RESPONSE_RECEIVED = 3
MESSAGE_TAKEN = 4
"""None of ROS 2's: on ``<topic>/_message_taken`` only."""

KIND_OF_EVENT = (
    ObservationKind.REQUEST_SENT,
    ObservationKind.REQUEST_RECEIVED,
    ObservationKind.RESPONSE_SENT,
    ObservationKind.RESPONSE_RECEIVED,
)
"""Indexed by ``ServiceEventInfo.event_type``."""


_Count = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
"""What fits in every form of recording."""


class ServiceEventInfo(msgspec.Struct, frozen=True):
    """``service_msgs/msg/ServiceEventInfo``, with the client named instead of numbered.

    Attributes:
        event_type: REQUEST_SENT, REQUEST_RECEIVED, RESPONSE_SENT, RESPONSE_RECEIVED or MESSAGE_TAKEN.
        stamp_ns: when it happened, ns since the epoch, on the clock of the publishing end.
        client: the calling node; of a message taken, the one that published it.
        sequence_number: the number of the client's call: the same in all four events of a call; -1 if the
            client does not number its calls. Of a message taken, the message's number.
        life: of the client, or of the node that published (``Observation.client_life``); 0 if it did not say.
    """

    event_type: int
    stamp_ns: _Count
    client: Annotated[str, msgspec.Meta(max_length=255)]
    sequence_number: Annotated[int, msgspec.Meta(ge=-1, le=2**63 - 1)]
    life: _Count = 0


class ServiceEvent(msgspec.Struct, frozen=True, omit_defaults=True):
    """One of the four things that happen in a call, or a message taken.

    Attributes:
        info: which, when, whose.
        request, response: the message: already encoded (``msgspec.Raw``) when sending, plain
            maps, lists and scalars when received; None where the event has none.
        error: why the call did not end in a response (``remote_error: …``, ``timeout: …``).
    """

    info: ServiceEventInfo
    request: Any = None
    response: Any = None
    error: str = ""
