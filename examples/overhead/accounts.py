"""What the operating system has on record of a process: processor time, and bytes that it sent."""

from __future__ import annotations

import ctypes
import os
import time
from pathlib import Path

_libc = ctypes.CDLL(None, use_errno=True)


def processor_s(pid: int) -> float:
    """Processor time of all threads of ``pid`` since it began, in seconds, to the nanosecond.

    From the process's own clock (clock_getcpuclockid(3)), not from ticks of 10 ms as in
    ``/proc/<pid>/stat``.

    Raises:
        OSError: there is no such process.
    """
    clock = ctypes.c_int()
    error = _libc.clock_getcpuclockid(pid, ctypes.byref(clock))
    if error:
        raise OSError(error, f"{os.strerror(error)}: process {pid}")
    return time.clock_gettime(clock.value)


def machine_s() -> tuple[float, float]:
    """Processor time of the whole machine since it was started, in seconds: busy, and in all."""
    words = Path("/proc/stat").read_text().splitlines()[0].split()[1:9]
    values = [int(word) / os.sysconf("SC_CLK_TCK") for word in words]
    idle = values[3] + values[4]  # idle, and waiting for a disk
    return sum(values) - idle, sum(values)


def bytes_sent(pid: int, interface: str) -> tuple[int, int]:
    """Bytes and packets that went out of ``interface`` in the network namespace of ``pid``.

    Everything on the wire counts: Ethernet, IP, TCP or UDP headers, acknowledgements, discovery.

    Raises:
        KeyError: there is no such interface.
    """
    for line in Path(f"/proc/{pid}/net/dev").read_text().splitlines()[2:]:
        name, _, counters = line.partition(":")
        if name.strip() == interface:
            fields = counters.split()
            return int(fields[8]), int(fields[9])
    raise KeyError(interface)
