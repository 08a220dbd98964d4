"""Topics: publications and subscriptions.

Types of the packages ``m2c`` and ``moon_msgs`` (what the tools report to each other) have no ROS
definition: they travel as JSON in a ``std_msgs/msg/String``.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import msgspec
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

from transports.interface import Message, Topic, TransportError
from transports.payloads import PayloadError, decode_with, require_type
from transports.refusals import Refusals
from transports.ros2 import qos
from transports.ros2.executor import Executor
from transports.ros2.messages import Codec
from transports.ros_forms import OWN_PACKAGES, Carried, read_carried


class CarriedCodec:
    """As ``messages.Codec``, for a type that ROS 2 does not know."""

    def __init__(self, type_name: str, message: type[Message]) -> None:
        from std_msgs.msg import String

        self.type_name = type_name
        self.ros = String
        self._message = message
        self._convert = functools.partial(msgspec.convert, type=message)

    def encode(self, message: Message) -> Any:
        """A String of rclpy."""
        if message.__class__ is not self._message:
            require_type(message, self.type_name)
        return self.ros(data=msgspec.json.encode(Carried(self.type_name, message)).decode())

    def decode(self, message: Any) -> Any:
        """Our message; PayloadError if it is another."""
        carried = read_carried(message.data)
        if carried.m2c_type != self.type_name:
            raise PayloadError(f"expected type {self.type_name}, got {carried.m2c_type}")
        return decode_with(self._convert, carried.message)


def codec_of(topic: Topic) -> Codec | CarriedCodec:
    """The codec of ``topic``."""
    if topic.type_name.startswith(OWN_PACKAGES):
        return CarriedCodec(topic.type_name, topic.message)
    return Codec(topic.type_name, topic.message)


class Publisher:
    """Publishes one topic."""

    def __init__(self, node: Any, name: str, topic: Topic) -> None:
        self._name = name
        self._codec = codec_of(topic)
        try:
            self.declared = node.create_publisher(
                self._codec.ros,
                name,
                qos.of_publisher(topic),
                event_callbacks=PublisherEventCallbacks(use_default_callbacks=False),
            )
        except (_rclpy.RCLError, ValueError) as error:
            raise _refused("publish", name, topic.type_name, error) from error

    def publish(self, message: Message) -> None:
        """Send ``message``; nobody is waited for."""
        encoded = self._codec.encode(message)
        try:
            self.declared.publish(encoded)
        except (_rclpy.RCLError, _rclpy.InvalidHandle) as error:
            raise TransportError(f"cannot publish on {self._name}: {error}") from error


def subscribe(
    node: Any,
    executor: Executor,
    name: str,
    topic: Topic,
    handler: Callable[[Any], None],
    refusals: Refusals,
) -> Any:
    """Call ``handler(message)`` on the executor for every message; returns the subscription."""
    codec = codec_of(topic)
    try:
        subscription = node.create_subscription(
            codec.ros,
            name,
            lambda message: None,
            qos.of_subscription(topic),
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )
    except (_rclpy.RCLError, ValueError) as error:
        raise _refused("subscribe to", name, topic.type_name, error) from error
    handle, ros, decode = subscription.handle, codec.ros, codec.decode

    def take() -> bool:
        taken = handle.take_message(ros, False)
        if taken is None:
            return False
        try:
            message = decode(taken[0])
        except PayloadError as error:
            refusals.refuse(name, "", error)
            return True
        handler(message)
        return True

    executor.handle(subscription, take)
    return subscription


def _refused(what: str, name: str, type_name: str, error: Exception) -> TransportError:
    text = " ".join(str(error).split())
    return TransportError(f"cannot {what} {name} ({type_name}): {text}")
