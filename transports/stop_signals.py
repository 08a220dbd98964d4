"""SIGINT, SIGTERM and SIGHUP of a process that opens a transport.

None must come in between while a middleware is being opened. A node of ROS 2 that is killed then
leaves its shared memory behind, at worst with a lock of Fast DDS in it that nobody opens any more: other
nodes wait for that lock for ever, also those of a later run. And an exception in the midst of rclpy's
import or of a constructor leaves half of a participant, whose threads go on.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Callable

AGAIN_S = 1.0
"""What comes so soon behind a signal asks for the same thing."""
ENDING = signal.SIGUSR1
"""By which who runs a system says to who observes it that its nodes are about to be ended."""


def stopping() -> tuple[signal.Signals, ...]:
    """What asks a process to end: Ctrl-C, ``kill``, and a terminal or an ssh session that is gone.

    Who is started to outlive its terminal (nohup(1)) has SIGHUP ignored, and goes on.
    """
    outlives = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    both = (signal.SIGINT, signal.SIGTERM)
    return both if outlives else (*both, signal.SIGHUP)


def end_by(number: int) -> None:
    """End this process by the signal ``number``, as if it had no handler."""
    signal.signal(number, signal.SIG_DFL)
    signal.raise_signal(number)


class StopSignals:
    """From now on, these signals are kept until ``call`` says what they stop.

    For the main thread, before it connects. A second signal that finds nothing to stop yet ends the
    process at once. What follows within ``again_s`` seconds belongs to the signal before: timeout(1)
    sends one to the process that it has started and one to its process group.
    """

    def __init__(self, again_s: float = AGAIN_S) -> None:
        self._stop: Callable[[], None] | None = None
        self._again: Callable[[int], None] | None = None
        self._again_s = again_s
        self._asked_s: float | None = None
        self.number = 0
        """Of the first signal that came; 0: none has."""
        for number in stopping():
            signal.signal(number, self._came)

    @classmethod
    def kept(cls) -> StopSignals:
        """Those that this process keeps already, else new ones."""
        return cls._keeping() or cls()

    @classmethod
    def came(cls) -> int:
        """The signal that those which this process keeps got first; 0 if none came, or none are kept."""
        keeping = cls._keeping()
        return 0 if keeping is None else keeping.number

    @classmethod
    def _keeping(cls) -> StopSignals | None:
        keeping = getattr(signal.getsignal(signal.SIGINT), "__self__", None)
        return keeping if isinstance(keeping, cls) else None

    @property
    def asked(self) -> bool:
        """Whether a signal has come."""
        return self._asked_s is not None

    def call(self, stop: Callable[[], None], again: Callable[[int], None] | None = None) -> None:
        """Call ``stop()`` at the first signal (now if it has come) and ``again(number)`` at the others.

        Without ``again``, ``stop()`` is called again. Both run between any two instructions of the main
        thread, so they must take no lock that this thread may hold: ``Transport.post`` is made for that.
        """
        self._stop, self._again = stop, again
        if self.asked:
            stop()

    def _came(self, number: int, _: object) -> None:
        before_s, now_s = self._asked_s, time.monotonic()
        if before_s is not None and now_s - before_s < self._again_s:
            return
        self._asked_s = now_s
        self.number = self.number or number
        if self._stop is None:
            if before_s is not None:
                end_by(number)
        elif before_s is not None and self._again is not None:
            self._again(number)
        else:
            self._stop()
