"""Which endpoints of DDS are a node's own: several nodes of one process may be in one participant.

An endpoint's GID is its participant's twelve bytes and four that tell it from the others there
(DDSI-RTPS 2.5, 9.3.1). A process's own graph shows at once, and for sure, which of its nodes has which.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain
from typing import Any

from transports.ros2 import native
from transports.ros2.graph import request_topic, response_topic

_ROSOUT = "/rosout"
"""Every node publishes it, by rcl: rclpy does not know."""


def of_node(node: Any, participant: bytes) -> list[bytes]:
    """GIDs of all by which ``node`` publishes, subscribes, serves and calls; not of what its taps have.

    Args:
        node: an ``rclpy.node.Node``.
        participant: the one that it is in.
    """
    published = {_ROSOUT, *(publisher.topic_name for publisher in node.publishers)}
    subscribed = {subscription.topic_name for subscription in node.subscriptions}
    served = {request_topic(service.srv_name) for service in node.services}
    called = {client.srv_name for client in node.clients}
    shown = (
        *(node.get_publishers_info_by_topic(topic) for topic in published),
        *(node.get_subscriptions_info_by_topic(topic) for topic in subscribed),
        *(node.get_subscriptions_info_by_topic(topic, no_mangle=True) for topic in served),
        *(
            node.get_publishers_info_by_topic(request_topic(service), no_mangle=True)
            for service in called
        ),
        *(
            node.get_subscriptions_info_by_topic(response_topic(service), no_mangle=True)
            for service in called
        ),
    )
    return list(_own(node, participant, chain.from_iterable(shown)))


def of_client(node: Any, handle: Any, service: str) -> set[bytes]:
    """GIDs by which a client (``client.handle``) of ``node`` is known: to itself its request writer, to
    servers its response reader.
    """
    writer = native.gid_of_client(handle)
    readers = node.get_subscriptions_info_by_topic(response_topic(service), no_mangle=True)
    return {writer, *_own(node, native.participant_of(writer), readers)}


def of_servers(node: Any, service: str) -> frozenset[bytes]:
    """GIDs of those that serve ``service``, as far as ``node`` has discovered them."""
    readers = node.get_subscriptions_info_by_topic(request_topic(service), no_mangle=True)
    return frozenset(native.gid_of(reader) for reader in readers)


def _own(node: Any, participant: bytes, endpoints: Iterable[Any]) -> Iterator[bytes]:
    name = node.get_name()
    for endpoint in endpoints:
        gid = native.gid_of(endpoint)
        if endpoint.node_name == name and native.participant_of(gid) == participant:
            yield gid
