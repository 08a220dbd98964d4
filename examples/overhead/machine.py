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

import msgspec


class Machine(msgspec.Struct, frozen=True):
    """Where it was measured.

    Attributes:
        load: the average number of processes that wanted to run, of the minute before it began: more
            than a few tenths means that others were at work.
        is_awake: whether its processors were held awake.
    """

    processor: str
    cores: int
    memory_gb: float
    kernel: str
    python: str
    zenoh: str
    ros2: str
    load: float
    is_awake: bool = False


def this_machine(is_awake: bool) -> Machine:
    """The machine that this runs on; whether its processors are held awake."""
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return Machine(
        models[0] if models else platform.machine(),
        len(os.sched_getaffinity(0)),
        round(memory / 2**30, 1),
        f"{platform.system()} {platform.release()}",
        platform.python_version(),
        _version("eclipse-zenoh"),
        _version("ros-jazzy-rclpy"),
        os.getloadavg()[0],
        is_awake,
    )


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return ""


def described(machine: Machine) -> str:
    """In a sentence."""
    ros = f", rclpy {machine.ros2} with Fast DDS" if machine.ros2 else ""
    idle = "held awake" if machine.is_awake else "that sleep when idle"
    return (
        f"{machine.processor}, {machine.cores} cores {idle}, {machine.memory_gb:.0f} GB, {machine.kernel}, "
        f"Python {machine.python}, Zenoh {machine.zenoh}{ros}; load average before it began "
        f"{machine.load:.2f}"
    )


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
