"""Subscriptions that are made while the interpreter goes on.

DDS holds its locks for long while a system starts: a participant that comes is matched, endpoint by
endpoint, by threads that share the processors with everything that starts. Who subscribes meanwhile
waits for them, up to half a second each time, and rclpy holds the interpreter as it waits. A tap has
sixty subscriptions, and a monitor that stands still receives what happens too late. So these are made by rcl
itself (``rcl_subscription_init``), called without the interpreter's lock, on a thread of their own.

rcl allows it: entities of one node may be made by several threads, and rmw has them take turns.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from typing import Any

from transports.interface import TransportError
from transports.ros2.executor import Executor
from transports.ros2.raw_subscription import RawSubscription
from transports.work_queue import WorkQueue


class Subscriber:
    """Makes subscriptions of one node, one after the other, on a thread of its own.

    Args:
        node: an ``rclpy.node.Node``.
        executor: the node's; on its thread what is made is handed over.
    """

    def __init__(self, node: Any, executor: Executor) -> None:
        self._node = node
        self._executor = executor
        self._jobs: WorkQueue[Callable[[], None] | None] = WorkQueue()
        self._thread: threading.Thread | None = None
        self._made: set[RawSubscription] = set()
        self._closed = False

    def subscribe(
        self,
        topic: str,
        ros: Any,
        profile: Any,
        done: Callable[[RawSubscription | TransportError], None],
    ) -> None:
        """Subscribe to ``topic`` soon; then ``done(subscription, or why not)``. On the executor.

        Args:
            topic: full name.
            ros: class of the messages, its type support loaded.
            profile: an ``rclpy.qos.QoSProfile``: history, depth, reliability and durability count.
            done: called on the executor, unless the node closes before.
        """
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name="ros2-subscriber", daemon=True)
            self._thread.start()

        def make() -> None:
            subscription = RawSubscription(topic)
            try:
                subscription.make(self._node, ros, profile)
            except TransportError as error:
                self._executor.post(partial(done, error))
                return
            self._made.add(subscription)
            self._executor.post(partial(done, subscription))

        self._jobs.put(make)

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None and not self._closed:
            job()

    def end(self, subscription: RawSubscription) -> None:
        """End ``subscription``, which the executor has forgotten."""
        self._made.discard(subscription)
        subscription.end(self._node)

    def close(self) -> None:
        """Make nothing any more, and end what was made; nobody spins. Idempotent."""
        self._closed = True
        if self._thread is not None:
            self._jobs.put(None)
            self._thread.join()
        for subscription in tuple(self._made):
            self.end(subscription)
