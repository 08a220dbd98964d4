"""The program of a generated policy: its table of leaves, and its command line."""

from __future__ import annotations

import argparse
import signal
import sys
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import msgspec

from m2c.model.datatypes import Structure
from m2c.runtime.main import add_transport_options, set_up_logging, transport_options
from m2c.runtime.messages import message_class
from transports.interface import Service, TransportError
from transports.registry import connect

if TYPE_CHECKING:
    from m2c.policy.runner import LeafServices, PluginClass


class LeafService(msgspec.Struct, frozen=True):
    """A service that a leaf calls."""

    channel: str
    type_name: str
    request: Structure
    response: Structure


class LeafEntry(msgspec.Struct, frozen=True):
    """A leaf of the tree; see :class:`m2c.policy.runner.LeafServices`."""

    name: str
    condition: bool
    tick: LeafService | None = None
    halt: LeafService | None = None
    plugin: str = ""
    ports: dict[str, str] = {}


class PolicyTable(msgspec.Struct, frozen=True):
    """``policy.json``: the tree as BehaviorTree.CPP 4 XML, and its leaves."""

    name: str
    xml: str
    leaves: tuple[LeafEntry, ...]
    tick_rate_hz: float = 1.0


def leaf_services(table: PolicyTable) -> list[LeafServices]:
    """The leaves of ``table`` with message classes, as the runner takes them."""
    from m2c.policy.runner import LeafServices

    return [
        LeafServices(
            name=leaf.name,
            condition=leaf.condition,
            tick=_service(leaf.tick),
            halt=_service(leaf.halt),
            plugin=leaf.plugin,
            ports=leaf.ports,
        )
        for leaf in table.leaves
    ]


def _service(described: LeafService | None) -> Service | None:
    if described is None:
        return None
    request, response = message_class(described.request), message_class(described.response)
    return Service(described.channel, described.type_name, request, response)


def main(
    folder: Path,
    plugins: Mapping[str, PluginClass],
    arguments: Sequence[str] | None = None,
) -> NoReturn:
    """Run the policy in ``folder`` until SIGINT, SIGTERM or its last tick; exits with 0 then.

    The tree is ticked on a thread of its own, because a tick waits for its skills' answers; the main
    thread runs the transport.
    """
    parser = argparse.ArgumentParser(
        prog="policy",
        description="Run a behaviour-tree policy.",
        epilog="example: --endpoint tcp/127.0.0.1:7447 --rate 5 --ticks 100",
    )
    add_transport_options(parser)
    parser.add_argument("--node-name", default="policy")
    parser.add_argument("--rate", type=float, help="ticks a second (default: the system's)")
    parser.add_argument("--ticks", type=int, default=0, help="stop after so many (0: no end)")
    parser.add_argument("--tick-timeout", type=float, default=5.0, help="seconds, for one leaf")
    parsed = parser.parse_args(arguments)
    set_up_logging(parsed.log_level)
    table = msgspec.json.decode((folder / "policy.json").read_bytes(), type=PolicyTable)
    try:
        transport = connect(parsed.transport, parsed.node_name, transport_options(parsed))
    except TransportError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    from m2c.policy.runner import PolicyRunner, PolicySettings

    rate = parsed.rate or table.tick_rate_hz
    settings = PolicySettings(rate, parsed.ticks, parsed.tick_timeout)
    runner = PolicyRunner(transport, table.xml, leaf_services(table), plugins, settings)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: runner.stop())

    def tick() -> None:
        try:
            runner.run()
        finally:
            transport.post(transport.close)

    thread = threading.Thread(target=tick, name="policy")
    transport.announce()
    thread.start()
    transport.spin()
    thread.join()
    transport.close()
    sys.exit(0)
