"""What transports with an executor of their own have in common: they hand on to it, and end once."""

from __future__ import annotations

import atexit
import threading
from abc import abstractmethod
from collections.abc import Callable
from typing import Protocol

from transports import actions
from transports.completion import Completion
from transports.interface import Action, ActionClient, Connection, GoalHandle, TransportError
from transports.timers import Timer


class Executor(Protocol):
    """One thread that runs everything of a node."""

    def every(self, period_s: float, handler: Callable[[], None]) -> Timer:
        """See ``Transport.every``."""
        ...

    def after(self, delay_s: float, handler: Callable[[], None]) -> Timer:
        """See ``Transport.after``."""
        ...

    def post(self, handler: Callable[[], None]) -> None:
        """See ``Transport.post``."""
        ...

    def spin(self, until: Callable[[], bool] | None = None) -> None:
        """See ``Transport.spin``."""
        ...

    def is_current(self) -> bool:
        """Whether the calling thread is the one that spins."""
        ...

    def close(self) -> None:
        """End ``spin``; idempotent, from any thread."""
        ...


class OnExecutor(Connection):
    """A transport whose node runs on ``executor``; its subclass declares, and releases at the end.

    Args:
        node: the node's name.
        executor: what runs its handlers.
    """

    repair_s: float = 0.0
    reports_takes: bool = False

    def __init__(self, node: str, executor: Executor) -> None:
        self._node = node
        self._executor = executor
        self._closing = threading.Lock()
        self._closer = 0
        self._closed = threading.Event()
        self._others: list[OnExecutor] = []
        """Connected beside this one."""

    @property
    def node(self) -> str:
        """The name of this node."""
        return self._node

    def beside(self, node: str) -> OnExecutor:
        """Connect another node of this process; see ``transports.interface.Transport``."""
        self._require_open()
        other = self._beside(node)
        self._others.append(other)
        return other

    def serve_action(
        self,
        action: Action,
        goal: Callable[[GoalHandle], None],
        cancel: Callable[[GoalHandle], None],
    ) -> None:
        """Serve ``action``."""
        actions.serve_action(self, action, goal, cancel)

    def action_client(self, action: Action) -> ActionClient:
        """A client of ``action``."""
        return actions.action_client(self, action)

    def every(self, period_s: float, handler: Callable[[], None]) -> Timer:
        """Call ``handler`` every ``period_s`` seconds, without drift."""
        return self._executor.every(period_s, handler)

    def after(self, delay_s: float, handler: Callable[[], None]) -> Timer:
        """Call ``handler`` once, ``delay_s`` seconds from now."""
        return self._executor.after(delay_s, handler)

    def post(self, handler: Callable[[], None]) -> None:
        """Run ``handler`` on the executor thread; callable from any thread."""
        self._executor.post(handler)

    def completion(self) -> Completion:
        """A fresh completion."""
        return Completion()

    def tick_complete(self) -> None:
        """Nothing to do, unless a subclass has."""

    def spin(self, until: Callable[[], bool] | None = None) -> None:
        """Run the executor on the calling thread until ``close()`` (or until ``until()``)."""
        try:
            self._executor.spin(until)
        except TransportError:
            if not self._is_closing():
                raise  # else a handler was at work as the node closed beneath it

    def close(self) -> None:
        """Stop and release everything; idempotent, from any thread."""
        if not self._closing.acquire(blocking=False):
            is_within = self._closer == threading.get_ident()  # a signal handler
            if not is_within and not self._is_awaited():
                self._closed.wait()
            return
        self._closer = threading.get_ident()
        for other in self._others:
            other.close()
        self._executor.close()
        self._release()
        self._closed.set()
        atexit.unregister(self.close)

    def _close_at_exit(self) -> None:
        """For the end of a subclass's constructor: what ``_release`` needs is there.

        A process that ends while the middleware still calls back can hang or crash in it.
        """
        atexit.register(self.close)

    def _is_awaited(self) -> bool:
        """Whether ``close`` waits for the calling thread: it runs this node, or one beside it."""
        return self._executor.is_current() or any(other._is_awaited() for other in self._others)

    def _is_closing(self) -> bool:
        return self._closer != 0

    def _require_open(self) -> None:
        if self._is_closing():
            raise TransportError(f"{self._node} is closed")

    @abstractmethod
    def _beside(self, node: str) -> OnExecutor:
        """Connect ``node`` on what this one has opened."""

    @abstractmethod
    def _release(self) -> None:
        """Let go of what was declared, once, after the executor was told to end."""
