"""What the nodes of one process share on ROS 2: the rclpy context, and so a DDS participant and its graph.

The node that opened the context owns it; those that came beside it end with it at the latest.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any

from transports.interface import TransportError
from transports.open_files import FOR_A_CONNECTION, allow_open_files
from transports.outbox import Outbox
from transports.refusals import Refusals
from transports.ros2 import session
from transports.ros2.arrivals import MOST_FILES
from transports.ros2.executor import Executor
from transports.ros2.graph import Graph
from transports.ros2.introspection import Recorded
from transports.ros2.last_words import LastWords
from transports.ros2.roster import Roster


class Shared:
    """What the nodes of one context have in common.

    Args:
        node: the ``rclpy.node.Node`` that opened the context.
        executor: its own.
        prefix: put before every channel.
        refusals: where announcements that are none are counted.

    Attributes:
        graph: who is in the system, by DDS.
        roster: who says so himself.
        nodes: the nodes (of rclpy) by name; replaced whole.
        outboxes: what each node that is not closed has yet to report.
        last_words: set once they all close: they wait together for what they sent last.
    """

    def __init__(self, node: Any, executor: Executor, prefix: str, refusals: Refusals) -> None:
        self.prefix = prefix
        self._context = node.context
        self._lock = threading.Lock()
        self._types: dict[str, tuple[str, str]] = {}
        """Of topics: the type, and the node that had it first."""
        self.nodes: Mapping[str, Any] = {node.get_name(): node}
        self.outboxes: list[Outbox[Recorded]] = []
        self.last_words: LastWords | None = None
        self.graph = Graph(node, prefix)
        self.roster = Roster(node, executor, self.graph, prefix, refusals)

    def open_node(self, name: str, options: Mapping[str, str]) -> Any:
        """A further ``rclpy.node.Node`` in the context; for ``options`` see ``transports.ros2.session``.

        Raises:
            TransportError: another has this name, or that which ROS arguments give it; ROS 2 refuses; or
                the process may not open so many files.
        """
        with self._lock:
            if name in self.nodes:
                raise TransportError(f"two nodes of this process are named {name}")
            allow_open_files(FOR_A_CONNECTION + MOST_FILES * (len(self.nodes) + 1))
            node = session.open_node(name, options, self._context)
            got = node.get_name()
            if got in self.nodes:
                node.destroy_node()
                raise TransportError(
                    f"ROS arguments name {name} {got}, as another node of this process is named; to rename "
                    f"one of several: -r {name}:__node:=<new name>"
                )
            self.nodes = {**self.nodes, got: node}
            return node

    def leave(self, name: str) -> None:
        """The node ``name`` is destroyed."""
        with self._lock:
            self.nodes = {other: node for other, node in self.nodes.items() if other != name}

    def require_type(self, topic: str, type_name: str, node: str) -> None:
        """``node`` is to have ``topic`` (full name) as ``type_name``.

        DDS allows a participant one type for each, and rmw_fastrtps crashes at a second one even when the
        first is gone.

        Raises:
            TransportError: it was another type here.
        """
        known, first = self._types.setdefault(topic, (type_name, node))
        if known != type_name:
            here = "node" if first == node else "process"
            raise TransportError(
                f"{topic}: {first} has declared it as {known} already, and now {node} does as {type_name}; "
                f"ROS 2 allows one type per topic in a {here}"
            )

    def stop(self) -> None:
        """Look at the graph no more; the context is about to end."""
        self.graph.stop()
        self.roster.release()
