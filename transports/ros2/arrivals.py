"""What has arrived at a node's subscriptions, services and clients, waited for without a wait set.

A wait set is filled anew for each wait, and Fast DDS locks every reader in it twice: with the sixty
subscriptions of a tap that takes longer than the message that is waited for. rcl can call a function
at each arrival instead (``rcl_subscription_set_on_new_message_callback`` and its like), on a thread of
the middleware that holds the reader's lock. Python code must not run there: it would want the
interpreter's lock, which may be held by who wants the reader's. So the function is libc's own
``eventfd_write``: its arguments, a number of a file and one to add, are what rcl passes on.

Where rcl, the RMW or the machine does not allow that, ``transports.ros2.wait_set`` stands for this.

The file counts arrivals, and that count matters: all clients of a service have one topic for its answers,
and rmw drops what is for others in the same call in which it would have been taken. Taking nothing does not
mean that nothing is left.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import socket
import threading
from collections.abc import Callable
from typing import Any

import msgspec
from rclpy.exceptions import InvalidHandle

from transports.ros2 import native

Take = Callable[[], bool]
"""Handles one message and returns whether there was one."""

_MOST_BELLS = 64
"""Files that a node opens for this: beyond it entities share them, and are looked at together."""
MOST_FILES = _MOST_BELLS + 4
"""That a node has open: these, its own bell, epoll's and two for signals."""
_FLAGS = os.EFD_NONBLOCK | os.EFD_CLOEXEC
_MILLISECOND_NS = 10**6
_SHORT_NS = 2 * _MILLISECOND_NS
"""What is left of a wait for select(2), which is more exact and takes twice as long as epoll alone."""
_SIGNALS = 64
_SELECTABLE = 1024
"""FD_SETSIZE."""


class _Watched(msgspec.Struct, eq=False):
    """One entity of rclpy."""

    kind: str
    entity: Any
    take: Take
    bell: int


class Arrivals:
    """Tells where something has arrived. One thread waits; any may ``ring``."""

    def __init__(self) -> None:
        self._poll = select.epoll()
        self._can_select = self._poll.fileno() < _SELECTABLE
        self._lock = threading.RLock()
        """A signal's handler may ring while its own thread does."""
        self._bell = self._new_bell()
        self._watched: dict[int, _Watched] = {}
        self._behind: dict[int, list[_Watched]] = {}
        """Who rings each of the other bells."""
        self._signals: socket.socket | None = None
        self._closed = False

    def _new_bell(self) -> int:
        bell = os.eventfd(0, _FLAGS)
        # each write is an event of its own, whether somebody reads or not
        self._poll.register(bell, select.EPOLLIN | select.EPOLLET)
        return bell

    def ring(self) -> None:
        """End a wait, the present one or the next; from any thread."""
        with self._lock:
            if not self._closed:
                os.eventfd_write(self._bell, 1)

    def watch_only(self, wanted: list[tuple[str, Any, Take]]) -> list[Take]:
        """Watch these (kind, entity, what takes from it) and no others; on the thread that waits.

        Returns those that are new: something may have arrived there before.
        """
        new = []
        keep = {id(entity) for _, entity, _ in wanted}
        for key in [key for key in self._watched if key not in keep]:
            self._forget(self._watched.pop(key))
        for kind, entity, take in wanted:
            known = self._watched.get(id(entity))
            if known is not None:
                known.take = take
                continue
            watched = _Watched(kind, entity, take, self._bell_for_one())
            with contextlib.suppress(InvalidHandle), entity.handle:  # or is it gone already?
                native.ring_for(kind, entity.handle, watched.bell)
                self._watched[id(entity)] = watched
                self._behind[watched.bell].append(watched)
                new.append(take)
        return new

    def _bell_for_one(self) -> int:
        if len(self._behind) < _MOST_BELLS:
            free = [bell for bell, behind in self._behind.items() if not behind]
            if free:
                return free[0]
            bell = self._new_bell()
            self._behind[bell] = []
            return bell
        return min(self._behind, key=lambda bell: len(self._behind[bell]))

    def _forget(self, watched: _Watched) -> None:
        self._behind[watched.bell].remove(watched)
        with contextlib.suppress(InvalidHandle), watched.entity.handle:
            native.ring_for(watched.kind, watched.entity.handle, None)

    def wait(self, timeout_ns: int) -> list[tuple[Take, int]]:
        """Wait until something has arrived, ``ring`` or a signal, or for ``timeout_ns`` (-1: for ever).

        It may end a little early, and is asked again then.

        What is returned may have something to take, and nothing else has; with it, at how many arrivals the
        bell was rung.
        """
        takes = []
        for bell, _ in self._events(timeout_ns):
            if (behind := self._behind.get(bell)) is not None:
                count = _counted(bell)
                takes += [(watched.take, count) for watched in behind]
            elif self._signals is not None and bell == self._signals.fileno():
                self._signals.recv(_SIGNALS)
        return takes

    def pause(self, timeout_s: float) -> None:
        """Wait for ``timeout_s``, or until ``ring`` or a signal, whatever arrives."""
        _counted(self._bell)  # what rang before has ended a wait
        poll = select.poll()
        poll.register(self._bell, select.POLLIN)
        if self._signals is not None:
            poll.register(self._signals, select.POLLIN)
        poll.poll(timeout_s * 1000)

    def _events(self, timeout_ns: int) -> list[tuple[int, int]]:
        if timeout_ns >= _SHORT_NS or (timeout_ns > 0 and not self._can_select):
            timeout_s = timeout_ns // _MILLISECOND_NS / 1000 or 0.001  # it knows nothing shorter
        elif timeout_ns > 0:
            select.select((self._poll,), (), (), timeout_ns / 1e9)
            timeout_s = 0
        else:
            timeout_s = timeout_ns
        return self._poll.poll(timeout_s)

    def close(self) -> None:
        """Watch nothing any more; idempotent, and nobody waits."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            for watched in self._watched.values():
                self._forget(watched)
            self._watched.clear()
            for bell in (self._bell, *self._behind):
                os.close(bell)
            self._poll.close()

    @contextlib.contextmanager
    def woken_by_signals(self) -> Any:
        """While the main thread waits, a signal ends the wait, so that Python can run its handler."""
        if self._closed or threading.current_thread() is not threading.main_thread():
            yield
            return
        reader, writer = socket.socketpair()
        reader.setblocking(False)
        writer.setblocking(False)
        before = signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
        self._poll.register(reader, select.EPOLLIN)
        self._signals = reader
        try:
            yield
        finally:
            self._signals = None
            if not self._closed:  # by what it ran
                self._poll.unregister(reader)
            signal.set_wakeup_fd(before)
            reader.close()
            writer.close()


def _counted(bell: int) -> int:
    """Arrivals since it was last asked; what rings meanwhile is counted and rings again."""
    try:
        return os.eventfd_read(bell)
    except BlockingIOError:
        return 0
