"""The ``moon monitor`` command."""

from __future__ import annotations

import math
import os
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import click

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import FrameType

    from m2c.model.machine import Machine
    from m2c.model.system import System
    from moon.monitor.properties import PropertyWatch
    from moon.monitor.watch import Sink
    from moon.oracle.bounds import Bounds
    from transports.interface import Transport

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
"""Where ``m2c run`` lets its nodes meet."""
REFRESH_S = 0.5
"""How often the table is drawn anew, and losses looked for."""


def _finite(_: click.Context, parameter: click.Parameter, value: float | None) -> float | None:
    if value is not None and not math.isfinite(value):
        raise click.BadParameter(f"{value} is not a number of seconds")
    return value


_SECONDS = click.FloatRange(min=0, min_open=True, max=86_400 * 365)


@click.command()
@click.argument("models", nargs=-1, type=click.Path(path_type=Path), metavar="MODEL...|SYSTEM")
@click.option(
    "--properties",
    "property_files",
    multiple=True,
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Monitor the properties in it, .yaml or .xml (repeatable).",
)
@click.option("--transport", default="zenoh", show_default=True, help="The middleware.")
@click.option(
    "--endpoint",
    multiple=True,
    help=f"Where to connect (repeatable); for zenoh without a configuration file by default "
    f"{DEFAULT_ENDPOINT}.",
)
@click.option(
    "--zenoh-config",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="Zenoh configuration file (TLS, routers…).",
)
@click.option("--namespace", default="", help="Prefix of every channel.")
@click.option(
    "--interfaces",
    multiple=True,
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    help="Folder of ROS interface packages (repeatable).",
)
@click.option("--only", multiple=True, metavar="NODE", help="Monitor only this node (repeatable).")
@click.option("--without", multiple=True, metavar="NODE", help="Do not monitor it (repeatable).")
@click.option(
    "--deadline",
    type=_SECONDS,
    callback=_finite,
    default=1.0,
    show_default=True,
    help="Seconds in which a node must send what it owes.",
)
@click.option(
    "--latency-bound",
    type=_SECONDS,
    callback=_finite,
    default=0.2,
    show_default=True,
    help="Seconds in which a message is taken, and an event heard here.",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object a line, for pipes.")
@click.option(
    "--log",
    "log_file",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Append every verdict to this file, a JSON object a line.",
)
@click.option("--exit-on-violation", is_flag=True, help="Stop at the first one.")
@click.option(
    "--for", "seconds", type=_SECONDS, callback=_finite, help="Stop after this many seconds."
)
def monitor(
    models: tuple[Path, ...],
    property_files: tuple[Path, ...],
    transport: str,
    endpoint: tuple[str, ...],
    zenoh_config: Path | None,
    namespace: str,
    interfaces: tuple[Path, ...],
    only: tuple[str, ...],
    without: tuple[str, ...],
    deadline: float,
    latency_bound: float,
    as_json: bool,
    log_file: Path | None,
    exit_on_violation: bool,
    seconds: float | None,
) -> None:
    """Check a running system against its models, or properties, or both, passively.

    MODEL...|SYSTEM are models (.scxml, .ascxml), folders of them, or one system file: channels, types
    and what is owed when come from there. They may be left out with --properties. Verdicts are shown,
    and published on /moon/verdicts. No node waits for the monitor. Exit code 0: nothing was violated;
    1: something was; 2: it could not monitor.

    Example: moon monitor examples/lab_tour/system.xml --for 60
    """
    from m2c.model import ModelError
    from moon.monitor.properties import PropertyWatch, unknown_channels
    from moon.monitor.reading import (
        SelectionError,
        judgeable,
        no_system,
        read_checked,
        say_why,
        select,
    )
    from moon.oracle.bounds import Bounds
    from moon.properties.files import load_properties
    from transports.interface import TransportError
    from transports.registry import connect

    if not models and not property_files:
        raise click.UsageError("Missing argument 'MODEL...|SYSTEM' (or --properties FILE)")
    if not models and (only or without):
        raise click.UsageError("--only and --without choose nodes of models, and there are none")
    try:
        properties = load_properties(*property_files)
        system = read_checked(models, interfaces) if models else no_system()
        machines = select(system, only, without) if models else ()
    except ModelError as error:
        say_why(error)
        sys.exit(2)
    except SelectionError as error:
        _fail(str(error))
    if transport == "simulated":
        _fail("--transport simulated: that world is in one process; watch it there (SystemWatch)")
    machines, unjudged = judgeable(machines)
    for sentence in unjudged:
        _say(sentence)
    if unjudged and system.policy is not None:
        _say("the policy is not judged: that needs all of its nodes")
    if models and not machines:
        _fail(f"{system.name}: no node is left that can be judged")
    for sentence in unknown_channels(properties, system) if models else ():
        _say(f"warning: {sentence}")
    bounds = Bounds(latency=round(latency_bound * 1e9), deadline=round(deadline * 1e9))
    if not endpoint and zenoh_config is None and transport == "zenoh":
        endpoint = (DEFAULT_ENDPOINT,)
    options = {
        "endpoint": ",".join(endpoint),
        "config": str(zenoh_config) if zenoh_config is not None else "",
        "namespace": namespace,
    }
    try:
        connection = connect(
            transport,
            f"moon_monitor_{os.getpid()}",
            {name: value for name, value in options.items() if value},
        )
        try:
            violations = _monitor(
                connection,
                system,
                machines,
                bounds,
                PropertyWatch(properties, bounds.latency),
                as_json,
                log_file,
                exit_on_violation,
                seconds,
                has_diagnostics=transport == "ros2",
            )
        finally:
            connection.close()
    except TransportError as error:
        _fail(str(error))
    except BrokenPipeError:
        _write_to_nobody()
        sys.exit(0)
    except OSError as error:
        _say(f"error: cannot write verdicts{_to(error)}: {error.strerror}")
        _write_to_nobody()
        sys.exit(2)
    sys.exit(1 if violations else 0)


def _monitor(
    connection: Transport,
    system: System,
    machines: Sequence[Machine],
    bounds: Bounds,
    properties: PropertyWatch,
    as_json: bool,
    log_file: Path | None,
    exit_on_violation: bool,
    seconds: float | None,
    has_diagnostics: bool,
) -> int:
    """Monitor until it is to end; how many violations there were."""
    from moon.monitor.screen import screen_for
    from moon.monitor.watch import SystemWatch
    from moon.sinks.file import VerdictFile
    from moon.sinks.topic import VerdictTopic
    from moon.tap.notices import Notices
    from moon.tap.output import reader_is_gone

    ended = False

    def stop() -> None:
        nonlocal ended
        ended = True

    def asked_to_stop(number: int, _: FrameType | None) -> None:
        signal.signal(number, signal.SIG_DFL)  # asked twice: a reader that is stuck holds us up
        connection.post(stop)

    file = VerdictFile(log_file) if log_file is not None else None
    screen = screen_for(as_json)
    sinks: list[Sink] = [*([file] if file else []), VerdictTopic(connection), screen]
    if has_diagnostics:
        sinks += _diagnostics(connection)
    watch = SystemWatch(connection, system, machines, bounds, sinks, _say, properties)
    notices = Notices(_say)
    try:
        watch.start()
        listener = watch.listener
        assert listener is not None

        def look_around() -> None:
            if reader_is_gone():
                raise BrokenPipeError
            screen.refresh(watch.statuses())
            notices.links(listener.peers())
            notices.problems(watch.problems())

        def is_over() -> bool:
            return ended or (exit_on_violation and watch.violations > 0)

        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, asked_to_stop)
        connection.every(REFRESH_S, look_around)
        if seconds is not None:
            connection.after(seconds, stop)
        connection.spin(until=is_over)
        notices.last_problems(watch.problems())
        screen.finish(watch.summary())
        return watch.violations
    finally:
        screen.close()
        if file is not None:
            file.close()


def _diagnostics(connection: Transport) -> list[Sink]:
    """What publishes on ``/diagnostics``; without its messages, one goes without it."""
    from moon.sinks.diagnostics import Diagnostics
    from transports.interface import TransportError

    try:
        return [Diagnostics(connection)]
    except TransportError as error:
        _say(f"no verdicts on /diagnostics: {error}")
        return []


def _fail(message: str) -> NoReturn:
    _say(f"error: {message}")
    sys.exit(2)


def _to(error: OSError) -> str:
    return f" to {error.filename}" if error.filename else ""


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _write_to_nobody() -> None:
    """Let what is still buffered go nowhere: Python would complain of it when it ends."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        os.dup2(nowhere, stream.fileno())
