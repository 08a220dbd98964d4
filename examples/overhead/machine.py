"""The machine and the software that something was measured on, and how its processors are held awake.

A tick goes from process to process, some 28 times, and each time the next one's processor may have to be
woken. How long that takes is not the system's nor the monitor's: a virtual machine's processor is handed back
to its host, which decides by itself how soon, so that a tick's length comes and goes by a half for minutes.
``cyclictest`` of the rt-tests holds processors awake for the same reason and in the same way.
"""

from __future__ import annotations

import contextlib
import importlib.metadata
import os
import platform
import struct
from collections.abc import Iterator
from pathlib import Path


def described(is_awake: bool) -> str:
    """The machine that this runs on, in words; ``is_awake``: whether its processors are held awake."""
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    ros2 = _version("ros-jazzy-rclpy")
    said = (
        models[0] if models else platform.machine(),
        f"{len(os.sched_getaffinity(0))} cores {'held awake' if is_awake else 'that sleep when idle'}",
        f"{memory / 2**30:.0f} GB",
        f"{platform.system()} {platform.release()}",
        f"Python {platform.python_version()}",
        f"Zenoh {_version('eclipse-zenoh')}",
        f"rclpy {ros2} with Fast DDS" if ros2 else "",
    )
    return ", ".join(filter(None, said))


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return ""


LATENCY = Path("/dev/cpu_dma_latency")
"""Whoever has it open bounds how long a processor may take to wake up (µs, a signed 32-bit number): Linux,
Documentation/power/pm_qos_interface.rst. Root may, as a rule."""


@contextlib.contextmanager
def held_awake(wanted: bool = True, device: Path = LATENCY) -> Iterator[bool]:
    """No processor sleeps deeper than a loop until the end of the block.

    Args:
        wanted: False leaves them as they are.
        device: where that is asked for.

    Yields:
        Whether it is so: not where the system does not permit it, or does not have it.
    """
    with contextlib.ExitStack() as stack:
        is_awake = False
        if wanted:
            with contextlib.suppress(OSError):
                file = stack.enter_context(device.open("r+b", buffering=0))
                file.write(struct.pack("i", 0))
                is_awake = True
        yield is_awake
