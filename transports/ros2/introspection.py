"""Service events: what rcl's service introspection publishes, from this transport's own hands.

The topic, type and contents are those of ``configure_introspection(…, CONTENTS)``. rcl would publish
each event on the call's way, whether anybody listens or not, and stamp what was sent after it has
left; that slows every tapped call (decision 15). Here an event is stamped before its message leaves,
kept only while somebody listens, and published with the others of its node (``transports.outbox``).
"""

# rclpy leaves some of its functions without types
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import time
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

from transports.outbox import CALLER_S, Outbox
from transports.ros2 import qos
from transports.ros2.event_cdr import former
from transports.ros2.executor import Executor
from transports.ros2.interfaces import ros_class
from transports.service_events import EVENT_SUFFIX, REQUEST_RECEIVED, TYPE_SUFFIX

FLUSH_DELAY_S = CALLER_S
"""How long an event waits at least: longer than a tick of a few skills takes, as no node knows how long it
goes on (decision 15)."""


Recorded = tuple["ServiceEvents", int, int, bytes, int, Any]
"""An event that is still to be published: of which service it is, what happened (``event_type`` of
``service_msgs/msg/ServiceEventInfo``) and when (ns since the epoch), the client's gid as this end knows
it, the number of the client's call, and rclpy's request or response. A plain tuple, as it is made while
somebody waits for the node."""


def outbox(executor: Executor) -> Outbox[Recorded]:
    """What one node has yet to publish, of all its services."""
    return Outbox(_RealTime(executor), _publish, delay_s=FLUSH_DELAY_S)


class _RealTime:
    """Events leave in real time, also where a simulation stands still."""

    def __init__(self, executor: Executor) -> None:
        self.after = executor.after_real


def _publish(recorded: Recorded) -> None:
    recorded[0].publish(recorded)


class ServiceEvents:
    """The events of one service as one node sees them (as its server, its client, or both)."""

    def __init__(self, node: Any, outbox: Outbox[Recorded], name: str, type_name: str) -> None:
        self._keep = outbox.add
        self.flush_later = outbox.flush_later
        """Publish what is recorded when the node is quiet; from any thread."""
        self.flush = outbox.flush
        """Publish what is recorded, in order; from any thread."""
        event = ros_class(type_name + TYPE_SUFFIX)
        self._form_request = former(event, ros_class(f"{type_name}_Request"), "request")
        self._form_response = former(event, ros_class(f"{type_name}_Response"), "response")
        self._closed = False
        self._publisher = node.create_publisher(
            event,
            name + EVENT_SUFFIX,
            qos.profile(reliable=True, transient_local=False, depth=qos.DEPTH),
            event_callbacks=PublisherEventCallbacks(use_default_callbacks=False),
        )
        self._listeners = self._publisher.handle.get_subscription_count

    def stamp(self) -> int:
        """Now in real time, ns since the epoch; 0 if nobody listens, and nothing need be recorded."""
        return time.time_ns() if not self._closed and self._listeners() else 0

    def record(self, event_type: int, stamp_ns: int, gid: bytes, call: int, message: Any) -> None:
        """Keep an event until the outbox is flushed; see :class:`Recorded`."""
        self._keep((self, event_type, stamp_ns, gid, call, message))

    def publish(self, recorded: Recorded) -> None:
        """Publish an event; one thread at a time."""
        _, event_type, stamp_ns, gid, call, message = recorded
        formed = self._form_request if event_type <= REQUEST_RECEIVED else self._form_response
        try:
            self._publisher.publish(formed(event_type, stamp_ns, gid, call, message))
        except _rclpy.InvalidHandle:  # a caller's thread was ending its call as it closed
            return

    def close(self) -> None:
        """Nothing happens any more that is to be recorded: the node is about to close."""
        self._closed = True
