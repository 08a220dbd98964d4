"""What waits for virtual time: timers, and callers that wait for a value."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from transports.interface import TransportError
from transports.simulated.parts import Node, Rank, World
from transports.simulated.tasks import Task, current_task


class Completion:
    """A value that one caller waits for; see ``transports.interface.Completion``."""

    __slots__ = ("_task", "_value", "_world", "ready")

    def __init__(self, world: World) -> None:
        self._world = world
        self._value: Any = None
        self._task: Task | None = None
        self.ready = False

    def set(self, value: Any) -> None:
        """Deliver ``value``; only the first delivery counts. From any thread."""
        self._world.enter(self._set, value)

    def _set(self, value: Any) -> None:
        if self.ready:
            return
        self.ready = True
        self._value = value
        if self._task is not None:
            self._world.schedule(0, Task.resume, self._task)

    def wait(self, timeout_s: float) -> Any:
        """The value, or None after ``timeout_s`` virtual seconds, whose events run meanwhile."""
        world = self._world
        if world.running is not None:
            raise TransportError(
                f"{world.running} waits in a handler: nothing else of it would run meanwhile"
            )
        deadline_ns = world.now_ns + max(0, round(timeout_s * 1e9))
        task = current_task()
        if task is None:
            world.run(lambda: self.ready, deadline_ns)
        elif not self.ready:
            self._task = task
            waiting = [True]

            def give_up(_: object) -> None:
                if waiting and not self.ready:
                    task.resume()

            world.schedule(deadline_ns - world.now_ns, give_up, None, Rank.TIMER)
            task.pause()
            waiting.clear()
            self._task = None
        return self._value


class Timer:
    """A running timer."""

    __slots__ = ("_handler", "_node", "_period_ns")

    def __init__(
        self, node: Node, delay_ns: int, period_ns: int, handler: Callable[[], None]
    ) -> None:
        self._node = node
        self._handler: Callable[[], None] | None = handler
        self._period_ns = period_ns
        node.world.schedule(delay_ns, self._fire, None, Rank.TIMER)

    def cancel(self) -> None:
        """Stop it; idempotent."""
        self._handler = None

    def _fire(self, _: object) -> None:
        node = self._node
        if self._handler is None or not node.alive:
            return
        if self._period_ns:
            still_ns = (
                node.still_ns()
            )  # ticks that are slept through are skipped, the phase is kept
            periods = -(-still_ns // self._period_ns) or 1
            node.world.schedule(periods * self._period_ns, self._fire, None, Rank.TIMER)
        node.work(self._run, None)

    def _run(self, _: object) -> None:
        if self._handler is not None:
            self._handler()
