"""What Fast DDS leaves in shared memory.

A participant has a *segment*, in which the messages stand that it sends, and *mailboxes* (``…_port7400``),
in which others put where such a message stands. A process that is killed leaves all of it. But also of
processes that end well, Fast DDS leaves a mailbox whose reader has not had its turn for a second, on a
busy machine: it takes that one for broken, and nobody for its owner (``SharedMemGlobal::Port``).
"""

from __future__ import annotations

import atexit
import contextlib
import re
import time
from pathlib import Path

SHARED = Path("/dev/shm")
_MAILBOX = re.compile(r"(?:sem\.)?fastrtps_port(\d+)")
_FIRST_PORT, _PORTS = 7400, 250
"""Ports of domain 0, and how many each domain has (DDSI-RTPS 2.5, 9.6.2.3)."""
_SHARED_PORTS = range(7000, _FIRST_PORT)
"""Mailboxes that participants of all domains number as they come."""
SETTLED_S = 5.0
"""A process that makes such a file has mapped it after so long, and found those of others broken."""

_later: set[str] = set()
"""Mailboxes of ended tests whose files may still be in the making, for somebody else of that number."""


def unused() -> set[str]:
    """Files of Fast DDS that no process has mapped or open."""
    files = {path.name for path in SHARED.glob("*fastrtps*")}
    for process in Path("/proc").glob("[0-9]*"):
        text = _in_use(process)
        files = {name for name in files if f"{SHARED}/{name}" not in text}
    return {name for name in files if (SHARED / name).exists()}


def _in_use(process: Path) -> str:
    """The files that a process has mapped or open; it may open and close others meanwhile, or end."""
    found = []
    with contextlib.suppress(OSError):  # who opens a file maps it before it is closed
        for item in (process / "fd").iterdir():
            with contextlib.suppress(OSError):
                found.append(str(item.readlink()))
    with contextlib.suppress(OSError):
        found.append((process / "maps").read_text())
    return "\n".join(found)


def segments() -> set[str]:
    """Those of :func:`unused` in which messages stood: somebody was killed."""
    return {name for name in unused() if not _MAILBOX.match(name)}


def left_over(before: set[str], patience_s: float = 5.0) -> set[str]:
    """Segments that were not there ``before`` and stay.

    A process that ends lets go of its segment first and then removes it; there is nothing to wait for but
    that it is gone.
    """
    deadline = time.monotonic() + patience_s
    while (left := segments() - before) and time.monotonic() < deadline:
        time.sleep(0.05)
    return left


def remove_mailboxes(domain: int, before: set[str]) -> None:
    """Remove the mailboxes of a ROS domain, whose processes have ended, that were not there ``before``.

    Those that may as well be of another domain go later, as somebody may be about to use them: who loses his
    mailbox, or the lock that says that it is his, gets another to share it with, and never hears of that one.
    """
    first = _FIRST_PORT + _PORTS * domain
    for name in unused() - before:
        match = _MAILBOX.match(name)
        if match is None:
            continue
        port = int(match[1])
        if first <= port < first + _PORTS:
            (SHARED / name).unlink(missing_ok=True)
        elif port in _SHARED_PORTS:
            if not _later:
                atexit.register(_remove_the_last)
            _later.add(name)
    _remove_settled()


def _remove_settled() -> bool:
    """Remove those that are old enough; whether there are others that nobody uses."""
    are_young = False
    for name in _later & unused():
        with contextlib.suppress(FileNotFoundError):
            if time.time() - (SHARED / name).stat().st_ctime > SETTLED_S:
                (SHARED / name).unlink()
            else:
                are_young = True
    _later.intersection_update(path.name for path in SHARED.glob("*fastrtps*"))
    return are_young


def _remove_the_last() -> None:
    """Those of the tests that ended last have to get old enough."""
    deadline = time.monotonic() + 2 * SETTLED_S
    while _remove_settled() and time.monotonic() < deadline:
        time.sleep(0.1)
