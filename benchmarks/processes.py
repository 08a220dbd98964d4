"""Processes that are measured: told what to do by lines of JSON, which they answer by lines of JSON.

Above are the ends of who measures, below those of who is measured.
"""

from __future__ import annotations

import collections
import contextlib
import ctypes
import os
import queue
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import IO, Any, Self

import msgspec

from transports.interface import Connection
from transports.work_queue import WorkQueue

ROOT = Path(__file__).parents[1]
BIN = Path(sys.executable).parent
READY_S = 60.0
"""A machine under load starts a dozen interpreters in it."""
STOP_S = 10.0
KEPT_LINES = 20

_PR_SET_PDEATHSIG = 1
_libc = ctypes.CDLL(None, use_errno=True)


class ChildError(Exception):
    """A child process died or does not answer; the text has its last lines."""


def _die_with_parent() -> None:
    """Have the kernel end this child when its parent dies, however it dies (prctl(2))."""
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


class Child:
    """A process of a measurement.

    Args:
        name: what it is called in errors.
        arguments: of the Python interpreter, e.g. ``["-m", "moon.cli", "tap"]``.
        environment: variables beside this process's own.
    """

    def __init__(
        self,
        name: str,
        arguments: Sequence[str],
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self.name = name
        inherited = {**os.environ, **(environment or {})}
        path = [str(ROOT), inherited.get("PYTHONPATH", "")]
        inherited["PYTHONPATH"] = os.pathsep.join(filter(None, path))
        self._lines: WorkQueue[str | None] = WorkQueue()
        self._last: collections.deque[str] = collections.deque(maxlen=KEPT_LINES)
        self._process = subprocess.Popen(
            [sys.executable, "-u", *arguments],
            env=inherited,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            start_new_session=True,  # Ctrl-C is for who measures, who ends its children itself
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

    @classmethod
    def calling(
        cls,
        name: str,
        function: Callable[..., object],
        *arguments: object,
        environment: Mapping[str, str] | None = None,
    ) -> Self:
        """A process that calls ``function``, which a module has, with arguments that JSON can carry."""
        module = function.__module__
        if module == "__main__":
            module = sys.modules[module].__spec__.name  # type: ignore[union-attr]
        word = msgspec.json.encode(arguments).decode()
        code = f"import json, sys; from {module} import {function.__name__} as call"
        code += "; sys.exit(call(*json.loads(sys.argv[1])))"
        return cls(name, ["-c", code, word], environment)

    @property
    def pid(self) -> int:
        """Of the process, for the accounts of the operating system."""
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """Of the process; None while it runs."""
        return self._process.poll()

    @property
    def last_lines(self) -> str:
        """What it said last."""
        return "\n".join(self._last)

    def processor_s(self) -> float:
        """Processor time that it has used."""
        return processor_s(self.pid)

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


def say(what: Any) -> None:
    """Tell who measures."""
    print(msgspec.json.encode(what).decode(), flush=True)


def ready() -> None:
    """Tell who measures that one can begin; from now on SIGTERM is an ordinary end."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    say({"ready": True})


def until_ended() -> None:
    """Be there, and ready, until SIGTERM."""
    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    say({"ready": True})
    ended.wait()


def spin_until_ended(transport: Connection, hear: Callable[[], None] = lambda: None) -> None:
    """Spin until SIGTERM, then close; ``hear`` is called by the transport at each line of standard input."""
    signal.signal(signal.SIGTERM, lambda *_: transport.post(transport.close))

    def read() -> None:
        for _ in sys.stdin:
            transport.post(hear)

    threading.Thread(target=read, daemon=True).start()
    transport.spin()
    transport.close()


def free_endpoint() -> str:
    """A loopback endpoint that nobody uses at the moment."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{free.getsockname()[1]}"


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
