"""The ``moon monitor`` command."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from m2c.inputs import interface_folders
from moon.connection import Network, Watching, connected, fail, finite, network_options, say

if TYPE_CHECKING:
    from collections.abc import Sequence

    from m2c.model.machine import Machine
    from m2c.model.system import System
    from moon.monitor.properties import PropertyWatch
    from moon.monitor.watch import Sink
    from moon.oracle.bounds import Bounds
    from transports.interface import Transport

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
@network_options
@interface_folders
@click.option("--only", multiple=True, metavar="NODE", help="Monitor only this node (repeatable).")
@click.option("--without", multiple=True, metavar="NODE", help="Do not monitor it (repeatable).")
@click.option(
    "--deadline",
    type=_SECONDS,
    callback=finite,
    default=1.0,
    show_default=True,
    help="Seconds in which a node must send what it owes.",
)
@click.option(
    "--latency-bound",
    type=_SECONDS,
    callback=finite,
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
    "--for", "seconds", type=_SECONDS, callback=finite, help="Stop after this many seconds."
)
def monitor(
    models: tuple[Path, ...],
    property_files: tuple[Path, ...],
    network: Network,
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
        fail(str(error))
    if network.transport == "simulated":
        fail("--transport simulated: that world is in one process; watch it there (SystemWatch)")
    machines, unjudged = judgeable(machines)
    for sentence in unjudged:
        say(sentence)
    if unjudged and system.policy is not None:
        say("the policy is not judged: that needs all of its nodes")
    if models and not machines:
        fail(f"{system.name}: no node is left that can be judged")
    for sentence in unknown_channels(properties, system) if models else ():
        say(f"warning: {sentence}")
    bounds = Bounds(latency=round(latency_bound * 1e9), deadline=round(deadline * 1e9))
    with connected(network, "moon_monitor", writing="verdicts") as connection:
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
            has_diagnostics=network.transport == "ros2",
        )
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

    file = VerdictFile(log_file) if log_file is not None else None
    screen = screen_for(as_json)
    sinks: list[Sink] = [*([file] if file else []), VerdictTopic(connection), screen]
    if has_diagnostics:
        sinks += _diagnostics(connection)
    watch = SystemWatch(connection, system, machines, bounds, sinks, say, properties)
    notices = Notices(say)
    try:
        watch.start()
        listener = watch.listener
        assert listener is not None

        def look_around() -> None:
            screen.refresh(watch.statuses())
            notices.links(listener.peers())
            notices.problems(watch.problems())

        def is_over() -> bool:
            return exit_on_violation and watch.violations > 0

        Watching(connection).run(look_around, seconds, is_over)
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
        say(f"no verdicts on /diagnostics: {error}")
        return []
