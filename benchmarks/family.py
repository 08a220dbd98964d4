"""What the processes below one process use: processor time, memory, and links to each other."""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Sequence
from pathlib import Path

from benchmarks.processes import processor_s

_ESTABLISHED = "01"
"""The state of a connection in ``/proc/net/tcp`` (``TCP_ESTABLISHED`` of the kernel's tcp_states.h)."""
_SOCKET = re.compile(r"socket:\[(\d+)\]")


def family(pid: int) -> list[int]:
    """``pid``, and all processes that it and its children have started."""
    found = [pid]
    for parent in found:  # which grows meanwhile
        for task in Path(f"/proc/{parent}/task").glob("*/children"):
            with contextlib.suppress(OSError):  # a thread that has ended
                found += map(int, task.read_text().split())
    return found


def used_s(pids: Sequence[int]) -> float:
    """Processor time of all of them, in seconds."""
    return sum(processor_s(pid) for pid in pids)


def memory_mib(pids: Sequence[int]) -> float:
    """Memory of all of them, in MiB; what several share is counted once (proportional set size)."""
    kib = 0
    for pid in pids:
        rollup = Path(f"/proc/{pid}/smaps_rollup").read_text()
        kib += sum(int(line.split()[1]) for line in rollup.splitlines() if line.startswith("Pss:"))
    return kib / 1024


def links(pids: Sequence[int]) -> int:
    """TCP connections over IPv4 among them; each has an end at two of their sockets."""
    own = {inode for pid in pids for inode in _sockets(pid)}
    connections = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    return sum(words[3] == _ESTABLISHED and words[9] in own for words in connections) // 2


def _sockets(pid: int) -> list[str]:
    found = []
    for file in Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(OSError):  # a file that was closed meanwhile
            if match := _SOCKET.fullmatch(os.readlink(file)):
                found.append(match[1])
    return found
