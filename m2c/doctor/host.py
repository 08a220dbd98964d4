"""What of this host matters to nodes on every transport: Python, packages, open files, the clock."""

from __future__ import annotations

import ctypes
import importlib.metadata
import re
import sys
import time
from collections.abc import Iterator

from m2c.installed import DISTRIBUTION, is_compiled
from transports.diagnosis import Finding, State
from transports.interface import TransportError
from transports.open_files import FOR_A_CONNECTION, allow_open_files

LEAST_PYTHON = (3, 11)
TRIED_PYTHONS = ((3, 11), (3, 12))
"""Those that the tests run on, and that the wheels of ROS 2 are for."""
_UNSYNCHRONISED = 5
"""``TIME_ERROR`` of adjtimex(2)."""
_TIMEX_BYTES = 512
"""More than a ``struct timex`` has anywhere; all zero asks and sets nothing."""
_BEFORE_THIS = 1_700_000_000
"""A clock before November 2023 was never set (s since the epoch)."""


def host() -> Iterator[Finding]:
    """What is found of this host."""
    yield python()
    yield packages()
    yield from open_files()
    yield clock()


def python(version: tuple[int, int] = sys.version_info[:2]) -> Finding:
    """Whether this Python is one that is supported."""
    shown = f"Python {'.'.join(map(str, version))} ({sys.executable})"
    tried = " and ".join(".".join(map(str, known)) for known in TRIED_PYTHONS)
    if version < LEAST_PYTHON:
        return Finding(State.WRONG, "python", f"{shown} is too old", "python3.11 -m venv .venv")
    if version not in TRIED_PYTHONS:
        text = f"{shown}: the tests run on {tried}, and so do the wheels of ROS 2"
        return Finding(State.NOTE, "python", text, "python3.12 -m venv .venv, for ROS 2 by pip")
    return Finding(State.WORKS, "python", shown)


def packages() -> Finding:
    """Whether all is installed that m2c and moon import."""
    try:
        own = importlib.metadata.version(DISTRIBUTION)
    except importlib.metadata.PackageNotFoundError:
        return Finding(State.WRONG, "packages", f"{DISTRIBUTION} is not installed", "pip install .")
    missing = []
    for requirement in importlib.metadata.requires(DISTRIBUTION) or ():
        text, _, when = requirement.partition(";")
        if "extra ==" in when or ("python_version" in when and sys.version_info >= (3, 14)):
            continue
        try:
            importlib.metadata.version(re.split(r"[<>=!~\[ ]", text)[0])
        except importlib.metadata.PackageNotFoundError:
            missing.append(text.strip())
    if missing:
        mend = "pip install " + " ".join(f"'{text}'" for text in missing)
        return Finding(State.WRONG, "packages", f"not installed: {', '.join(missing)}", mend)
    monitors = "monitors compiled" if is_compiled() else "monitors as Python, half as fast"
    return Finding(State.WORKS, "packages", f"{DISTRIBUTION} {own}, {monitors}")


def open_files() -> Iterator[Finding]:
    """That this process may not open as many files as a connection needs."""
    try:
        allow_open_files(FOR_A_CONNECTION)
    except TransportError as error:
        mend = f"ulimit -n {FOR_A_CONNECTION}"
        yield Finding(State.WRONG, "files", str(error), mend)


def clock() -> Finding:
    """Whether the clock is set and kept by some server; stamps of several hosts are compared."""
    if time.time() < _BEFORE_THIS:
        text = f"it shows {time.strftime('%Y-%m-%d')}: no certificate is valid yet"
        return Finding(State.WRONG, "clock", text, "timedatectl set-ntp true")
    try:
        state = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(_TIMEX_BYTES))
    except (OSError, AttributeError):
        return Finding(
            State.NOTE, "clock", "whether it is synchronised is not known on this system"
        )
    if state == _UNSYNCHRONISED:
        text = "it is not synchronised: on several hosts stamps will differ"
        return Finding(
            State.NOTE, "clock", text, "timedatectl set-ntp true, or --clock-skew SECONDS"
        )
    return Finding(State.WORKS, "clock", "it is synchronised")
