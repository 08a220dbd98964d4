"""What cannot work in the graph, reported once: other types, QoS that does not match, two servers."""

from __future__ import annotations

from typing import Any

import msgspec

from transports.ros2 import qos
from transports.ros2.executor import LOG
from transports.ros2.graph import UNKNOWN, Graph, request_topic, service_type_of


class Declared(msgspec.Struct):
    """What one node has declared: type and QoS per topic, type per service."""

    publishes: dict[str, tuple[str, Any]] = msgspec.field(default_factory=dict)
    subscribes: dict[str, tuple[str, Any]] = msgspec.field(default_factory=dict)
    serves: dict[str, str] = msgspec.field(default_factory=dict)
    calls: dict[str, str] = msgspec.field(default_factory=dict)


class Faults:
    """Looks at the graph for what will never be received, and reports it."""

    def __init__(self, node: Any, graph: Graph, declared: Declared) -> None:
        self._node = node
        self._name_of = graph.name_of
        self._declared = declared
        self._reported: set[str] = set()

    def look(self) -> None:
        """Report what is new."""
        node, declared = self._node, self._declared
        for topic, (type_name, profile) in declared.subscribes.items():
            for info in node.get_publishers_info_by_topic(topic):
                self._compare(topic, type_name, info, "published")
                if info.topic_type == type_name and (
                    reason := qos.mismatch(info.qos_profile, profile)
                ):
                    self._deaf(topic, self._name_of(info), node.get_name(), reason)
        for topic, (type_name, profile) in declared.publishes.items():
            for info in node.get_subscriptions_info_by_topic(topic):
                self._compare(topic, type_name, info, "expected")
                if info.topic_type == type_name and (
                    reason := qos.mismatch(profile, info.qos_profile)
                ):
                    self._deaf(topic, node.get_name(), self._name_of(info), reason)
        self._look_at_services()

    def _look_at_services(self) -> None:
        node, declared = self._node, self._declared
        for service, type_name in declared.calls.items():
            servers = node.get_subscriptions_info_by_topic(request_topic(service), no_mangle=True)
            served = {service_type_of(info.topic_type) for info in servers}
            if served and type_name not in served:
                self._say(
                    f"{service}: this node calls it as {type_name}, but it is served as "
                    f"{', '.join(sorted(served))}: its calls will not be answered"
                )
        for service in declared.serves:
            servers = node.get_subscriptions_info_by_topic(request_topic(service), no_mangle=True)
            names = sorted(self._name_of(info) for info in servers)
            if len(names) < 2 or UNKNOWN in names:
                continue
            text = f"two nodes serve {service}: {' and '.join(names)}; a call is answered by both"
            if len(set(names)) < len(names):
                text += " (one that was killed stays in the graph for some 20 s)"
            self._say(text)

    def _compare(self, topic: str, type_name: str, info: Any, how: str) -> None:
        if info.topic_type != type_name and (name := self._name_of(info)) != UNKNOWN:
            self._say(
                f"{topic}: this node has it as {type_name}, but it is {how} by {name} "
                f"as {info.topic_type}: they do not receive each other's messages"
            )

    def _deaf(self, topic: str, publisher: str, subscriber: str, reason: str) -> None:
        if UNKNOWN not in (publisher, subscriber):
            self._say(
                f"{topic}: {subscriber} cannot receive from {publisher}, their QoS does not match: {reason}"
            )

    def _say(self, text: str) -> None:
        if text not in self._reported:
            self._reported.add(text)
            LOG.error(text)
