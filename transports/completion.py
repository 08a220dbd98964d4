"""A value that one thread waits for and another delivers."""

from __future__ import annotations

import threading
from typing import Any


class Completion:
    """See ``transports.interface.Completion``, in real time."""

    def __init__(self) -> None:
        self._ready = threading.Event()
        self._lock = threading.Lock()
        self._value: Any = None

    def set(self, value: Any) -> None:
        """Deliver ``value``; only the first delivery counts."""
        with self._lock:
            if not self._ready.is_set():
                self._value = value
                self._ready.set()

    def wait(self, timeout_s: float) -> Any:
        """The value, or None after ``timeout_s`` seconds of real time."""
        self._ready.wait(timeout_s)
        return self._value
