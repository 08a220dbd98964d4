"""What benchmarks need around them: a place on the loopback link, and processors that are busy."""

from __future__ import annotations

import contextlib
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator

from transports.interface import Transport


def free_endpoint() -> str:
    """A loopback endpoint that nobody uses at the moment."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{free.getsockname()[1]}"


@contextlib.contextmanager
def busy(count: int) -> Iterator[None]:
    """Meanwhile so many processes keep processors busy."""
    burners = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for process in burners:
            process.kill()
            process.wait()


@contextlib.contextmanager
def spinning(transport: Transport) -> Iterator[None]:
    """Meanwhile ``transport`` spins in a thread; closed behind it, whatever went wrong."""
    thread = threading.Thread(target=transport.spin)
    thread.start()
    try:
        yield
    finally:
        transport.close()
        thread.join()


@contextlib.contextmanager
def moon_hearing(node: str, *arguments: object) -> Iterator[None]:
    """Meanwhile ``moon`` with these arguments is at work; from when it has said that it hears ``node``."""
    command = [sys.executable, "-m", "moon.cli", *map(str, arguments)]
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stderr is not None
            assert any(node in line for line in process.stderr), "moon has ended"
            threading.Thread(target=process.stderr.read, daemon=True).start()
            yield
        finally:
            process.send_signal(signal.SIGINT)
