"""The machine and the software that something was measured on."""

from __future__ import annotations

import importlib.metadata
import os
import platform
from pathlib import Path

import msgspec


class Machine(msgspec.Struct, frozen=True):
    """Where it was measured.

    Attributes:
        load: the average number of processes that wanted to run, of the minute before it began: more
            than a few tenths means that others were at work.
        is_awake: whether its processors were held awake; see ``examples.overhead.awake``.
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
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return Machine(
        _processor(),
        len(os.sched_getaffinity(0)),
        round(memory / 2**30, 1),
        f"{platform.system()} {platform.release()}",
        platform.python_version(),
        _version("eclipse-zenoh"),
        _version("ros-jazzy-rclpy"),
        os.getloadavg()[0],
        is_awake,
    )


def _processor() -> str:
    for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.machine()


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
