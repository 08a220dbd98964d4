"""Child processes that are told what to do by lines of JSON, and answer by lines of JSON."""

from __future__ import annotations

import collections
import contextlib
import ctypes
import os
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import IO, Any, Self

import msgspec

from examples.overhead import accounts

ROOT = Path(__file__).parents[2]
READY_S = 60.0
"""A machine under load starts a dozen interpreters in it."""
STOP_S = 10.0
KEPT_LINES = 20

_PR_SET_PDEATHSIG = 1
_libc = ctypes.CDLL(None)


class ChildError(Exception):
    """A child process died or does not answer; the text has its last lines."""


def _die_with_parent() -> None:
    """Have the kernel end this child when its parent dies, however it dies (prctl(2))."""
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


class Child:
    """A process of the comparison.

    Args:
        name: what it is called in errors.
        arguments: of the Python interpreter, e.g. ``["-m", "moon.cli", "tap"]``.
        environment: variables beside this process's own.
        prefix: a command in front of the interpreter, e.g. one that enters a network namespace.
    """

    def __init__(
        self,
        name: str,
        arguments: Sequence[str],
        environment: Mapping[str, str] | None = None,
        prefix: Sequence[str] = (),
    ) -> None:
        self.name = name
        inherited = {**os.environ, **(environment or {})}
        path = [str(ROOT), inherited.get("PYTHONPATH", "")]
        inherited["PYTHONPATH"] = os.pathsep.join(filter(None, path))
        self._lines: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._last: collections.deque[str] = collections.deque(maxlen=KEPT_LINES)
        self._process = subprocess.Popen(
            [*prefix, sys.executable, "-u", *arguments],
            env=inherited,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            start_new_session=True,  # Ctrl-C is for the comparison, which ends its children itself
            preexec_fn=_die_with_parent,  # noqa: PLW1509 - one prctl, no lock is taken
        )
        assert self._process.stdout is not None
        assert self._process.stderr is not None
        self._open = 2
        self._threads = [
            threading.Thread(target=self._follow, args=(stream,), daemon=True)
            for stream in (self._process.stdout, self._process.stderr)
        ]
        for thread in self._threads:
            thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def pid(self) -> int:
        """Of the process, for the accounts of the operating system."""
        return self._process.pid

    @property
    def last_lines(self) -> str:
        """What it said last."""
        return "\n".join(self._last)

    def processor_s(self) -> float:
        """Processor time that it has used."""
        return accounts.processor_s(self.pid)

    def _follow(self, stream: IO[str]) -> None:
        for line in stream:
            text = line.rstrip("\n")
            self._last.append(text)
            self._lines.put(text)
        self._lines.put(None)

    def wait_for(self, what: Callable[[str], bool], timeout_s: float = READY_S) -> str:
        """The first line for which ``what`` holds.

        Raises:
            ChildError: it ended, or said no such thing in time.
        """
        ended = 0
        while ended < self._open:
            try:
                line = self._lines.get(timeout=timeout_s)
            except queue.Empty:
                raise ChildError(
                    f"{self.name} does not answer within {timeout_s:g} s:\n{self.last_lines}"
                ) from None
            if line is None:
                ended += 1
            elif what(line):
                return line
        raise ChildError(f"{self.name} ended by itself:\n{self.last_lines}")

    def answer(self, timeout_s: float = READY_S) -> dict[str, Any]:
        """The next JSON object that it says."""
        line = self.wait_for(lambda text: text.startswith("{"), timeout_s)
        found: dict[str, Any] = msgspec.json.decode(line)
        return found

    def tell(self, line: str) -> None:
        """Write a line to its standard input.

        Raises:
            ChildError: it has ended.
        """
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(line + "\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            raise ChildError(f"{self.name} ended by itself:\n{self.last_lines}") from None

    def ask(self, question: Mapping[str, Any], timeout_s: float = READY_S) -> dict[str, Any]:
        """Send ``question``; its answer."""
        self.tell(msgspec.json.encode(question).decode())
        return self.answer(timeout_s)

    def stop(self) -> list[dict[str, Any]]:
        """Ask it to end (SIGTERM), kill it if it does not; the JSON objects that it said meanwhile."""
        self._process.terminate()
        try:
            self._process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        for thread in self._threads:
            thread.join(STOP_S)
        with contextlib.suppress(BrokenPipeError):
            assert self._process.stdin is not None
            self._process.stdin.close()
        said = []
        while not self._lines.empty():
            line = self._lines.get()
            if line is not None and line.startswith("{"):
                said.append(msgspec.json.decode(line))
        return said
