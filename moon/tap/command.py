"""The ``moon tap`` command."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from m2c.inputs import DecimalRange, IntegerRange, interface_folders, options_as
from m2c.terminal import say
from moon.connection import Network, Watching, connected, library_in, network_options
from moon.tap.selection import KINDS, GlobError, Selection

if TYPE_CHECKING:
    from moon.wording import Wording
    from transports.interface import Connection


class TapOptions(NamedTuple):  # msgspec's would cost each --help its import
    """The command line of ``moon tap``; what was not given is None, empty or False.

    Attributes:
        channels: globs of what is shown; all if empty.
        network: where the system runs.
        node: globs of whose events are shown.
        kind: which kinds of events are shown.
        as_json: whether each is shown as JSON.
        stats: whether rates and latencies are shown instead.
        seconds: after how many it ends.
        interfaces: folders of interface packages.
        lines: after how many it ends.
    """

    channels: tuple[str, ...]
    network: Network
    node: tuple[str, ...]
    kind: tuple[str, ...]
    as_json: bool
    stats: bool
    seconds: float | None
    interfaces: tuple[Path, ...]
    lines: int | None


@click.command()
@click.argument("channels", nargs=-1)
@network_options
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
    type=DecimalRange(min=0, min_open=True),
    help="Stop after this many seconds.",
)
@interface_folders
@click.option("--count", "lines", type=IntegerRange(min=1), help="Stop after this many lines.")
@options_as(TapOptions)
def tap(options: TapOptions) -> None:
    """Watch everything that happens: topics, service calls, actions; decoded and matched.

    CHANNELS are globs such as '/BatteryLevelSkill/*' (`**` crosses parts of a name; an action stands
    for all its parts); without any, everything is shown. The tap is passive: no node waits for it or
    knows of it.

    A response is shown with its round-trip time. A constant is shown with its name, `FAILURE (1)`, if
    bt_interfaces, ROS 2's standard types or --interfaces define it.

    \b
    Example:
      moon tap '/NavigationComponent/**' --endpoint tcp/127.0.0.1:7447
    """
    from moon.wording import Wording

    try:
        selection = Selection(options.channels, options.node, options.kind)
    except GlobError as error:
        raise click.BadParameter(str(error), param_hint="CHANNELS") from error
    network = options.network
    with connected(network, "moon_tap", writing="what was received") as connection:
        wording = Wording(library_in(options.interfaces, network.transport))
        _watch(connection, selection, wording, options)


def _watch(
    connection: Connection,
    selection: Selection,
    wording: Wording,
    options: TapOptions,
) -> None:
    from moon.tap.notices import Notices
    from moon.tap.output import output_for
    from moon.tap.watch import Watch

    start = time.monotonic()
    output = output_for(options.as_json, options.stats, connection.post, wording)
    watching = Watching(connection)
    watch = Watch(selection, output, Notices(say), options.lines, watching.stop)
    try:
        listener = connection.tap(selection.tapped(), watch.observe)
        watching.run(lambda: watch.look_around(listener, connection.now_ns()), options.seconds)
        watch.finish(listener, connection.now_ns())
    finally:
        output.close()
    say(
        f"received {watch.received:,} observations in {time.monotonic() - start:.1f} s, "
        f"showed {watch.shown:,} event{'s' * (watch.shown != 1)}"
    )
