"""Which threads of a process are at work, as another process sees it: also while Python's lock is held.

A thread that runs a node says so in its name, which the kernel keeps (prctl(2), ``/proc/PID/task/TID/comm``).
"""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec

_PR_SET_NAME, _PR_GET_NAME = 15, 16
_NAME_BYTES = 16
"""The kernel keeps as many, with the zero at the end."""
_MARK = ":"


class Worker(msgspec.Struct, frozen=True):
    """A thread that is at work, of those of one process.

    Attributes:
        thread: its number (gettid(2)).
        number: the number of what it works for.
    """

    thread: int
    number: int


@contextmanager
def working_for(number: int) -> Iterator[None]:
    """Meanwhile the calling thread is at work for what has this number in its process."""
    before = ctypes.create_string_buffer(_NAME_BYTES)
    ctypes.CDLL(None).prctl(_PR_GET_NAME, before)
    # a thread inherits the name of the one that starts it: so it has the thread's own number in it
    _call_thread(f"{number}{_MARK}{threading.get_native_id()}".encode())
    try:
        yield
    finally:
        _call_thread(before.value)


def end_work() -> None:
    """The calling thread is not at work any more: it has learnt that it is to end."""
    _call_thread(b"ending")


def _call_thread(name: bytes) -> None:
    text = ctypes.create_string_buffer(name[: _NAME_BYTES - 1])
    ctypes.CDLL(None).prctl(_PR_SET_NAME, text)


def at_work(process: int) -> list[Worker]:
    """The threads of ``process`` that are at work; [] if it has ended, or says nothing of that."""
    found = []
    for task in Path(f"/proc/{process}/task").glob("*/comm"):
        try:
            number, mark, thread = task.read_text(errors="replace").strip().partition(_MARK)
        except OSError:  # it has ended
            continue
        if mark and number.isdecimal() and thread == task.parent.name:
            found.append(Worker(int(task.parent.name), int(number)))
    return found


def send(process: int, worker: Worker, number: int) -> bool:
    """Send the signal ``number`` to one thread (tgkill(2)); whether that can be done (glibc 2.30)."""
    tgkill = getattr(ctypes.CDLL(None), "tgkill", None)
    return tgkill is not None and tgkill(process, worker.thread, number) == 0
