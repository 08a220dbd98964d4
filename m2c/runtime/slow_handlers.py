"""Says which handler of a node takes its time, while it does: no other of the node's runs meanwhile."""

from __future__ import annotations

import functools
import logging
import sys
import threading
import time
from collections.abc import Callable
from typing import NamedTuple, ParamSpec, TypeVar

from m2c.raised import where

LIMIT_S = 1.0
"""A handler that runs longer than that is told."""

P = ParamSpec("P")
R = TypeVar("R")


class _Running(NamedTuple):
    """A handler that runs, the thread that it runs on, and since when (s, of ``time.monotonic``)."""

    name: str
    thread: int
    since_s: float


class SlowHandlers:
    """Warns of each handler of one node that runs for :data:`LIMIT_S`, and again when that has doubled.

    A thread looks at least every :data:`LIMIT_S` while handlers run, and ends when none did for so long. It
    samples: an event to await would cost each handler a wake-up of that thread.
    Time is real time, also where that of the node is virtual.

    Args:
        log: of the node.
    """

    def __init__(self, log: logging.Logger) -> None:
        self._log = log
        self._lock = threading.Lock()
        self._running: _Running | None = None
        self._calls = 0
        self._is_watched = False
        self._told_s: dict[str, float] = {}

    def watched(self, handler: Callable[P, R]) -> Callable[P, R]:
        """``handler``, which is told of if it takes its time."""
        name = getattr(handler, "__qualname__", type(handler).__name__)

        @functools.wraps(handler)
        def call(*given: P.args, **named: P.kwargs) -> R:
            outer = self._begin(_Running(name, threading.get_ident(), time.monotonic()))
            try:
                return handler(*given, **named)
            finally:
                self._running = outer

        return call

    def _begin(self, running: _Running) -> _Running | None:
        with self._lock:
            outer, self._running = self._running, running
            self._calls += 1
            is_watched, self._is_watched = self._is_watched, True
        if not is_watched:
            threading.Thread(target=self._watch, name="slow handlers", daemon=True).start()
        return outer

    def _watch(self) -> None:
        calls = -1
        while True:
            with self._lock:
                running = self._running
                if running is None and calls == self._calls:
                    self._is_watched = False
                    return
                calls = self._calls
            time.sleep(LIMIT_S if running is None else self._look_at(running))

    def _look_at(self, running: _Running) -> float:
        """Warn of ``running`` if it is due; in how many seconds to look again."""
        took_s = time.monotonic() - running.since_s
        due_s = max(LIMIT_S, 2 * self._told_s.get(running.name, 0.0))
        if took_s < due_s:
            return min(due_s - took_s, LIMIT_S)
        place = where(sys._current_frames().get(running.thread))
        if self._running is running:
            self._told_s[running.name] = took_s
            self._log.warning(
                "%s has run for %.1f s, and no other handler of this node does meanwhile; it is in %s",
                running.name,
                took_s,
                place,
            )
        return LIMIT_S
