"""What has arrived, by rclpy's wait set: for where rcl rings no bell (``transports.ros2.arrivals``).

It is filled anew for each wait, for which a tap of sixty topics takes about twice the processor time
(decision 17). What it reports is the same, and so is how it is used.
"""

# rclpy leaves some of its functions without types
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import threading
from contextlib import AbstractContextManager, ExitStack, nullcontext
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

from transports.ros2 import native
from transports.ros2.arrivals import Take
from transports.ros2.raw_subscription import RawSubscription
from transports.woken import woken_by_signals


class WaitSetArrivals:
    """Tells where something has arrived; see ``transports.ros2.arrivals.Arrivals`` for every method.

    Args:
        context: rclpy's, of the node.
    """

    def __init__(self, context: Any) -> None:
        self._context = context
        self._guard = GuardCondition(callback=None, callback_group=None, context=context)
        self._lock = threading.RLock()
        """A signal's handler may ring while its own thread does."""
        self._wanted: list[tuple[str, Any, Take]] = []
        self._waits = self._new_set()
        self._pauses = self._new_set()
        self._closed = False

    def _new_set(self) -> Any:
        """A wait set with room for what is wanted, and for the guard condition."""
        kinds = [kind for kind, _, _ in self._wanted]
        subscriptions, clients, services = map(kinds.count, ("subscription", "client", "service"))
        with self._context.handle:
            return _rclpy.WaitSet(subscriptions, 1, 0, clients, services, 0, self._context.handle)

    def ring(self) -> None:
        """End a wait, the present one or the next; from any thread."""
        with self._lock:
            if not self._closed:
                self._guard.trigger()

    def watch_only(self, wanted: list[tuple[str, Any, Take]]) -> list[Take]:
        """Watch these and no others. None is returned: what came before is reported by the next wait."""
        self._wanted = list(wanted)
        self._waits.destroy_when_not_in_use()
        self._waits = self._new_set()
        return []

    def wait(self, timeout_ns: int) -> list[tuple[Take, int]]:
        """Wait until something has arrived, ``ring`` or a signal, or for ``timeout_ns`` (-1: for ever).

        With each that has something, 1: how much it is shows when it is taken, and what is left by the
        next wait.
        """
        waits = self._waits
        waits.clear_entities()
        waits.add_guard_condition(self._guard.handle)
        places = []
        with ExitStack() as held:
            for kind, entity, take in self._wanted:
                try:
                    held.enter_context(entity.handle)
                except InvalidHandle:  # gone already
                    continue
                places.append((kind, _add(waits, kind, entity.handle), take))
            waits.wait(timeout_ns)
            return [(take, 1) for kind, place, take in places if waits.is_ready(kind, place)]

    def pause(self, timeout_s: float) -> None:
        """Wait for ``timeout_s``, or until ``ring`` or a signal, whatever arrives."""
        self._rang_within(0)  # what rang before has ended a wait
        if self._rang_within(int(timeout_s * 1e9)):
            self.ring()  # it is to end the next wait too

    def _rang_within(self, timeout_ns: int) -> bool:
        self._pauses.clear_entities()
        place = self._pauses.add_guard_condition(self._guard.handle)
        self._pauses.wait(timeout_ns)
        return bool(self._pauses.is_ready("guard_condition", place))

    def close(self) -> None:
        """Watch nothing any more; idempotent, and nobody waits."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            self._wanted.clear()
            self._waits.destroy_when_not_in_use()
            self._pauses.destroy_when_not_in_use()
            self._guard.destroy()

    def woken_by_signals(self) -> AbstractContextManager[None]:
        """See ``transports.woken``."""
        return nullcontext() if self._closed else woken_by_signals(self.ring)


def _add(waits: Any, kind: str, handle: Any) -> int:
    """Wait for what has this handle as well; its place among its kind."""
    if isinstance(handle, RawSubscription):
        return native.add_subscription(waits, handle.pointer)
    add = {
        "subscription": waits.add_subscription,
        "client": waits.add_client,
        "service": waits.add_service,
    }[kind]
    return int(add(handle))
