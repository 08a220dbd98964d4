"""Service events: what rcl's service introspection publishes, from this transport's own hands.

The topic, type and contents are those of ``configure_introspection(…, CONTENTS)``. rcl would publish
each event on the call's way, whether anybody listens or not, and stamp what was sent after it has
left; that made a tapped call 1.6 times as slow. Here an event is stamped before its message leaves,
kept only while somebody listens, and published ``FLUSH_DELAY_S`` later.
"""

# rclpy leaves some of its functions without types
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import threading
import time
from collections import deque
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

from transports.ros2 import qos
from transports.ros2.executor import Executor
from transports.ros2.interfaces import ros_class
from transports.service_events import EVENT_SUFFIX, REQUEST_RECEIVED, TYPE_SUFFIX

FLUSH_DELAY_S = 0.006
"""How long an event waits: several times what a call takes, also on a busy machine, far below what a monitor
allows for. (At 2 ms, calls that took longer were slowed down by their own events: a tick at 10 Hz took 1.7
times as long, with more to do than processors. At 10 ms, those of a tick at 100 Hz met the next tick.)"""


class ServiceEvents:
    """The events of one service as one node sees them (as its server, its client, or both)."""

    def __init__(self, node: Any, executor: Executor, name: str, type_name: str) -> None:
        self._executor = executor
        self._event = ros_class(type_name + TYPE_SUFFIX)
        self._pending: deque[tuple[int, int, bytes, int, Any]] = deque()
        self._scheduled = False
        self._closed = False
        self._lock = threading.Lock()
        self._publisher = node.create_publisher(
            self._event,
            name + EVENT_SUFFIX,
            qos.profile(reliable=True, latched=False, depth=qos.DEPTH),
            event_callbacks=PublisherEventCallbacks(use_default_callbacks=False),
        )
        self._listeners = self._publisher.handle.get_subscription_count

    def stamp(self) -> int:
        """Now in real time, ns since the epoch; 0 if nobody listens, and nothing need be recorded."""
        return time.time_ns() if not self._closed and self._listeners() else 0

    def record(self, event_type: int, stamp_ns: int, gid: bytes, call: int, message: Any) -> None:
        """Keep an event for ``flush``.

        Args:
            event_type: of ``service_msgs/msg/ServiceEventInfo``.
            stamp_ns: what ``stamp`` said when it happened.
            gid: the client's, as this end knows it.
            call: the number of the client's call.
            message: rclpy's request or response.
        """
        self._pending.append((event_type, stamp_ns, gid, call, message))

    def flush_later(self) -> None:
        """Publish what is recorded in ``FLUSH_DELAY_S``."""
        if self._pending and not self._scheduled:
            self._scheduled = True
            self._executor.after_real(FLUSH_DELAY_S, self.flush)

    def flush(self) -> None:
        """Publish what is recorded, in order; from any thread."""
        import numpy  # rosidl keeps arrays of fixed size in it

        self._scheduled = False  # before looking: what is recorded from now on schedules again
        pending = self._pending
        with self._lock:
            while pending:
                event_type, stamp_ns, gid, call, message = pending.popleft()
                event = self._event()
                info = event.info
                info.event_type = event_type
                info.stamp.sec, info.stamp.nanosec = divmod(stamp_ns, 10**9)
                info.client_gid = numpy.frombuffer(gid, dtype=numpy.uint8)
                info.sequence_number = call
                if event_type <= REQUEST_RECEIVED:
                    event.request = [message]
                else:
                    event.response = [message]
                try:
                    self._publisher.publish(event)
                except _rclpy.InvalidHandle:  # a caller's thread was ending its call as it closed
                    return

    def close(self) -> None:
        """Publish what is left, and no more: the node is about to close."""
        if not self._closed:
            self._closed = True
            self.flush()
