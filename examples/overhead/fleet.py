"""Many skills: copies of BatteryLevelSkill, each a node with a tick of its own, and who ticks them.

``python -m examples.overhead.fleet host FOLDER`` runs the nodes (many in one process: 200 interpreters would
measure the operating system), ``load`` ticks them in turn; the rate is that of all ticks together.
On Zenoh the load is a router and the nodes are its clients: 200 peers would keep 19,900 links.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import logging
import signal
import sys
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import msgspec

from benchmarks.processes import ROOT as REPOSITORY
from benchmarks.processes import Child, ChildError, free_endpoint
from examples.overhead.load import (
    ROOT,
    Order,
    Stopwatch,
    Taken,
    answer_orders,
    carried_out,
    why_failed,
)
from m2c.launch.in_process import compile_node
from m2c.model import DiagnosticLog, load
from m2c.model.system import System
from m2c.runtime.binding import NodeSettings
from m2c.runtime.messages import message_class
from transports.interface import Service, Transport
from transports.registry import connect

MODEL = REPOSITORY / "examples/lab_tour/skills/BatteryLevelSkill.scxml"
INTERFACES = REPOSITORY / "examples/lab_tour/interfaces"
TICK_TYPE = "bt_interfaces/srv/TickCondition"
READY_S = 300.0
"""200 nodes take 20 s to come up on two idle cores, and minutes beside others' work."""


def name_of(number: int) -> str:
    """Of one copy."""
    return f"BatteryLevelSkill{number}"


def write_models(folder: Path, count: int) -> None:
    """One model a copy; each has channels of its own."""
    text = MODEL.read_text(encoding="utf-8")
    for number in range(count):
        own = text.replace("BatteryLevelSkill", name_of(number))
        own = own.replace("/BatteryComponent/", f"/BatteryComponent{number}/")
        (folder / f"{name_of(number)}.scxml").write_text(own, encoding="utf-8")


def read_models(folder: Path) -> System:
    """The models in ``folder``."""
    system = load([folder], DiagnosticLog(), [INTERFACES])
    assert system is not None
    return system


def host(folder: Path, options: dict[str, str]) -> None:
    """Run every model in ``folder`` as a node, until SIGTERM."""
    system = read_models(folder)
    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    transports: list[Transport] = []
    try:
        for machine in system.nodes:
            transport = connect("zenoh", machine.name, options)
            transports.append(transport)
            node = compile_node(machine, system)(transport, NodeSettings())
            transport.post(node.start)
            transport.post(transport.announce)
            threading.Thread(target=transport.spin, daemon=True).start()
        print('{"ready": true}', flush=True)
        ended.wait()
    finally:
        for transport in transports:
            transport.close()


def tick_fleet(folder: Path, options: dict[str, str]) -> int:
    """Tick as told until standard input ends."""
    system = read_models(folder)
    kind = system.library.service(TICK_TYPE)
    request, response = message_class(kind.request), message_class(kind.response)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    transport = connect("zenoh", "policy", options)
    print("listening", flush=True)
    threading.Thread(target=transport.spin, daemon=True).start()
    try:
        names = [machine.name for machine in system.nodes]
        clients = [
            transport.client(Service(f"/{name}/tick", kind.name, request, response))
            for name in names
        ]
        transport.announce()
        missing = transport.wait_for_nodes(names, READY_S)
        if missing:
            print(f"not up: {', '.join(missing)}", file=sys.stderr)
            return 2

        def carry_out(order: Order) -> Taken:
            turns = itertools.cycle(clients)

            def tick(watch: Stopwatch) -> None:
                called = time.perf_counter_ns()
                result = next(turns).call_and_wait(request())
                watch.note(ROOT, (time.perf_counter_ns() - called) / 1e3, why_failed(result))

            return carried_out(order, tick)

        answer_orders(carry_out)
    finally:
        transport.close()
    return 0


def start(stack: contextlib.ExitStack, scratch: Path, count: int) -> tuple[Path, Path, Child]:
    """Running skills: their models, the configuration of Zenoh's clients, who ticks them."""
    folder = scratch / "models"
    folder.mkdir()
    write_models(folder, count)
    meeting = free_endpoint()
    router, clients = scratch / "router.json5", scratch / "clients.json5"
    router.write_bytes(msgspec.json.encode({"mode": "router", "listen": {"endpoints": [meeting]}}))
    clients.write_bytes(
        msgspec.json.encode({"mode": "client", "connect": {"endpoints": [meeting]}})
    )
    command = ["-m", "examples.overhead.fleet"]
    load = stack.enter_context(
        Child("the load", [*command, "load", str(folder), "--zenoh-config", str(router)])
    )
    load.wait_for(lambda line: "listening" in line)
    skills = stack.enter_context(
        Child("the skills", [*command, "host", str(folder), "--zenoh-config", str(clients)])
    )
    skills.answer(READY_S)
    load.answer(READY_S)
    return folder, clients, load


def monitor(folder: Path, clients: Path, count: int) -> Child:
    """``moon monitor`` of all of them, linked to all of them."""
    arguments = ["monitor", str(folder), "--interfaces", str(INTERFACES), "--json"]
    child = Child("moon monitor", ["-m", "moon.cli", *arguments, "--zenoh-config", str(clients)])
    try:
        child.wait_for(lambda line: line.startswith(f"linked to {count + 1} nodes"), READY_S)
    except ChildError:
        child.stop()
        raise
    return child


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Many skills, and who ticks them.")
    commands = parser.add_subparsers(dest="command", required=True)
    for name in ("host", "load"):
        command = commands.add_parser(name)
        command.add_argument("folder", type=Path, help="of the models")
        command.add_argument("--zenoh-config", default="")
    chosen = parser.parse_args(arguments)
    logging.basicConfig(level=logging.CRITICAL)
    options = {"config": chosen.zenoh_config} if chosen.zenoh_config else {}
    if chosen.command == "load":
        return tick_fleet(chosen.folder, options)
    host(chosen.folder, options)
    return 0


if __name__ == "__main__":
    sys.exit(main())
