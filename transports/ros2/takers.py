"""Who may not take all that is published on a topic, or not when it is published, by the QoS of both ends.

The graph shows what each publisher offers and each subscription asks for; how many messages a subscription
keeps, it does not show.
"""

# rclpy leaves some of its functions without types
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Any

from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from transports.ros2 import qos
from transports.ros2.graph import UNKNOWN, Graph


class Takers:
    """The subscriptions of the graph that may miss messages, as far as it was looked at.

    Args:
        node: the ``rclpy.node.Node`` by which rcl is asked; its own subscriptions are left out.
        graph: who knows names.
    """

    def __init__(self, node: Any, graph: Graph) -> None:
        self._node = node
        self._graph = graph
        self._counts: dict[str, tuple[int, int]] = {}
        """Publishers and subscriptions of each topic, when it was looked at last."""
        self._unsure: dict[str, tuple[tuple[Any, str], ...]] = {}
        """By topic, the subscriptions that may miss something, and why; values are replaced whole."""

    def look(self, topic: str, publishers: int) -> None:
        """Look at ``topic`` if endpoints have come or gone since the last time."""
        counts = publishers, self._node.count_subscribers(topic)
        if self._counts.get(topic) == counts:
            return
        self._counts[topic] = counts
        found = tuple(self._find(topic)) if all(counts) else ()
        if found:
            self._unsure[topic] = found
        else:
            self._unsure.pop(topic, None)

    def look_closely(self) -> None:
        """Next time, look at each topic, though as many are there as before."""
        self._counts.clear()

    def keep(self, topics: Collection[str]) -> None:
        """Only ``topics`` are left in the graph."""
        for topic in self._unsure.keys() - topics:
            del self._unsure[topic]
            self._counts.pop(topic, None)

    def unsure(self) -> Mapping[tuple[str, str], str]:
        """Topics, each with a node that may miss messages of it, and why; from any thread."""
        named = {
            (topic, self._graph.name_of(info)): why
            for topic, found in self._unsure.copy().items()
            for info, why in found
        }
        return {place: why for place, why in named.items() if place[1] != UNKNOWN}

    def _find(self, topic: str) -> Iterator[tuple[Any, str]]:
        offered = self._node.get_publishers_info_by_topic(topic)
        own = self._node.get_name()
        for info in self._node.get_subscriptions_info_by_topic(topic):
            if info.node_name == own:
                continue
            whys = (_why(topic, publisher.qos_profile, info.qos_profile) for publisher in offered)
            why = next(filter(None, whys), "")
            if why:
                yield info, why


def _why(topic: str, offered: Any, requested: Any) -> str:
    """Why who asks for ``requested`` may miss what is offered so; empty if that is taken for sure."""
    mismatch = qos.mismatch(offered, requested)
    if mismatch:
        return f"somebody who publishes on {topic} is not received: {mismatch}"
    if requested.reliability != ReliabilityPolicy.RELIABLE:
        return f"messages on {topic} may be dropped: it subscribes with best effort"
    if offered.durability == requested.durability == DurabilityPolicy.TRANSIENT_LOCAL:
        return f"messages on {topic} may be old: they are transient local"
    if qos.expires(offered):
        return f"messages on {topic} may be dropped: they have a lifespan"
    return ""
