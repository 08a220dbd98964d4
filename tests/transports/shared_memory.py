"""What Fast DDS leaves in shared memory.

A participant has a *segment*, in which the messages stand that it sends, and *mailboxes* (``…_port7400``),
in which others put where such a message stands. A process that is killed leaves all of it. But also of
processes that end well, Fast DDS leaves a mailbox whose reader has not had its turn for a second, on a
busy machine: it takes that one for broken, and nobody for its owner (``SharedMemGlobal::Port``).
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
import time
from pathlib import Path

SHARED = Path("/dev/shm")
_MAILBOX = re.compile(r"(?:sem\.)?fastrtps_port(\d+)")
_FIRST_PORT, _PORTS = 7400, 250
"""Ports of domain 0, and how many each domain has (DDSI-RTPS 2.5, 9.6.2.3)."""
SHARED_PORTS = range(7000, _FIRST_PORT)
"""Mailboxes in which participants of all domains, numbered as they come, hear how nodes are called. Who loses
his, or the lock that says that it is his, never hears it; and Fast DDS's own care for them fails now and
then as participants come and go (decision 20)."""


OWN = "TESTS_HAVE_THEIR_OWN_SHARED_MEMORY"
"""Set in the environment of processes that have it from the one that started them."""
_CLONE_NEWNS = 0x20000
_MS_REC, _MS_PRIVATE = 0x4000, 0x40000


def separate() -> bool:
    """Give this process, and those it starts from now on, a ``/dev/shm`` of their own; whether that worked.

    What others leave in it (somebody else's system, killed at this moment) is not taken for ours then, and the
    mailboxes that participants of all domains share are shared among us only. Needs CAP_SYS_ADMIN: see
    unshare(2), mount(2), mount_namespaces(7). Whoever was started by a process that has it keeps that one.
    """
    if OWN in os.environ:
        return True
    libc = ctypes.CDLL(None)
    mount = libc.mount
    mount.argtypes = [
        ctypes.c_char_p,
        ctypes.c_char_p,
        ctypes.c_char_p,
        ctypes.c_ulong,
        ctypes.c_char_p,
    ]
    if (
        libc.unshare(_CLONE_NEWNS)
        or mount(b"none", b"/", None, _MS_REC | _MS_PRIVATE, None)
        or mount(b"tmpfs", bytes(SHARED), b"tmpfs", 0, b"mode=1777")
    ):
        return False
    os.environ[OWN] = "yes"
    return True


def ports_of(domain: int) -> range:
    """The mailboxes of a ROS domain."""
    first = _FIRST_PORT + _PORTS * domain
    return range(first, first + _PORTS)


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


def remove_mailboxes(ports: range, before: set[str]) -> None:
    """Remove mailboxes that were not there ``before`` and nobody uses, nor is about to: those of a domain whose
    processes have ended, those of all domains when all tests have.
    """
    for name in unused() - before:
        match = _MAILBOX.match(name)
        if match is not None and int(match[1]) in ports:
            (SHARED / name).unlink(missing_ok=True)
