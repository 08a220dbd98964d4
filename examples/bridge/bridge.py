"""A bridge between two transports: what nodes on one side give and nodes on the other take crosses it.

``python examples/bridge/bridge.py SYSTEM PLACEMENT [--endpoint E] [--timeout S]``; it runs until Ctrl-C.
"""

from __future__ import annotations

import argparse
import logging
import sys
import threading
from collections.abc import Iterable, Mapping
from pathlib import Path

from forward import forward_action, forward_service, forward_topic
from routes import PlacementError, Route, read_placement, routes

from transports.interface import Connection, Service, Topic

NAME = "bridge"


def build(found: Iterable[Route], sides: Mapping[str, Connection]) -> None:
    """Declare the bridge's ends of every route on both sides."""
    for route in found:
        given, taken, channel = sides[route.given], sides[route.taken], route.channel
        if isinstance(channel, Topic):
            forward_topic(channel, given, taken)
        elif isinstance(channel, Service):
            forward_service(channel, given, taken)
        else:
            forward_action(channel, given, taken)
    for transport in sides.values():
        transport.announce()


def options_of(transport: str, endpoint: str, listens: bool = False) -> dict[str, str]:
    """Options for ``transports.registry.connect``: only Zenoh has a meeting point."""
    if transport != "zenoh" or not endpoint:
        return {}
    return {"listen" if listens else "endpoint": endpoint}


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Bridge a system that runs on two transports.")
    parser.add_argument("system", type=Path, help="the system file")
    parser.add_argument("placement", type=Path, help="which node is on which transport (YAML)")
    parser.add_argument("--endpoint", default="tcp/127.0.0.1:7447", help="Zenoh: where nodes meet")
    arguments = parser.parse_args()
    logging.basicConfig(level=logging.WARNING, stream=sys.stderr)
    from m2c.model import ModelError
    from moon.monitor.reading import read_checked
    from transports.interface import TransportError
    from transports.registry import connect
    from transports.stop_signals import StopSignals

    sides: dict[str, Connection] = {}
    signals = StopSignals()
    try:
        system = read_checked([arguments.system])
        placement = read_placement(arguments.placement, system)
        found = routes(system, placement)
        for name in placement.sides:
            sides[name] = connect(name, NAME, options_of(name, arguments.endpoint))
        home, other = sides.values()
        build(found, sides)
        signals.call(lambda: home.post(home.close))
        thread = threading.Thread(target=_spin_beside, args=(other, home))
        thread.start()
        print(f"bridging {len(found)} channels between {' and '.join(sides)}", flush=True)
        home.spin()
    except (ModelError, PlacementError, TransportError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    finally:
        for side in sides.values():
            side.close()
    return 0 if signals.asked else 1


def _spin_beside(other: Connection, home: Connection) -> None:
    """Run ``other``; a bridge with one end is none, so ``home`` ends with it."""
    try:
        other.spin()
    finally:
        home.post(home.close)


if __name__ == "__main__":
    sys.exit(main())
