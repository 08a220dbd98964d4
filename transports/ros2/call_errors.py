"""How calls end without a response: what ROS 2 has no message for.

A service of ROS 2 answers or does not. A server of this transport that fails a request sends no
response (an ordinary client would take it for a real one, and waits as for any server that does not
answer); it says why on ``<namespace>/_m2c/call_errors``, which every client of this transport receives.
Clients say there how their calls ended otherwise, for whoever taps. The record is JSON in a
``std_msgs/msg/String``: ``ros2 topic echo`` shows it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from std_msgs.msg import String

from transports.interface import TransportError
from transports.payloads import PayloadError
from transports.refusals import Refusals
from transports.ros2 import qos
from transports.ros2.executor import Executor
from transports.ros_forms import CallError, read_call_error

_KEPT = 100


_encode = msgspec.json.Encoder().encode


class CallErrors:
    """What one node says of failed calls, and what its clients receive."""

    def __init__(self, node: Any, executor: Executor, topic: str, refusals: Refusals) -> None:
        self._refusals = refusals
        self._listeners: dict[str, Callable[[CallError], None]] = {}
        profile = qos.profile(reliable=True, transient_local=True, depth=_KEPT)
        self._publisher = node.create_publisher(
            String,
            topic,
            profile,
            event_callbacks=PublisherEventCallbacks(use_default_callbacks=False),
        )
        self._subscription = node.create_subscription(
            String,
            topic,
            lambda message: None,
            profile,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )
        self._topic = topic
        executor.handle(self._subscription, self._take)

    def listen(self, service: str, listener: Callable[[CallError], None]) -> None:
        """Receive what servers say of failed calls of ``service``."""
        self._listeners[service] = listener

    def publish(self, error: CallError) -> None:
        """Say how a call ended; TransportError if the node is closed."""
        try:
            self._publisher.publish(String(data=_encode(error).decode()))
        except _rclpy.InvalidHandle as fault:
            raise TransportError(f"cannot end a call of {error.service}: {fault}") from fault

    def _take(self) -> bool:
        taken = self._subscription.handle.take_message(String, False)
        if taken is None:
            return False
        try:
            error = read_call_error(taken[0].data)
        except PayloadError as fault:
            self._refusals.refuse(self._topic, "", fault)
            return True
        listener = self._listeners.get(error.service)
        if error.by_server and listener is not None:
            listener(error)
        return True
