"""What works of a transport on this host, what is missing, and what mends it.

A transport describes it by a function (``Description.diagnosis``), which runs in a process of its own:
middleware that is broken may end its process, or never return.
"""

from __future__ import annotations

import importlib
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from enum import StrEnum

import msgspec

from transports.descriptions import described
from transports.interface import TransportError
from transports.registry import loaded

TIMEOUT_S = 60.0
"""How long a diagnosis may take: it waits at most three times for five seconds."""
_LAST = 300
"""Characters of the last line of a process that are shown."""


class State(StrEnum):
    """What is found of one thing."""

    WORKS = "works"
    NOTE = "note"
    MISSING = "missing"
    """It is not there; what works does not need it."""
    WRONG = "wrong"


class Finding(msgspec.Struct, frozen=True):
    """One thing that was looked at.

    Attributes:
        state: whether it works.
        subject: what was looked at, in a word or two.
        text: what was found.
        mend: the command that mends it, or what to do; "" where nothing has to be done.
    """

    state: State
    subject: str
    text: str
    mend: str = ""


Diagnosis = Callable[[Mapping[str, str]], Iterator[Finding]]
"""Looks at a transport, with options of :mod:`transports.options`."""


def diagnose(
    transport: str, options: Mapping[str, str], timeout_s: float = TIMEOUT_S
) -> list[Finding]:
    """What is found of ``transport``; never raises, whatever state the transport is in.

    Args:
        transport: one that is installed.
        options: where its nodes meet (``endpoint``), the folder of certificates (``secure``).
        timeout_s: how long it may take.
    """
    words = [transport, msgspec.json.encode(options).decode()]
    command = [sys.executable, "-P", "-m", __name__, *words]  # -P: nothing of this folder is loaded
    try:
        done = subprocess.run(
            command, capture_output=True, stdin=subprocess.DEVNULL, timeout=timeout_s, check=False
        )
        written, said, code = done.stdout, done.stderr, done.returncode
        end = f"ended by {signal.Signals(-code).name}" if code < 0 else f"ended with code {code}"
    except subprocess.TimeoutExpired as error:
        written, said, code = error.stdout or b"", error.stderr or b"", 1
        end = f"did not end within {timeout_s:g} s"
    lines = [line for line in written.splitlines() if line.startswith(b"{")]
    found = [msgspec.json.decode(line, type=Finding) for line in lines]
    if code:
        last = (said.decode(errors="replace").splitlines() or [""])[-1].strip()[:_LAST]
        about = f"after `{found[-1].subject}`, the check {end}" if found else f"the check {end}"
        found.append(Finding(State.WRONG, transport, f"{about}: {last}" if last else about))
    return found


def _findings(transport: str, options: Mapping[str, str]) -> Iterator[Finding]:
    place = described(transport).diagnosis
    if place:
        module, _, name = place.partition(":")
        yield from getattr(importlib.import_module(module), name)(options)
        return
    try:
        loaded(transport)
    except TransportError as error:
        yield Finding(State.WRONG, transport, str(error))
    else:
        yield Finding(State.WORKS, transport, "it can be loaded")


def main() -> None:
    """Write a line of JSON for each finding."""
    transport, options = sys.argv[1:]
    for finding in _findings(transport, msgspec.json.decode(options, type=dict[str, str])):
        sys.stdout.buffer.write(msgspec.json.encode(finding) + b"\n")
        sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()
