"""How a command that watches meets the running system, and how it ends.

What ``moon``'s commands share: the options of their connection, what they say of it, and running
until a signal, a time or what they have seen ends them.
"""

from __future__ import annotations

import contextlib
import errno
import functools
import os
import select
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from m2c.inputs import ExistingPath, Integer, TransportName
from m2c.terminal import fail, say, write_to_nobody
from transports.descriptions import described
from transports.options import DEFAULT_ENDPOINT, SECURE_ENDPOINT, meeting_at, transport_options
from transports.stop_signals import ENDING, StopSignals, end_by

if TYPE_CHECKING:
    from m2c.model.interfaces import InterfaceLibrary
    from transports.interface import Connection

MONITOR = "monitor"
OBSERVER = "observer"
"""Whose certificates ``moon monitor``, which publishes verdicts, and the other commands take."""
SETTLING_BOUNDS = 2
"""A monitor that is to end goes on for so many latency bounds: what it has received by then is judged."""
REFRESH_S = 0.5
"""How often what is shown is drawn anew, and losses looked for."""


Drive = Callable[[Callable[[], bool]], None]
"""Runs the system to its end, or until the argument holds: the observer wants no more."""


class Beside(NamedTuple):
    """A system in this process.

    Attributes:
        connection: the observer's own, to the world of the system.
        drive: see :data:`Drive`; from when it is called everything is to be received.
    """

    connection: Connection
    drive: Drive


def system_beside() -> Beside | None:
    """The system beside which the present command runs; None: it has a process of its own."""
    context = click.get_current_context(silent=True)
    return None if context is None else context.find_object(Beside)


class Network(NamedTuple):  # msgspec's would cost each --help its import
    """Where the system runs that is to be watched.

    Attributes:
        transport: name of the middleware.
        endpoints: where to connect; by default, on Zenoh, where ``m2c run`` lets its nodes meet.
        zenoh_config: Zenoh's configuration file.
        namespace: prefix of every channel.
        secure: the folder of certificates that ``moon keys init`` made.
    """

    transport: str
    endpoints: tuple[str, ...] = ()
    zenoh_config: Path | None = None
    namespace: str = ""
    secure: Path | None = None


_NETWORK_OPTIONS = (
    click.option(
        "--transport",
        type=TransportName(),
        default="zenoh",
        show_default=True,
        help="The middleware.",
    ),
    click.option(
        "--endpoint",
        multiple=True,
        help=f"Where the nodes meet (repeatable); for zenoh without a configuration file by default "
        f"{DEFAULT_ENDPOINT}.",
    ),
    click.option(
        "--zenoh-config",
        type=ExistingPath(path_type=Path, exists=True, dir_okay=False),
        help="Zenoh configuration file (TLS, routers…).",
    ),
    click.option(
        "--secure",
        type=click.Path(path_type=Path),
        metavar="DIR",
        help="Zenoh: connect with a certificate that `moon keys init` made in DIR.",
    ),
    click.option("--namespace", default="", help="Prefix of every channel."),
)


def network_options(command: Callable[..., None]) -> Callable[..., None]:
    """Give a command the options of its connection; it gets them as one argument, ``network``."""

    @functools.wraps(command)
    def with_network(
        transport: str,
        endpoint: tuple[str, ...],
        zenoh_config: Path | None,
        secure: Path | None,
        namespace: str,
        **others: object,
    ) -> None:
        if secure is not None and (
            zenoh_config is not None or not described(transport).has_endpoints
        ):
            raise click.UsageError("--secure is for zenoh, and excludes --zenoh-config")
        network = Network(transport, endpoint, zenoh_config, namespace, secure)
        command(network=network, **others)

    for option in reversed(_NETWORK_OPTIONS):
        with_network = option(with_network)
    return with_network


ready_option = click.option(
    "--ready-fd",
    type=Integer(),
    metavar="FD",
    help="Write a line, the name of this node, to this open file once every channel is subscribed to. What "
    "starts after that is observed from its first message. SIGUSR1 says later that the nodes are to end.",
)
"""Readiness, as the s6 supervisor and ``m2c run`` want it reported."""


def say_ready(descriptor: int | None, node: str) -> None:
    """Tell who started this process with ``--ready-fd``, if anybody did; nobody need wait for it.

    Args:
        descriptor: the open file; None: nobody did.
        node: the name of this process's own.
    """
    if descriptor is not None:
        with contextlib.suppress(BrokenPipeError), open(descriptor, "wb") as file:
            file.write(f"{node}\n".encode())


def when_ending(
    descriptor: int | None, connection: Connection, handler: Callable[[], None]
) -> None:
    """Call ``handler()``, on the executor, when the nodes of the system are about to be ended.

    Who started this process with ``--ready-fd`` says so by the signal ``ENDING``.

    Args:
        descriptor: the open file of ``--ready-fd``; None: nobody will say so.
        connection: on whose executor.
        handler: what is done then.
    """
    if descriptor is not None:
        signal.signal(ENDING, lambda number, frame: connection.post(handler))


def options_of(network: Network) -> dict[str, str]:
    """The options of the transport by which ``network`` is met.

    Where nodes meet at an endpoint, whoever comes first, this process or the system, listens there.
    """
    endpoints, has_endpoints = network.endpoints, described(network.transport).has_endpoints
    if not endpoints and network.zenoh_config is None and has_endpoints:
        endpoints = (DEFAULT_ENDPOINT if network.secure is None else SECURE_ENDPOINT,)
    config = str(network.zenoh_config) if network.zenoh_config is not None else ""
    secure = str(network.secure) if network.secure is not None else ""
    options = transport_options(endpoints, config, network.namespace, secure)
    return meeting_at(options) if has_endpoints else options


def library_in(folders: Sequence[Path], transport: str) -> InterfaceLibrary:
    """The types in ``folders`` of interface packages, and those that are built and sourced."""
    from m2c.diagnostics import DiagnosticLog
    from m2c.model.interfaces import InterfaceLibrary

    known = list(folders)
    if described(transport).needs_packages:
        prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
        known += [Path(prefix, "share") for prefix in prefixes if prefix]
    return InterfaceLibrary.load([folder for folder in known if folder.is_dir()], DiagnosticLog())


@contextmanager
def connected(network: Network, name: str, writing: str) -> Iterator[Connection]:
    """A connection to ``network``, closed afterwards; what goes wrong with it ends the process.

    The exit code is 2 then, after one sentence on standard error; 0 if only the reader of standard
    output, or the terminal, has gone.

    Args:
        network: where to connect.
        name: of the command; the node is called ``<name>_<process id>``.
        writing: what the command writes, for ``cannot write …``.
    """
    from m2c.logs import log_as_lines
    from transports.interface import TransportError

    log_as_lines()
    try:
        connection = _connection(network, name)
        try:
            yield connection
        finally:
            connection.close()
    except TransportError as error:
        fail(str(error))
    except OSError as error:
        if isinstance(error, BrokenPipeError) or _terminal_is_gone(error):
            write_to_nobody()
            sys.exit(0)
        to = f" to {error.filename}" if error.filename else ""
        say(f"error: cannot write {writing}{to}: {error.strerror}")
        write_to_nobody()
        sys.exit(2)


def _connection(network: Network, name: str) -> Connection:
    from transports.registry import connect

    beside = system_beside()
    if beside is not None:
        return beside.connection
    if described(network.transport).is_one_process:
        fail(
            f"--transport {network.transport}: that world is in one process; `m2c run --transport simulated` "
            "has --monitor and --record"
        )
    StopSignals()  # from here on, what ends this process waits until it can be ended in good order
    options = options_of(network)
    if network.secure is not None:
        options["identity"] = MONITOR if name == "moon_monitor" else OBSERVER
    return connect(network.transport, f"{name}_{os.getpid()}", options)


class Watching:
    """Runs a connection until it is to end: ``stop()``, a signal, a time, or what was seen.

    Args:
        connection: what to run; its executor is the thread that calls ``run``.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._stopped = False

    def stop(self) -> None:
        """End ``run``; on the executor's thread."""
        self._stopped = True

    def run(
        self,
        look_around: Callable[[], None],
        seconds: float | None = None,
        is_over: Callable[[], bool] = lambda: False,
        settling_s: float = 0.0,
    ) -> None:
        """Run, for at most ``seconds``, until ``stop()``, a signal, or ``is_over()`` holds.

        ``look_around`` is called every :data:`REFRESH_S`. Unless ``is_over()``, it goes on for
        ``settling_s`` then: what has been received is judged when nothing older can come any more.

        Raises:
            BrokenPipeError: nobody reads standard output any more; on a terminal: it was hung up.
        """

        def look() -> None:
            if _reader_is_gone():
                raise BrokenPipeError
            look_around()

        connection = self._connection
        connection.every(REFRESH_S, look)
        if seconds is not None:
            connection.after(seconds, self.stop)
        try:
            self._until_stopped(is_over)
            if settling_s and not is_over():
                self._stopped = False
                connection.after(settling_s, self.stop)
                connection.spin(until=lambda: self._stopped)
        except OSError as error:
            if _terminal_is_gone(error):
                raise BrokenPipeError from error
            raise

    def _until_stopped(self, is_over: Callable[[], bool]) -> None:
        connection, beside = self._connection, system_beside()
        if beside is not None:
            beside.drive(lambda: self._stopped or is_over())
        else:
            # asked twice: a reader that is stuck holds us up
            StopSignals.kept().call(lambda: connection.post(self.stop), again=end_by)
            connection.spin(until=lambda: self._stopped or is_over())


def _terminal_is_gone(error: OSError) -> bool:
    """Whether it is that of a write to a terminal that was hung up (POSIX, write(): EIO)."""
    return error.errno == errno.EIO and _reader_is_gone()


def _reader_is_gone() -> bool:
    """Whether nobody can read standard output any more (as after ``| head``)."""
    try:
        out = sys.stdout.fileno()
    except OSError:  # not a file
        return False
    poll = select.poll()
    poll.register(out, 0)
    return any(events & (select.POLLERR | select.POLLHUP) for _, events in poll.poll(0))
