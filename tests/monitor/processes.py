"""``m2c run`` and ``moon monitor`` as processes, for tests that end all they start."""

from __future__ import annotations

import contextlib
import json
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

BIN = Path(sys.executable).parent
WAIT_S = 60.0
"""How long a test waits for what must happen; only a failing test waits that long."""


def free_endpoint() -> str:
    """A loopback endpoint that nobody uses at the moment."""
    with contextlib.closing(socket.socket()) as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@contextlib.contextmanager
def router(folder: Path) -> Iterator[tuple[str, Path]]:
    """A Zenoh router: ``(endpoint, configuration file of a peer that connects to it)``.

    It is there before the system, so that a monitor can be, too.
    """
    import zenoh

    endpoint = free_endpoint()
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", f'["{endpoint}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    peer = folder / "peer.json5"
    peer.write_text(json.dumps({"mode": "peer", "connect": {"endpoints": [endpoint]}}))
    session = zenoh.open(config)
    try:
        yield endpoint, peer
    finally:
        session.close()


class Process:
    """A process whose lines are collected while it runs; ``env`` as of ``subprocess.Popen``.

    ``inside`` is what it is run by (``tests.transports.hosts``).
    """

    def __init__(
        self,
        *command: object,
        env: Mapping[str, str] | None = None,
        inside: Sequence[str] = (),
    ) -> None:
        self.out: list[str] = []
        self.err: list[str] = []
        self._changed = threading.Condition()
        self.process = subprocess.Popen(
            [*inside, str(BIN / str(command[0])), *map(str, command[1:])],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=env,
        )
        streams = ((self.process.stdout, self.out), (self.process.stderr, self.err))
        self._readers = [threading.Thread(target=self._read, args=pair) for pair in streams]
        for reader in self._readers:
            reader.start()

    def _read(self, stream: Any, lines: list[str]) -> None:
        for line in stream:
            with self._changed:
                lines.append(line.rstrip("\n"))
                self._changed.notify_all()
        with self._changed:
            self._changed.notify_all()

    def until(self, holds: Callable[[], object], limit_s: float = WAIT_S) -> None:
        """Wait until ``holds()`` of the lines so far."""
        with self._changed:
            assert self._changed.wait_for(
                lambda: bool(holds()) or self.process.poll() is not None, limit_s
            ), self.said
            assert holds(), self.said

    def send(self, number: signal.Signals) -> None:
        """Send a signal."""
        self.process.send_signal(number)

    def end(self, number: signal.Signals | None = None) -> int:
        """Its exit code, after ``number`` was sent (None: it ends by itself)."""
        if number is not None and self.process.poll() is None:
            self.send(number)
        try:
            code = self.process.wait(WAIT_S)
        except subprocess.TimeoutExpired as error:
            raise AssertionError(f"it does not end; it said:\n{self.said}") from error
        for reader in self._readers:
            reader.join(WAIT_S)
        return code

    def close(self) -> None:
        """End it, if it still runs."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGCONT)
            self.process.terminate()
            try:
                self.process.wait(10)
            except subprocess.TimeoutExpired:
                self.process.kill()
        self.end()

    @property
    def said(self) -> str:
        """All lines."""
        return "\n".join([*self.out, *self.err])


class Monitor(Process):
    """``moon monitor --json``."""

    def __init__(
        self,
        *arguments: object,
        env: Mapping[str, str] | None = None,
        inside: Sequence[str] = (),
    ) -> None:
        super().__init__("moon", "monitor", "--json", *arguments, env=env, inside=inside)

    def until_listening(self) -> None:
        """Wait until it has said whom it is linked to, or to nobody yet."""
        self.until(lambda: any("linked to" in line for line in self.err))

    @property
    def verdicts(self) -> list[dict[str, Any]]:
        """The verdicts so far."""
        return [found for found in map(json.loads, self.out) if found["event"] == "verdict"]

    def of(self, machine: str) -> list[str]:
        """The outcomes of one machine so far."""
        return [found["outcome"] for found in self.verdicts if found["machine"] == machine]

    @property
    def violated(self) -> set[str]:
        """The machines that were violated so far."""
        return {found["machine"] for found in self.verdicts if found["outcome"] == "violated"}

    @property
    def summary(self) -> dict[str, Any]:
        """The last line."""
        last: dict[str, Any] = json.loads(self.out[-1])
        assert last["event"] == "summary"
        return last
