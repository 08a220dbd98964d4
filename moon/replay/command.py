"""The ``moon replay`` command."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import click

from m2c.inputs import DecimalRange, ExistingPath, options_as
from m2c.terminal import fail, say
from moon.connection import Network, Watching, connected, network_options
from moon.tap.selection import GlobError, check

if TYPE_CHECKING:
    from m2c.model.interfaces import InterfaceLibrary
    from moon.replay.script import Script
    from transports.interface import Connection

DISCOVERY_S = 1.0
"""How long it is looked who is there already, and then let be seen who is played."""
WAIT_S = 60.0
"""How long a node is waited for that is to be there."""


class ReplayOptions(NamedTuple):  # msgspec's would cost each --help its import
    """The command line of ``moon replay``; what was not given is empty or False.

    Attributes:
        recording: what is replayed.
        network: where.
        rate: recorded seconds per second.
        only: globs of the channels that are replayed; all if empty.
        played: the nodes that are played; all if empty.
        without: nodes that are not.
        interfaces: folders of interface packages.
        stay: whether it goes on to respond when the recording has ended.
    """

    recording: Path
    network: Network
    rate: float
    only: tuple[str, ...]
    played: tuple[str, ...]
    without: tuple[str, ...]
    interfaces: tuple[Path, ...]
    stay: bool


@click.command()
@click.argument("recording", type=click.Path(path_type=Path), metavar="RUN")
@network_options
@click.option(
    "--rate",
    type=DecimalRange(min=0, min_open=True, max=1000),
    default=1.0,
    show_default=True,
    help="Speed: recorded seconds per second.",
)
@click.option(
    "--only",
    multiple=True,
    metavar="CHANNEL",
    help="Replay only channels that match (glob, repeatable).",
)
@click.option(
    "--as", "played", multiple=True, metavar="NODE", help="Play only this node (repeatable)."
)
@click.option(
    "--without",
    multiple=True,
    metavar="NODE",
    help="Do not play this node: wait until it is up itself (repeatable).",
)
@click.option(
    "--interfaces",
    multiple=True,
    type=ExistingPath(path_type=Path, exists=True, file_okay=False),
    help="Folder of ROS interface packages, for types the recording does not define (repeatable).",
)
@click.option("--stay", is_flag=True, help="Keep responding after the recording has ended.")
@options_as(ReplayOptions)
def replay(options: ReplayOptions) -> None:
    """Play the nodes of a recording: publish, respond and call as they did.

    RUN is an MCAP file or a rosbag2 folder. Nodes that are up already are not played. So one node can run
    against a recorded system: it gets the recorded messages and requests, and the recorded responses to
    its own.

    Exit code 0, or 2 if nothing could be replayed.

    \b
    Example:
      moon replay run.mcap --without BatteryLevelSkill --endpoint tcp/127.0.0.1:7447
    """
    from m2c.diagnostics import DiagnosticLog
    from m2c.model.interfaces import InterfaceLibrary
    from m2c.suggestions import nearest
    from moon.recording.reader import RecordingError
    from moon.replay.script import Selected, read_script
    from transports.descriptions import described

    recording, network, only = options.recording, options.network, options.only
    for glob in only:
        try:
            check(glob)
        except GlobError as error:
            raise click.BadParameter(str(error), param_hint="--only") from error
    if described(network.transport).is_one_process:
        fail(
            f"--transport {network.transport}: that world is in one process; replay there "
            "(moon.replay.Replay)"
        )
    library = InterfaceLibrary.load(options.interfaces, DiagnosticLog())
    try:
        script = read_script(recording, Selected(only), library)
    except RecordingError as error:
        fail(str(error))
    for sentence in script.recording.faults():
        say(f"warning: {sentence}")
    nodes = script.nodes()
    for name in (*options.played, *options.without):
        if name not in nodes:
            hint = nearest(name, filter(None, nodes)) or "there are: none by name"
            fail(f"{recording}: no node {name} in it; {hint}")
    if not (script.topics or script.calls or any(script.goals.values())):
        fail(f"{recording}: nothing in it can be replayed")
    with connected(network, "moon_replay", "what is replayed") as conductor:
        _replay(conductor, script, library, options)


def _replay(
    conductor: Connection, script: Script, library: InterfaceLibrary, options: ReplayOptions
) -> None:
    from moon.recording.reader import open_recording
    from moon.replay.replay import Replay

    played, without = options.played, options.without
    live = _who_is_there(conductor, script.nodes(), without)

    def is_played(name: str) -> bool:
        if played and name not in played:
            return False
        return name not in live and name not in without

    for name in sorted(live):
        say(f"{name} is up already: it is not played")
    replay = Replay(script, conductor, _connector(options.network), is_played, options.rate, say)
    threads: list[threading.Thread] = []
    watching = Watching(conductor)
    try:
        replay.prepare()
        for sentence in replay.overview():
            say(sentence)
        for transport in replay.transports:
            thread = threading.Thread(target=transport.spin, name=transport.node, daemon=True)
            thread.start()
            threads.append(thread)
        for transport in replay.transports:  # what is published before they meet is lost
            transport.wait_for_nodes(sorted(live), WAIT_S)
        # who listens without a name (a tap, a bag) is waited for as long as for who is there
        conductor.after(
            DISCOVERY_S,
            lambda: replay.begin(open_recording(options.recording, library)),
        )
        watching.run(lambda: None, is_over=lambda: replay.finished and not options.stay)
    finally:
        for transport in replay.transports:
            transport.close()
        for thread in threads:
            thread.join()
    say(replay.summary())
    if replay.behind_s > 1.0:
        say(f"warning: what is replayed came up to {replay.behind_s:.1f} s late: lower --rate")
    if not replay.finished:
        say("stopped before the recording's end")


def _connector(network: Network) -> Callable[[str], Connection]:
    from moon.connection import options_of
    from transports.registry import connect

    return lambda name: connect(network.transport, name, options_of(network))


def _who_is_there(
    conductor: Connection, nodes: set[str], without: tuple[str, ...]
) -> frozenset[str]:
    """Those of ``nodes`` that are up; who is named in ``without`` is waited for."""
    up: set[str] = set()

    def changed(name: str, is_up: bool) -> None:
        (up.add if is_up else up.discard)(name)

    ended: list[bool] = []
    conductor.watch_nodes(changed)
    conductor.after(DISCOVERY_S, lambda: ended.append(True))
    conductor.spin(until=lambda: bool(ended))
    missing = [name for name in without if name not in up]
    if missing:
        say(f"waiting for {', '.join(missing)}")
        given_up: list[bool] = []
        conductor.after(WAIT_S, lambda: given_up.append(True))
        conductor.spin(until=lambda: bool(given_up) or up.issuperset(without))
        if not up.issuperset(without):
            missing = [name for name in without if name not in up]
            fail(f"{', '.join(missing)} did not come up within {WAIT_S:.0f} s")
    return frozenset(up & nodes)
