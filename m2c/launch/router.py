"""The router of ``m2c run --router``: one that is there already, or one that this run starts and ends.

Who starts at the same moment as another, or on another host than the router's, cannot listen there: then the
router is somebody else's, which the connection shows.
"""

from __future__ import annotations

import contextlib
import os
import select
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from m2c.launch.process import STOP_TIMEOUT_S, Module, NodeProcess
from m2c.terminal import say
from transports.interface import Connection, TransportError
from transports.options import LAUNCHER
from transports.registry import connect
from transports.zenoh_link.refusals import asked_as_nodes_are

NAME = "router"
"""The prefix of its output."""
_PACKAGE = "transports.zenoh_link.router"
_READY_S = 30.0
"""How long a router may take to listen; a machine under load starts twenty interpreters in it."""

Line = Callable[[str, str], None]
Ended = Callable[[str, int], None]


class Router:
    """A router's process. What it says and how it ends is kept until somebody follows it.

    Args:
        folder: put on the module path, as of nodes.
        options: of the transport; the router listens at the ``endpoint``.
    """

    def __init__(self, folder: Path, options: dict[str, str]) -> None:
        self._lock = threading.Lock()
        self._lines: list[str] = []
        self._code: int | None = None
        self._follower: tuple[Line, Ended] | None = None
        files = {"config": "--zenoh-config", "secure": "--secure"}
        arguments = ["--listen", options["endpoint"]]
        for option in sorted(files.keys() & options.keys()):
            arguments += [files[option], options[option]]
        ready, say_ready = os.pipe()
        try:
            self.process = NodeProcess(
                NAME,
                Module(
                    package=_PACKAGE,
                    folders=[folder],
                    arguments=[*arguments, "--ready-fd", str(say_ready)],
                    files=[say_ready],
                ),
                self._line,
                self._ended,
            )
        finally:
            os.close(say_ready)
        with open(ready, "rb") as line:
            can_be_read, _, _ = select.select([line], [], [], _READY_S)
            self.listens = bool(can_be_read and line.readline())
            """Whether it is the router at the endpoint; else it has ended, or does not come up."""

    def follow(self, line: Line, ended: Ended) -> None:
        """Tell what it has said, and whatever it says and does from now on."""
        with self._lock:
            self._follower = line, ended
            for text in self._lines:
                line(NAME, text)
            if self._code is not None:
                ended(NAME, self._code)

    def end(self) -> str:
        """End it; how it ended, in words, if not as it was asked to."""
        self.process.terminate()
        return self.process.finish(time.monotonic() + STOP_TIMEOUT_S)

    def _line(self, name: str, text: str) -> None:
        with self._lock:
            if self._follower is None:
                self._lines.append(text)
            else:
                self._follower[0](name, text)

    def _ended(self, name: str, code: int) -> None:
        with self._lock:
            self._code = code
            if self._follower is not None:
                self._follower[1](name, code)


@contextlib.contextmanager
def met_at_router(
    transport: str, folder: Path, options: dict[str, str]
) -> Iterator[tuple[Connection, Router | None]]:
    """The launcher's connection to the router at the endpoint; and the router, if it was started for that.

    The router ends when everybody else has; the connection, whose closing is awaited, before.

    Args:
        transport: which of those that can meet at a router.
        folder: put on the router's module path, as of nodes.
        options: of the transport, with the ``endpoint``.

    Raises:
        TransportError: there is no router, and none can be started there.
    """
    from transports.zenoh_link.session import NotARouterError

    with asked_as_nodes_are():
        router = Router(folder, options)
    try:
        try:
            connection = connect(transport, LAUNCHER, {**options, "mode": "client"})
        except TransportError as error:
            if router.listens or isinstance(error, NotARouterError):
                raise
            _, _, said = " ".join(router.process.last_lines).partition(": ")
            raise type(error)(f"{error}; nor can a router be started there: {said}") from None
        yield connection, (router if router.listens else None)
    finally:
        is_unsaid = router.listens and router.process.code is None
        how = router.end()
        if how and is_unsaid:
            say(f"{NAME} {how} when everything was stopped")
