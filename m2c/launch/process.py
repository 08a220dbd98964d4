"""One child process of a running system: its output, and its end."""

from __future__ import annotations

import collections
import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from m2c.launch import child, threads
from transports.stop_signals import stopping

_SAY_WHERE = child.SAY_WHERE_AND_END
KEPT_LINES = 50
"""Last lines of a process's output, for the report of how it died: where it stood is up to 25 of them, and
nodes that share the process say something meanwhile.
"""
STOP_TIMEOUT_S = 10.0
"""A process that has not ended so long after SIGTERM is killed."""
LAST_WORDS_S = 10.0
"""How long a process that is to be killed may take to say where it stands: it ends with that, unless it is
stopped (SIGSTOP). On a busy machine even a signal takes its time.
"""
OUTPUT_TIMEOUT_S = 10.0
"""How long the last output of a process that has ended may take: it ends with the process, unless a child of
its own holds it open.
"""


class Module(msgspec.Struct, frozen=True):
    """What a process runs.

    Attributes:
        package: its Python package; run by ``python -m``.
        folders: put on the module path.
        arguments: the node's command line.
        files: open files that it inherits, under the same numbers.
        priority: its nice value; None leaves it as it is.
    """

    package: str
    folders: Sequence[Path]
    arguments: Sequence[str] = ()
    files: Sequence[int] = ()
    priority: int | None = None


class NodeProcess:
    """Some nodes (or the policy, or what watches) as a process.

    Args:
        name: of the process.
        module: what it runs.
        line: called with ``(name, text)`` for each line of output, on a thread of the process's own.
        ended: called with ``(name, exit code)`` once, on a thread of the process's own.
    """

    def __init__(
        self,
        name: str,
        module: Module,
        line: Callable[[str, str], None],
        ended: Callable[[str, int], None],
    ) -> None:
        self.name = name
        self.stuck: threads.Worker | None = None
        """Its one thread that was at work when it was killed as it did not end."""
        self.last_lines: collections.deque[str] = collections.deque(maxlen=KEPT_LINES)
        self._line = line
        self._ended = ended
        path = os.pathsep.join(
            [*map(str, module.folders), *filter(None, [os.environ.get("PYTHONPATH")])]
        )
        self._process = subprocess.Popen(
            [
                # -P: no file of the folder in which m2c was called takes a package's place
                *(sys.executable, "-P", "-u", "-m", child.__name__, str(os.getpid())),
                "" if module.priority is None else str(module.priority),
                *(module.package, *module.arguments),
            ],
            env={**os.environ, "PYTHONPATH": path},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
            pass_fds=module.files,
        )
        self._thread = threading.Thread(target=self._follow, name=f"{name}-output", daemon=True)
        self._thread.start()

    def _follow(self) -> None:
        assert self._process.stdout is not None
        for text in self._process.stdout:
            stripped = text.rstrip("\n")
            self.last_lines.append(stripped)
            self._line(self.name, stripped)
        self._ended(self.name, self._process.wait())

    @property
    def code(self) -> int | None:
        """Its exit code; None while it runs."""
        return self._process.poll()

    def terminate(self, number: signal.Signals = signal.SIGTERM) -> None:
        """Ask the process to end, by the signal ``number``."""
        self._process.send_signal(number)

    def kill(self) -> None:
        """End the process without asking."""
        self._process.kill()

    def finish(self, deadline: float, number: signal.Signals = signal.SIGTERM) -> str:
        """Wait for its end; kill it if it has not ended by ``deadline`` (of ``time.monotonic``).

        Returns:
            How it ended, in words; "" if as it was asked to (by the signal ``number`` itself, if it had just
            begun).
        """
        try:
            code = self._process.wait(max(deadline - time.monotonic(), 0.0))
            how = "" if code == -number or ended_well(code) else describe_end(code)
        except subprocess.TimeoutExpired:
            self._ask_where()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(LAST_WORDS_S)
            self._process.kill()
            self._process.wait()
            how = f"did not end in {STOP_TIMEOUT_S:g} s and was killed"
        self._thread.join(OUTPUT_TIMEOUT_S)
        return how

    def _ask_where(self) -> None:
        """Have it say where that thread stands which does not end; if that is not known, the main one."""
        at_work = threads.at_work(self._process.pid)
        if len(at_work) == 1 and threads.send(self._process.pid, at_work[0], _SAY_WHERE):
            (self.stuck,) = at_work
        else:
            self._process.send_signal(_SAY_WHERE)


def asked_by(code: int) -> str:
    """The signal that asked a process to end which ended well, by its exit code; "" if none did."""
    number = code - child.BY_SIGNAL
    return signal.Signals(number).name if number in stopping() else ""


def ended_well(code: int) -> bool:
    """Whether this is the exit code of a process without a fault."""
    return code == 0 or bool(asked_by(code))


def describe_end(code: int) -> str:
    """An exit code in words: ``exited with code 3``, ``was killed by SIGKILL``."""
    if ended_well(code):
        return "exited with code 0"
    if code < 0:
        return f"was killed by {signal.Signals(-code).name}"
    return f"exited with code {code}"
