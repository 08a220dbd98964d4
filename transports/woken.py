"""A signal ends the wait of the main thread, so that Python can run its handler."""

from __future__ import annotations

import contextlib
import signal
import socket
import threading
from collections.abc import Callable, Iterator

_SIGNALS = 64
"""Bytes that are read at a time, each of a signal."""


@contextlib.contextmanager
def woken_by_signals(ring: Callable[[], None]) -> Iterator[None]:
    """While the main thread waits, each signal has ``ring`` called, on another thread, to end the wait.

    Python runs handlers on its main thread between two of its instructions. A signal that comes when
    that thread has looked for signals and does not sleep yet, or that another thread receives, wakes
    nobody: the process would end at the next message.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    reader, writer = socket.socketpair()
    writer.setblocking(False)

    def work() -> None:
        with reader:
            while reader.recv(_SIGNALS):
                ring()

    thread = threading.Thread(target=work, name="signals", daemon=True)
    thread.start()
    before = signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        writer.close()
        thread.join()
