"""The ``moon tap`` command."""

from __future__ import annotations

import math
import os
import signal
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from moon.tap.selection import KINDS, GlobError, Selection

if TYPE_CHECKING:
    from types import FrameType

    from transports.interface import Transport

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
"""Where ``m2c run`` lets its nodes meet."""
REFRESH_S = 0.5
"""How often statistics are drawn anew, and late calls and losses looked for."""


def _finite(_: click.Context, parameter: click.Parameter, value: float | None) -> float | None:
    if value is not None and not math.isfinite(value):
        raise click.BadParameter(f"{value} is not a number of seconds")
    return value


@click.command()
@click.argument("channels", nargs=-1)
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
    "--node", multiple=True, help="Only what this node sends, asks or answers (glob, repeatable)."
)
@click.option(
    "--kind",
    multiple=True,
    type=click.Choice(KINDS),
    help="Only this kind of event (repeatable); `action`: every part of an action.",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object a line, for pipes.")
@click.option("--stats", is_flag=True, help="Rates and latencies per channel instead of a stream.")
@click.option(
    "--for",
    "seconds",
    type=click.FloatRange(min=0, min_open=True),
    callback=_finite,
    help="Stop after this many seconds.",
)
@click.option("--count", type=click.IntRange(min=1), help="Stop after this many lines.")
def tap(
    channels: tuple[str, ...],
    transport: str,
    endpoint: tuple[str, ...],
    zenoh_config: Path | None,
    namespace: str,
    node: tuple[str, ...],
    kind: tuple[str, ...],
    as_json: bool,
    stats: bool,
    seconds: float | None,
    count: int | None,
) -> None:
    """Watch everything that happens: topics, service calls, actions; decoded and matched.

    CHANNELS are globs such as '/BatteryLevelSkill/*' (`**` crosses parts of a name; an action stands
    for all its parts); without any, everything is shown. A response is shown with its round-trip
    time. The tap is passive: no node waits for it or knows of it.

    Example: moon tap '/NavigationComponent/**' --endpoint tcp/127.0.0.1:7447
    """
    from transports.interface import TransportError
    from transports.registry import connect

    try:
        selection = Selection(channels, node, kind)
    except GlobError as error:
        raise click.BadParameter(str(error), param_hint="CHANNELS") from error
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
            f"moon_tap_{os.getpid()}",
            {name: value for name, value in options.items() if value},
        )
        try:
            _watch(connection, selection, as_json, stats, seconds, count)
        finally:
            connection.close()
    except TransportError as error:
        _say(f"error: {error}")
        sys.exit(2)
    except BrokenPipeError:
        _write_to_nobody()
    except OSError as error:
        _say(f"error: cannot write what was heard: {error.strerror}")
        _write_to_nobody()
        sys.exit(2)


def _watch(
    connection: Transport,
    selection: Selection,
    as_json: bool,
    stats: bool,
    seconds: float | None,
    count: int | None,
) -> None:
    from moon.tap.notices import Notices
    from moon.tap.output import output_for, reader_is_gone
    from moon.tap.watch import Watch

    ended = False

    def stop() -> None:
        nonlocal ended
        ended = True

    def asked_to_stop(number: int, _: FrameType | None) -> None:
        signal.signal(number, signal.SIG_DFL)  # asked twice: a reader that is stuck holds us up
        connection.post(stop)

    start = time.monotonic()
    output = output_for(as_json, stats, connection.post)
    watch = Watch(selection, output, Notices(_say), count, stop)
    try:
        listener = connection.tap(selection.to_hear(), watch.observe)

        def look_around() -> None:
            if reader_is_gone():
                raise BrokenPipeError
            watch.look_around(listener, connection.now_ns())

        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, asked_to_stop)
        connection.every(REFRESH_S, look_around)
        if seconds is not None:
            connection.after(seconds, stop)
        connection.spin(until=lambda: ended)
        watch.finish(listener, connection.now_ns())
    finally:
        output.close()
    _say(
        f"heard {watch.heard:,} observations in {time.monotonic() - start:.1f} s, "
        f"showed {watch.shown:,} event{'s' * (watch.shown != 1)}"
    )


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _write_to_nobody() -> None:
    """Let what is still buffered go nowhere: Python would complain of it when it ends."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        os.dup2(nowhere, stream.fileno())
