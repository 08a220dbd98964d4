"""A subscription that rcl makes without holding the interpreter; see ``transports.ros2.subscribing``."""

from __future__ import annotations

import ctypes
from types import TracebackType
from typing import Any

from rclpy.exceptions import InvalidHandle

from transports.ros2 import native


class RawSubscription:
    """A subscription whose messages are taken as they came; stands where rclpy's and their handles do.

    Args:
        topic: full name.
    """

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self._rcl = ctypes.c_void_p()
        """``rcl_subscription_t``: one pointer."""
        self._valid = False

    def make(self, node: Any, ros: Any, profile: Any) -> None:
        """Subscribe.

        Args:
            node: an ``rclpy.node.Node``.
            ros: class of the messages, its type support loaded.
            profile: an ``rclpy.qos.QoSProfile``: history, depth, reliability and durability count.

        Raises:
            TransportError: rcl refuses; the text says why.
        """
        native.make_subscription(self.pointer, node, ros, self.topic, profile)
        self._valid = True

    def end(self, node: Any) -> None:
        """Subscribe no longer; idempotent."""
        if self._valid:
            self._valid = False
            native.end_subscription(self.pointer, node)

    @property
    def handle(self) -> RawSubscription:
        """Itself, as what is rclpy's has a handle."""
        return self

    @property
    def pointer(self) -> int:
        """Address of the ``rcl_subscription_t``."""
        return ctypes.addressof(self._rcl)

    def __enter__(self) -> RawSubscription:
        if not self._valid:
            raise InvalidHandle(f"{self.topic} is not subscribed to any more")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """It is ended on the thread that uses it, or when that has ended."""
