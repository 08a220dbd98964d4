"""``moon monitor --fleet``: from the options to the end."""

from __future__ import annotations

import gc
from typing import TYPE_CHECKING

from m2c.terminal import fail, say
from moon.connection import SETTLING_BOUNDS, Watching, say_ready, when_ending

if TYPE_CHECKING:
    from moon.fleet.choice import Shard
    from moon.monitor.options import MonitorOptions
    from moon.monitor.subject import Monitored
    from moon.sources.source import Sink
    from transports.interface import Connection


def monitor_fleet(
    connection: Connection,
    monitored: Monitored,
    options: MonitorOptions,
    pattern: str,
    shard: Shard,
) -> int:
    """Monitor the robots whose namespaces match ``pattern``, those of a share, until it is to end.

    Returns:
        The exit code of the process.
    """
    from moon.feed.clock import NS
    from moon.fleet.fleet import Fleet
    from moon.fleet.screen import fleet_screen
    from moon.sinks.file import VerdictFile
    from moon.sources.source import Outputs
    from transports.interface import Namespaces

    if not isinstance(connection, Namespaces):
        transport = options.network.transport
        fail(f"--fleet: the transport {transport} listens to one namespace only; zenoh has all")
    file = VerdictFile(options.log_file) if options.log_file is not None else None
    screen = fleet_screen(options.as_json)
    sinks: list[Sink] = [file] if file is not None else []
    fleet = Fleet(
        connection,
        pattern,
        monitored,
        Outputs(
            [*sinks, *([screen] if options.as_json else [])],
            say,
            [] if options.as_json else [screen],
        ),
        shard,
    )

    def look_around() -> None:
        fleet.look_around()
        screen.refresh(fleet.robots)

    try:
        gc.freeze()  # as in a monitor of one system
        fleet.start()
        when_ending(options.ready_fd, connection, lambda: fleet.ending(connection.now_ns()))
        say_ready(options.ready_fd, connection.node)
        settling_s = SETTLING_BOUNDS * monitored.bounds.latency / NS

        def is_over() -> bool:
            return options.exit_on_violation and fleet.is_violated

        Watching(connection).run(look_around, options.seconds, is_over, settling_s)
        fleet.finish()
        screen.finish(fleet.summary())
    finally:
        screen.close()
        if file is not None:
            file.close()
    if fleet.violations:
        return 1
    return 2 if fleet.failures else 0
