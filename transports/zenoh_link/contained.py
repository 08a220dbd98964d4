"""An executor's work for one of many who share it: what fails there ends that work, and nobody else's."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Protocol

from transports.timers import Timer
from transports.zenoh_link.executor import Executor, Work, call


class Runner(Protocol):
    """What runs the work of a tap: an executor, or a part of one."""

    @property
    def put(self) -> Callable[[Work], None]:
        """See ``Executor.put``."""
        ...

    def after(self, delay_s: float, handler: Callable[[], None]) -> Timer:
        """See ``Executor.after``."""
        ...


class Contained:
    """Work for one of those who share ``executor``.

    The first exception ends it: ``failed`` gets it, and nothing of this work is run any more. Whatever was
    raised is caught, as it is known of no handler that it has no fault; only an OSError, of a file or of a
    reader that is gone, concerns all who write there.
    """

    def __init__(self, executor: Executor, failed: Callable[[Exception], None]) -> None:
        self._executor = executor
        self._failed = failed
        self._is_over = False
        self._repeated: list[Timer] = []

    def put(self, work: Work) -> None:
        """See ``Executor.put``."""
        self._executor.put((self._run, work))

    def post(self, handler: Callable[[], None]) -> None:
        """See ``Executor.post``."""
        self._executor.put((self._run, (call, handler)))

    def after(self, delay_s: float, handler: Callable[[], None]) -> Timer:
        """See ``Executor.after``."""
        return self._executor.after(delay_s, partial(self._run, (call, handler)))

    def every(self, period_s: float, handler: Callable[[], None]) -> Timer:
        """See ``Executor.every``."""
        timer = self._executor.every(period_s, partial(self._run, (call, handler)))
        self._repeated.append(timer)
        return timer

    def close(self) -> None:
        """Run nothing more; idempotent."""
        self._is_over = True
        for timer in self._repeated:
            timer.cancel()

    def _run(self, work: Work) -> None:
        if self._is_over:
            return
        function, argument = work
        try:
            function(argument)
        except OSError:
            raise
        except Exception as error:
            self.close()
            self._failed(error)
