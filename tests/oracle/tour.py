"""The lab tour on virtual time with all its oracles listening: runs for soundness and for faults."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import msgspec

from m2c.launch.in_process import Program, SimulatedRun, compile_system
from m2c.model import DiagnosticLog, load
from m2c.model.machine import InterfaceKind
from m2c.model.system import System
from m2c.runtime.messages import message_class
from moon.monitor.models import ModelMonitor
from moon.oracle.bounds import Bounds
from moon.verdict import Outcome, Verdict
from transports.interface import Observation, Topic
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld

SYSTEM = Path(__file__).parents[2] / "examples/lab_tour/system.xml"
LATENCY_S = 0.2


@functools.cache
def lab_tour() -> tuple[System, Program]:
    """The lab tour's models and its imported code."""
    log = DiagnosticLog()
    system = load([SYSTEM], log)
    assert system is not None, log.diagnostics
    return system, compile_system(system)


class Heard(msgspec.Struct):
    """What came of a run."""

    verdicts: list[Verdict]
    monitor: ModelMonitor
    observations: int
    most_hypotheses: int
    world: SimulatedWorld

    @property
    def violations(self) -> list[Verdict]:
        """Only the violations."""
        return [v for v in self.verdicts if v.outcome is Outcome.VIOLATED]


def tour(
    seed: int,
    seconds: float,
    conditions: Conditions | None = None,
    *,
    program: Program | None = None,
    intruders: int = 0,
    join_after_s: float = 0.0,
    linked_s: float = 0.0,
    bounds: Bounds | None = None,
    prepare: Callable[[SimulatedWorld], None] | None = None,
    lossy: bool | None = None,
) -> Heard:
    """Run the lab tour and judge it live.

    Args:
        seed: of the world.
        seconds: of virtual time.
        conditions: of the network.
        program: the code to run instead of the nominal one.
        intruders: further nodes that publish on the tour's topics at adversarial moments.
        join_after_s: the monitor comes this long after the system.
        linked_s: so long after it came, it is known to hear all nodes.
        bounds: of the oracles.
        prepare: called with the world before anything runs.
        lossy: whether the monitor knows that observations get lost; by default, if they do.
    """
    system, nominal = lab_tour()
    world = SimulatedWorld(seed, conditions)
    if prepare is not None:
        prepare(world)
    if lossy is None:
        lossy = conditions is not None and conditions.tap_loss > 0
    monitor = ModelMonitor(
        system.nodes, system.library, bounds, synchronised=not join_after_s, lossy=lossy
    )
    verdicts: list[Verdict] = []
    count = 0
    most = 0

    def hear(observation: Observation) -> None:
        nonlocal count, most
        count += 1
        verdicts.extend(monitor.feed(observation))
        if count % 50 == 0:
            most = max(most, *(len(o.hypotheses) for o in monitor.oracles.values()))

    def listen() -> None:
        listener = SimulatedTransport(world, "listener")
        listener.tap([], hear)
        listener.every(0.02, lambda: verdicts.extend(monitor.advance(world.now_ns)))

    if not join_after_s:
        for oracle in monitor.oracles.values():
            oracle.start(world.now_ns)
        listen()
    run = SimulatedRun(program or nominal, world)
    for number in range(intruders):
        _intrude(world, system, number)
    if join_after_s:
        run.run(join_after_s)
        listen()
        for node in monitor.oracles:
            monitor.node_found(node, world.now_ns + round(linked_s * 1e9))
    run.run(seconds - join_after_s)
    # what is under way may still arrive, while everything goes on as before
    world.close()
    return Heard(verdicts, monitor, count, most, world)


def _intrude(world: SimulatedWorld, system: System, number: int) -> None:
    """A node that publishes random values within microseconds of what others do."""
    draw = Random(f"{world.seed}/{number}")
    node = SimulatedTransport(world, f"intruder_{number}")
    topics = sorted(
        {
            (interface.channel, interface.type_name)
            for machine in system.nodes
            for interface in machine.interfaces
            if interface.kind is InterfaceKind.SUBSCRIBER and interface.channel
        }
    )
    senders: list[tuple[Any, Any]] = []
    for channel, type_name in topics:
        message = message_class(system.library.message(type_name))
        senders.append((node.publisher(Topic(channel, type_name, message)), message))

    def send() -> None:
        publisher, message = draw.choice(senders)
        fields = {
            name: draw.choice([True, False]) if kind.name == "bool" else draw.randrange(101)
            for name, kind in system.library.message(message.__type_name__).fields
            if hasattr(kind, "name")
        }
        publisher.publish(message(**fields))
        # ticks come every 200 ms: mostly close to one, from either side
        rest = 0.2 - (world.now_ns / 1e9) % 0.2
        near = rest + draw.choice([-1, 1]) * draw.random() * draw.choice([1e-6, 1e-4, 1e-2])
        node.after(max(1e-6, near if draw.random() < 0.8 else draw.random() * 0.3), send)

    node.after(draw.random(), send)
