"""Taps that have received nothing: one thread waits for the first message of all of them.

Whoever listens to many systems has a tap for each. A thread for each is needed only by those that something
comes for: anybody may announce any number of systems in which nothing ever happens.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import zenoh

PERIOD_S = 0.01
"""A first message is found at latest after so long."""
_SHARE = 40
"""Looking takes at most one of so many parts of the time, however many taps there are (0.25 µs each)."""

Begin = Callable[[Any], None]
"""Called on the thread with the first message that has come for a tap."""


class IdleTaps:
    """Waits for the first message of each of many taps; the thread is there while there are some."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: dict[Any, Begin] = {}
        self._changed = threading.Event()
        self._thread: threading.Thread | None = None

    def add(self, ring: Any, begin: Begin) -> None:
        """Call ``begin`` with the first message that lies in ``ring`` (a Zenoh handler); from any thread."""
        with self._lock:
            self._waiting[ring] = begin
            if self._thread is None:
                self._thread = threading.Thread(target=self._look, name="zenoh-idle", daemon=True)
                self._thread.start()

    def remove(self, ring: Any) -> None:
        """Wait for ``ring`` no more: ``begin`` is not running when this returns, and will not be called."""
        with self._lock:
            if self._waiting.pop(ring, None) is not None and not self._waiting:
                self._changed.set()

    def close(self) -> None:
        """Wait for nothing more, until something is added; returns when the thread has ended."""
        with self._lock:
            self._waiting.clear()
            thread = self._thread
            self._changed.set()
        if thread is not None:
            thread.join()

    def _look(self) -> None:
        while True:
            began_s = time.perf_counter()
            with self._lock:
                for ring, begin in tuple(self._waiting.items()):
                    self._look_at(ring, begin)
                if not self._waiting:
                    self._thread = None
                    self._changed.clear()
                    return
            took_s = time.perf_counter() - began_s
            self._changed.wait(max(PERIOD_S, took_s * _SHARE))

    def _look_at(self, ring: Any, begin: Begin) -> None:
        try:
            sample = ring.try_recv()
        except zenoh.ZError:  # its subscriber is undeclared
            del self._waiting[ring]
            return
        if sample is not None:
            del self._waiting[ring]
            begin(sample)
