"""Callers that wait, one at a time: threads that hand the world over to one another.

A task's thread runs only between ``resume`` and its next ``pause``; whoever resumed it stands still
meanwhile. Threads are used for their stacks alone: at no time do two of them run.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

_local = threading.local()


class TaskAbandonedError(BaseException):
    """Unwinds a task whose world is closed; not an Exception, so that no handler keeps it."""


def current_task() -> Task | None:
    """The task of the calling thread, if it is one's."""
    task: Task | None = getattr(_local, "task", None)
    return task


class Task:
    """A caller with a stack of its own."""

    def __init__(self, work: Callable[[], None], name: str) -> None:
        self._work = work
        self._go = threading.Lock()  # as a semaphore of one: the two sides take turns
        self._go.acquire()
        self._back = threading.Lock()
        self._back.acquire()
        self._error: BaseException | None = None
        self._abandoned = False
        self.done = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def resume(self) -> None:
        """Let the task run until it pauses or ends; raises what ended it."""
        if self.done:
            return
        if not self._thread.is_alive():
            self._thread.start()
        self._go.release()
        self._back.acquire()
        if self._error is not None:
            error, self._error = self._error, None
            raise error

    def pause(self) -> None:
        """Hand the world back to who resumed this task, until it is resumed again."""
        if self._abandoned:  # nobody waits for it any more
            raise TaskAbandonedError
        self._back.release()
        self._go.acquire()
        if self._abandoned:
            raise TaskAbandonedError

    def abandon(self) -> None:
        """End the task where it waits."""
        if not self.done and self._thread.is_alive() and current_task() is not self:
            self._abandoned = True
            self._go.release()
            self._thread.join()
        self.done = True

    def _run(self) -> None:
        self._go.acquire()
        _local.task = self
        try:
            if not self._abandoned:
                self._work()
        except TaskAbandonedError:
            pass
        except (
            BaseException
        ) as error:  # raised again by ``resume``, on the thread that waits for it
            self._error = error
        self.done = True
        self._back.release()
