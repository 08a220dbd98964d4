"""SIGINT, SIGTERM and SIGHUP of a process that opens a transport.

None must come in between while a middleware is being opened. A node of ROS 2 that is killed then
leaves its shared memory behind, at worst with a lock of Fast DDS in it that nobody opens any more: other
nodes wait for that lock for ever, also those of a later run. And an exception in the midst of rclpy's
import or of a constructor leaves half of a participant, whose threads go on.
"""

from __future__ import annotations

import signal
from collections.abc import Callable


def stopping() -> tuple[signal.Signals, ...]:
    """What asks a process to end: Ctrl-C, ``kill``, and a terminal or an ssh session that is gone.

    Who is started to outlive its terminal (nohup(1)) has SIGHUP ignored, and goes on.
    """
    outlives = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    both = (signal.SIGINT, signal.SIGTERM)
    return both if outlives else (*both, signal.SIGHUP)


class StopSignals:
    """From now on, these signals are kept until ``call`` says what they stop.

    For the main thread, before it connects. A second signal that finds nothing to stop yet ends the
    process at once.
    """

    def __init__(self) -> None:
        self._stop: Callable[[], None] | None = None
        self._asked = False
        for number in stopping():
            signal.signal(number, self._came)

    @property
    def asked(self) -> bool:
        """Whether a signal has come."""
        return self._asked

    def call(self, stop: Callable[[], None]) -> None:
        """Call ``stop()`` at every signal, and now if one has come already.

        It runs between any two instructions of the main thread, so it must take no lock that this
        thread may hold: ``Transport.post`` is made for that.
        """
        self._stop = stop
        if self._asked:
            stop()

    def _came(self, number: int, _: object) -> None:
        again, self._asked = self._asked, True
        if self._stop is not None:
            self._stop()
        elif again:
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)
