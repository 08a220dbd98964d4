"""One thread that runs everything: what has arrived, posted work, and timers.

rclpy's own executors want a service's answer from its callback; this one takes requests and
responses itself and hands them on, so that an answer can come later. What rclpy declares on the
node for itself (parameter services, the ``/clock`` subscription) runs here as well.
"""

# rclpy leaves some of its functions without types
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

import logging
import os
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from rclpy.clock import ClockChange, JumpThreshold
from rclpy.duration import Duration

from transports.gathering import Gathering
from transports.interface import TransportError
from transports.refusals import Refusals
from transports.ros2 import native
from transports.ros2.arrivals import Arrivals, Take
from transports.ros2.raw_subscription import RawSubscription
from transports.ros2.wait_set import WaitSetArrivals
from transports.timers import Timer, Timers

LOG = logging.getLogger("transports.ros2")
"""Where this transport reports what it dropped and what cannot work."""

_AT_ONCE = 64
"""Messages taken from one subscription before the others have their turn, if nothing else is given."""


WAIT_SET = "TRANSPORTS_ROS2_WAIT_SET"
"""Set in the environment: nodes wait by wait sets, also where rcl can report arrivals."""


def arrivals_of(node: Any) -> Arrivals | WaitSetArrivals:
    """How ``node`` learns what has arrived: reported by rcl if that works here, else by a wait set."""
    if not os.environ.get(WAIT_SET) and native.tells_of_arrivals(node):
        return Arrivals()
    return WaitSetArrivals(node.context)


class RosClock:
    """The node's clock for timers: steady in real time, the simulation's with ``use_sim_time``."""

    def __init__(self, clock: Any, timers_of: Callable[[], Timers]) -> None:
        self._clock = clock
        self._timers_of = timers_of
        self._before_ns = 0
        self.simulated = bool(clock.ros_time_is_active)
        threshold = JumpThreshold(
            min_forward=Duration(nanoseconds=1),
            min_backward=Duration(nanoseconds=-1),
            on_clock_change=True,
        )
        self._jumps = clock.create_jump_callback(
            threshold, pre_callback=self._before_jump, post_callback=self._after_jump
        )

    def now_ns(self) -> int:
        """Now; only differences mean something."""
        if self.simulated:
            return int(self._clock.now().nanoseconds)
        return time.monotonic_ns()

    def _before_jump(self) -> None:
        self._before_ns = self.now_ns()

    def _after_jump(self, jump: Any) -> None:
        """Timers keep the time that was left to them when the clock is exchanged, starts (from 0,
        with a simulation's first message) or is set back.
        """
        if jump.clock_change == ClockChange.ROS_TIME_ACTIVATED:
            self.simulated = True
        elif jump.clock_change == ClockChange.ROS_TIME_DEACTIVATED:
            self.simulated = False
        elif self._before_ns and jump.delta.nanoseconds > 0:
            return
        self._timers_of().shift(self.now_ns() - self._before_ns)


class Executor:
    """Runs one node; see ``transports.interface.Transport`` for what is promised of it."""

    def __init__(self, node: Any, refusals: Refusals) -> None:
        self._node = node
        self._refusals = refusals
        self._arrivals = arrivals_of(node)
        self._posted: deque[Callable[[], None]] = deque()
        self._takers: dict[int, tuple[Any, Take]] = {}
        self._most: dict[Take, int] = {}
        self._patient: set[Take] = set()
        self._gathering = Gathering()
        self._after_taking: list[Callable[[], None]] = []
        self._clock = RosClock(node.get_clock(), lambda: self._ros_timers)
        self._ros_timers = Timers(self._clock.now_ns, self._run_here)
        self._steady_timers = Timers(time.monotonic_ns, self._run_here)
        self._spinner = threading.Lock()
        self._thread = 0
        self._ready: dict[Take, int] = {}
        """What may have something to take, in turn, and how often it is asked at least: reported once of
        each arrival, that is known until then."""
        self._ignored: list[Any] = []
        self._stale = True
        self._closed = False
        node.executor = self

    # What rclpy's Node asks of its executor.

    def add_node(self, node: Any) -> bool:
        """Called by the node; there is only one."""
        return True

    def remove_node(self, node: Any) -> None:
        """Called by the node when it is destroyed."""

    def wake(self) -> None:
        """Something was declared or withdrawn."""
        self._stale = True
        self._arrivals.ring()

    # Ours.

    def simulated_ns(self) -> int | None:
        """The simulation's time, ns since the epoch; None if there is none."""
        return self._clock.now_ns() if self._clock.simulated else None

    def is_current(self) -> bool:
        """Whether the calling thread is the one that spins."""
        return threading.get_ident() == self._thread

    def handle(
        self, entity: Any, take: Take, most: int = _AT_ONCE, is_patient: bool = False
    ) -> None:
        """Call ``take()`` when ``entity`` (a subscription, service or client) has something.

        Args:
            entity: of rclpy.
            take: handles one message and returns whether there was one.
            most: so many are taken in a turn.
            is_patient: what comes often may lie for some ms, to be taken together.
        """
        self._takers[id(entity)] = (entity, take)
        self._most[take] = most
        if is_patient:
            self._patient.add(take)
        self.wake()

    def after_taking(self, handler: Callable[[], None]) -> None:
        """Call ``handler`` behind each turn in which something was taken, before anything else."""
        self._after_taking.append(handler)

    def no_longer_after_taking(self, handler: Callable[[], None]) -> None:
        """Undo ``after_taking``."""
        self._after_taking.remove(handler)

    def ignore(self, entity: Any) -> None:
        """Leave ``entity`` to somebody else."""
        self._ignored.append(entity)
        self.wake()

    def forget(self, entity: Any) -> None:
        """Undo ``handle``; on the executor's thread, or when nobody spins."""
        _, take = self._takers.pop(id(entity), (None, None))
        if take is not None:
            self._ready.pop(take, None)
            self._most.pop(take, None)
            self._patient.discard(take)
        self.wake()

    def post(self, handler: Callable[[], None]) -> None:
        """Run ``handler`` on the executor's thread; callable from any thread."""
        self._posted.append(handler)
        if threading.get_ident() != self._thread:
            self._arrivals.ring()

    def after(self, delay_s: float, handler: Callable[[], None]) -> Timer:
        """Call ``handler`` once, on the ROS clock."""
        return self._ros_timers.after(delay_s, handler)

    def every(self, period_s: float, handler: Callable[[], None]) -> Timer:
        """Call ``handler`` each ``period_s`` of the ROS clock: lateness does not add up."""
        return self._ros_timers.every(period_s, handler)

    def after_real(self, delay_s: float, handler: Callable[[], None]) -> Timer:
        """Call ``handler`` once, in real time: a call must end even if a simulation stands still."""
        return self._steady_timers.after(delay_s, handler)

    def close(self) -> None:
        """End ``spin``; idempotent, from any thread."""
        self._closed = True
        self._arrivals.ring()

    def wait_until_idle(self) -> None:
        """Wait until no thread spins (unless the calling one does)."""
        if not self.is_current():
            self._spinner.acquire()
            self._spinner.release()

    def destroy(self) -> None:
        """Release what the executor holds; nothing spins any more."""
        self._takers.clear()
        self._ready.clear()
        self._arrivals.close()

    def spin(self, until: Callable[[], bool] | None = None) -> None:
        """Run until ``close()`` or until ``until()`` holds, which is asked before each piece of work."""
        if not self._spinner.acquire(blocking=False):
            raise TransportError("this transport is already spinning on another thread")
        self._thread = threading.get_ident()
        try:
            with self._arrivals.woken_by_signals():
                self._run(until)
        finally:
            self._thread = 0
            self._spinner.release()

    def _run_here(self, handler: Callable[[], None]) -> None:
        if self.is_current():
            handler()
        else:
            self.post(handler)

    def _run(self, until: Callable[[], bool] | None) -> None:
        while not self._closed:
            if until is not None and until():
                return
            # Each kind of work has its turn: none keeps the others waiting for ever.
            for _ in range(len(self._posted)):
                self._posted.popleft()()
                if self._closed or (until is not None and until()):
                    return
            for timers in (self._steady_timers, self._ros_timers):
                handler = timers.take_due()
                if handler is not None:
                    handler()
                    if self._closed or (until is not None and until()):
                        return
            if not self._take_what_arrived(until):
                return

    def _take_what_arrived(self, until: Callable[[], bool] | None) -> bool:
        """Wait, and take some of everything there is; False if the executor is to end."""
        arrivals, ready = self._arrivals, self._ready
        if self._stale:
            self._stale = False
            for take in arrivals.watch_only(self._collect()):
                ready.setdefault(take, 1)
        is_idle = not (ready or self._posted or self._stale or self._closed)
        arrived = arrivals.wait(self._wait_ns() if is_idle else 0)
        is_patient = is_idle and arrived and self._patient.issuperset(take for take, _ in arrived)
        if is_patient and (wait_s := self._gathering.wait_s()):
            arrivals.pause(wait_s)
            arrived += arrivals.wait(0)
        for take, count in arrived:
            ready[take] = ready.get(take, 0) + count
        if not ready:
            return True
        for take in list(ready):
            for _ in range(self._most.get(take, _AT_ONCE)):
                if self._closed or (until is not None and until()):
                    return False
                is_taken = take()
                left = ready.get(take)
                if left is None:  # forgotten by what it took
                    break
                if left > 0:
                    ready[take] = left - 1
                elif not is_taken:
                    del ready[take]
                    break
        for handler in list(self._after_taking):
            handler()
        return True

    def _wait_ns(self) -> int:
        """Until the next timer; -1 means for ever. Simulated time is moved by what arrives."""
        waits = [self._steady_timers.wait_ns()]
        if (ros_ns := self._ros_timers.wait_ns()) is not None and (
            not self._clock.simulated or ros_ns == 0
        ):
            waits.append(ros_ns)
        return min((wait for wait in waits if wait is not None), default=-1)

    def _collect(self) -> list[tuple[str, Any, Take]]:
        found: list[tuple[str, Any, Take]] = []
        node, takers = self._node, self._takers
        raw = [entity for entity, _ in takers.values() if isinstance(entity, RawSubscription)]
        for kind, entities in (
            ("subscription", raw),
            ("subscription", node.subscriptions),
            ("client", node.clients),
            ("service", node.services),
        ):
            for entity in entities:
                known = takers.get(id(entity))
                if entity in self._ignored:
                    continue
                if known is not None:
                    found.append((kind, entity, known[1]))
                elif kind == "subscription":
                    found.append((kind, entity, _take_for_rclpy(entity, self._refusals)))
                elif kind == "service":
                    found.append((kind, entity, _serve_for_rclpy(entity, self._refusals)))
        return found


def _take_for_rclpy(subscription: Any, refusals: Refusals) -> Take:
    def take() -> bool:
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
        if taken is None:
            return False
        with refusals.contained(subscription.topic_name):
            subscription.callback(taken[0])
        return True

    return take


def _serve_for_rclpy(service: Any, refusals: Refusals) -> Take:
    def take() -> bool:
        with service.handle:
            request, header = service.handle.service_take_request(service.srv_type.Request)
        if header is None:
            return False
        with refusals.contained(service.srv_name):
            service.send_response(service.callback(request, service.srv_type.Response()), header)
        return True

    return take
