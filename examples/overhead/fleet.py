"""Many skills: copies of BatteryLevelSkill, each a node with a tick of its own, and who ticks them in turn.

The nodes are in one process: 200 interpreters would measure the operating system. The rate is that of all
ticks together. The load is a Zenoh router and the nodes are its clients: 200 peers would keep 19,900 links.
"""

from __future__ import annotations

import contextlib
import itertools
import logging
import threading
from pathlib import Path

import msgspec

from benchmarks.processes import ROOT, Child, ChildError, free_endpoint, say, until_ended
from benchmarks.ticking import INTERFACES, answer_orders, spun
from examples.overhead.load import why_failed
from m2c.launch.in_process import compile_node
from m2c.model import DiagnosticLog, load
from m2c.model.system import System
from m2c.runtime.binding import NodeSettings
from m2c.runtime.messages import message_class
from transports.interface import Service
from transports.registry import connect

MODEL = ROOT / "examples/lab_tour/skills/BatteryLevelSkill.scxml"
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


def read_models(folder: str) -> System:
    """The models in ``folder``."""
    logging.basicConfig(level=logging.CRITICAL)
    system = load([Path(folder)], DiagnosticLog(), [INTERFACES])
    assert system is not None
    return system


def host(folder: str, config: str) -> None:
    """Run every model in ``folder`` as a node, until SIGTERM; ``config`` is Zenoh's."""
    system = read_models(folder)
    with contextlib.ExitStack() as stack:
        for machine in system.nodes:
            transport = connect("zenoh", machine.name, {"config": config})
            stack.enter_context(contextlib.closing(transport))
            node = compile_node(machine, system)(transport, NodeSettings())
            transport.post(node.start)
            transport.post(transport.announce)
            threading.Thread(target=transport.spin, daemon=True).start()
        until_ended()


def tick_fleet(folder: str, config: str) -> None:
    """Tick as told until standard input ends."""
    system = read_models(folder)
    kind = system.library.service(TICK_TYPE)
    request, response = message_class(kind.request), message_class(kind.response)
    with contextlib.closing(connect("zenoh", "policy", {"config": config})) as transport:
        say({"listening": True})
        names = [machine.name for machine in system.nodes]
        services = [Service(f"/{name}/tick", kind.name, request, response) for name in names]
        clients = itertools.cycle([transport.client(service) for service in services])
        spun(transport, names, READY_S)
        answer_orders(
            lambda _, watch: watch.time(lambda: next(clients).call_and_wait(request()), why_failed)
        )


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
    child = Child.calling("the load", tick_fleet, str(folder), str(router))
    load = stack.enter_context(child)
    load.answer()
    skills = Child.calling("the skills", host, str(folder), str(clients))
    stack.enter_context(skills).answer(READY_S)
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
