"""Ends a process that a middleware does not let go of, also while Python's lock is held.

A middleware can wait for ever in the call that is to end it, with the interpreter's lock in hand: nothing
written in Python runs then. The C library's timers go on (timer_create(2)): each calls a function of that
library on a thread of its own. Any thread may set as many as it likes; of SIGALRM's timer, and of
``faulthandler``'s, a process has one, which pytest or who uses this package may need.
"""

from __future__ import annotations

import ctypes
import functools
import os
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

EXIT_CODE = os.EX_SOFTWARE
"""Of a process that was ended: neither ``moon``'s for a violation nor ``m2c``'s for a wrong input."""
_SAID_S = 0.1
"""Between the line that says why and the end."""
_SIGEV_THREAD = 2


class _Event(ctypes.Structure):
    """``struct sigevent`` of 64 bits (sigevent(3type)): call ``function(value)``."""

    _fields_ = (
        ("value", ctypes.c_void_p),
        ("signal", ctypes.c_int),
        ("notify", ctypes.c_int),
        ("function", ctypes.c_void_p),
        ("attributes", ctypes.c_void_p),
        ("unused", ctypes.c_byte * 32),
    )


class _Times(ctypes.Structure):
    """``struct itimerspec``."""

    _fields_ = tuple(
        (name, ctypes.c_long) for name in ("every_s", "every_ns", "after_s", "after_ns")
    )


@functools.cache
def _library() -> Any:
    """The C library; before glibc 2.34 its timers were in a library beside it."""
    library = ctypes.CDLL(None)
    return library if hasattr(library, "timer_create") else ctypes.CDLL("librt.so.1")


@functools.cache
def _text(line: str) -> Any:
    """``line`` as a format of printf(3), at an address that stays: a thread may be reading it."""
    return ctypes.create_string_buffer(line.replace("%", "%%").encode())


@contextmanager
def _called_after(delay_s: float, function: str, value: int) -> Iterator[None]:
    """The C library calls its ``function(value)`` in ``delay_s`` seconds, unless the block ends before."""
    library, timer = _library(), ctypes.c_void_p()
    address = ctypes.cast(getattr(library, function), ctypes.c_void_p)
    event = _Event(value=value, notify=_SIGEV_THREAD, function=address)
    if library.timer_create(time.CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer)):
        yield  # no timer is left (RLIMIT_SIGPENDING): what is to be done is done all the same
        return
    try:
        seconds = int(delay_s)
        times = _Times(after_s=seconds, after_ns=int((delay_s - seconds) * 1e9))
        library.timer_settime(timer, 0, ctypes.byref(times), None)
        yield
    finally:
        library.timer_delete(timer)


@contextmanager
def ended_after(limit_s: float, what: str) -> Iterator[None]:
    """If the block takes longer than ``limit_s`` seconds, its process says so on stderr and ends.

    It ends by ``_exit`` with ``EXIT_CODE``: nothing is written or released any more. From any thread.

    Args:
        limit_s: more than 0.
        what: is done in the block, as the subject of the line.
    """
    line = f"{what} takes longer than {limit_s:g} s; the process is ended"
    with ExitStack() as timers:
        timers.enter_context(_called_after(limit_s, "warnx", ctypes.addressof(_text(line))))
        timers.enter_context(_called_after(limit_s + _SAID_S, "_exit", EXIT_CODE))
        yield
