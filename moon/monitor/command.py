"""The ``moon monitor`` command."""

from __future__ import annotations

import contextlib
import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from m2c.inputs import options_as
from m2c.terminal import fail, say
from moon.connection import (
    SETTLING_BOUNDS,
    Watching,
    connected,
    network_options,
    ready_option,
    say_ready,
    system_beside,
    when_ending,
)
from moon.fleet.command import monitor_fleet
from moon.fleet.options import fleet_options
from moon.monitor.options import MonitorOptions
from moon.monitor.subject_options import SECONDS, read_or_fail, subject_options
from moon.monitor.verdict_options import json_option, log_option

if TYPE_CHECKING:
    from moon.monitor.subject import Monitored
    from moon.recording.writer import RecordingWriter
    from moon.sources.source import Sink, Source
    from transports.interface import Connection

FLUSH_S = 0.5
"""How often what was recorded is handed to the system: no more is lost with the process."""


@click.command()
@click.argument("models", nargs=-1, type=click.Path(path_type=Path), metavar="MODEL...|SYSTEM")
@network_options
@subject_options
@json_option
@log_option
@click.option(
    "--record",
    "record_file",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Record the run, verdicts included, to this MCAP file.",
)
@ready_option
@fleet_options
@click.option("--exit-on-violation", is_flag=True, help="Stop at the first one.")
@click.option("--for", "seconds", type=SECONDS, help="Stop after this many seconds.")
@options_as(MonitorOptions)
def monitor(options: MonitorOptions) -> None:
    """Check a running system against its models, or properties, or both, passively.

    MODEL...|SYSTEM are models (.scxml, .ascxml), folders of them, or one system file. They give the
    channels, the types and the expected outputs. With --properties they may be left out.

    Verdicts are shown, and published on /moon/verdicts. The monitor is passive: no node waits for it.

    Exit code 0: no violation; 1: a violation; 2: the monitor could not run.

    --fleet monitors every robot whose namespace matches, as robots come and go: each runs the system with
    `m2c run --namespace`. --shard spreads a fleet over several monitors, which need not know of one another.

    \b
    Example:
      moon monitor examples/lab_tour/system.xml --for 60
      moon monitor examples/lab_tour/system.xml --fleet 'robots/*' --shard 2/4
    """
    monitored = read_or_fail(options.choice.subject(options.models))
    if options.fleet is not None:
        with connected(options.network, "moon_monitor", writing="verdicts") as connection:
            code = monitor_fleet(connection, monitored, options, *options.fleet)
        sys.exit(code)
    with (
        connected(options.network, "moon_monitor", writing="verdicts") as connection,
        _recorder(options.record_file, monitored) as recorder,
    ):
        violations = _monitor(connection, monitored, recorder, options)
    sys.exit(1 if violations else 0)


@contextmanager
def _recorder(path: Path | None, monitored: Monitored) -> Iterator[RecordingWriter | None]:
    """What writes the recording, if one is wanted."""
    if path is None:
        yield None
        return
    from moon.recording.definitions import Definitions
    from moon.recording.offers import declared
    from moon.recording.writer import RecordingWriter

    try:
        system = monitored.system
        offers = declared((*system.nodes, *system.plugins))
        writer = RecordingWriter(path, Definitions(system.library), offers=offers)
    except FileExistsError:
        fail(f"{path}: is there already; a recording is not written over")
    try:
        yield writer
    finally:
        writer.close()
    for sentence in writer.unknown_types():
        say(f"note: {sentence}")


def _monitor(
    connection: Connection,
    monitored: Monitored,
    recorder: RecordingWriter | None,
    options: MonitorOptions,
) -> int:
    """Monitor until it is to end; how many violations there were."""
    import msgspec

    from moon.feed.clock import NS
    from moon.monitor.screen import screen_for
    from moon.run import Run
    from moon.sinks.file import VerdictFile
    from moon.sinks.topic import VerdictTopic
    from moon.sources.live import Joining
    from moon.sources.recorded import RecordedConnection, RecordedRun
    from moon.sources.source import Outputs
    from moon.tap.notices import Notices
    from transports.descriptions import described

    transport, as_json = options.network.transport, options.as_json
    file = VerdictFile(options.log_file) if options.log_file is not None else None
    screen = screen_for(as_json, is_alone=system_beside() is None)
    sinks: list[Sink] = [*([file] if file else []), VerdictTopic(connection)]
    if as_json:
        sinks.append(screen)
    if described(transport).has_diagnostics:
        sinks += _diagnostics(connection)
    joining = Joining(connection)
    source: Source = joining
    run: RecordedRun | None = None
    if recorder is not None:
        source = recorded = RecordedConnection(joining, recorder.add, transport)
        run = RecordedRun(recorded, recorder)
        sinks.insert(0, run)
        connection.every(FLUSH_S, run.flush)
    watch = Run(source, monitored, Outputs(sinks, say, () if as_json else (screen,)))
    notices = Notices(say, is_first=options.ready_fd is not None)

    def ending() -> None:
        now_ns = source.now_ns()
        if run is not None:
            run.ending(now_ns)
        watch.ending(now_ns)

    when_ending(options.ready_fd, connection, ending)
    try:

        def begin() -> None:
            watch.start()
            say_ready(options.ready_fd, connection.node)

        joining.when_complete(begin, say)

        def look_around() -> None:
            screen.refresh(watch.statuses)
            if watch.listener is None:
                return
            notices.links(watch.listener.peers())
            notices.problems(watch.problems())
            if run is not None:
                run.note_problems(watch.listener.problems())

        def is_over() -> bool:
            return options.exit_on_violation and watch.violations > 0

        gc.freeze()  # models and modules stay: to look for garbage among them would hold a tick up
        settling_s = SETTLING_BOUNDS * monitored.bounds.latency / NS
        with contextlib.suppress(BrokenPipeError):  # the run ends as well as any other then
            Watching(connection).run(look_around, options.seconds, is_over, settling_s)
            watch.settle()
        if watch.listener is None:
            watch.start()  # stopped before it began
        assert watch.listener is not None
        notices.last_problems(watch.problems())
        if run is not None:
            run.end(watch.listener.problems())
        unmonitored = (*monitored.unmonitored, *watch.silent())
        summary = msgspec.structs.replace(watch.summary(), unmonitored=unmonitored)
        screen.finish(summary)
        return watch.violations
    finally:
        screen.close()
        if file is not None:
            file.close()


def _diagnostics(connection: Connection) -> list[Sink]:
    """What publishes on ``/diagnostics``; without its messages, one goes without it."""
    from moon.sinks.diagnostics import Diagnostics
    from transports.interface import TransportError

    try:
        return [Diagnostics(connection)]
    except TransportError as error:
        say(f"no verdicts on /diagnostics: {error}")
        return []
