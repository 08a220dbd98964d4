"""How many files a process may have open: middleware that finds out too late ends it, or hangs."""

from __future__ import annotations

import resource

from transports.interface import TransportError

FOR_A_CONNECTION = 64
"""Sockets, events and timers of a middleware's threads, and what Python has open: some 40 on Zenoh."""


def allow_open_files(count: int) -> None:
    """Have this process, and those that it starts, open ``count`` files, if it may.

    Raises:
        TransportError: it may not.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft >= count or soft == resource.RLIM_INFINITY:
        return
    if hard < count and hard != resource.RLIM_INFINITY:
        raise TransportError(
            f"only {hard} files may be open at once, and up to {count} are needed (`ulimit -n {count}`)"
        )
    resource.setrlimit(resource.RLIMIT_NOFILE, (count, hard))
