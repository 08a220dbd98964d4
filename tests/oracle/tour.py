"""An example on virtual time with all its oracles listening: runs for soundness and for faults."""

from __future__ import annotations

import functools
from collections.abc import Callable
from random import Random

import msgspec

from m2c.language.datatypes import Structure
from m2c.model import DiagnosticLog
from m2c.model.machine import InterfaceKind, Machine
from m2c.model.system import System
from m2c.policy.program import read_policy
from m2c.runtime.messages import message_class
from m2c.simulation.program import Program
from m2c.simulation.run import SimulatedRun
from moon.monitor.models import ModelMonitor
from moon.oracle.bounds import Bounds
from moon.policy import PolicyOracle, leaf_places
from moon.verdict import Outcome, Verdict
from tests.mutation.exercise import Values
from tests.systems import LAB_TOUR, compiled
from transports.interface import Observation, Topic
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld

LATENCY_S = 0.2


lab_tour = functools.partial(compiled, LAB_TOUR)
"""The lab tour's models and its imported code."""


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


def policy_oracle(system: System) -> PolicyOracle:
    """The oracle of the policy of ``system``, which is known to start after the monitor."""
    assert system.policy is not None
    policy = read_policy(system.policy, system, DiagnosticLog())
    assert policy is not None
    return PolicyOracle(policy, plugins=system.plugins, places=leaf_places(system))


def watched(
    name: str,
    seed: int,
    seconds: float,
    conditions: Conditions | None = None,
    *,
    policy: bool = False,
    program: Program | None = None,
    intruders: int = 0,
    join_after_s: float = 0.0,
    linked_s: float = 0.0,
    bounds: Bounds | None = None,
    prepare: Callable[[SimulatedWorld], None] | None = None,
    lossy: bool | None = None,
) -> Heard:
    """Run the example ``name`` and judge it live.

    Args:
        name: the example's folder.
        seed: of the world.
        seconds: of virtual time.
        conditions: of the network.
        policy: judge the policy too, which has to be known from its start.
        program: the code to run instead of the nominal one.
        intruders: further nodes that publish on the system's topics at adversarial moments.
        join_after_s: the monitor comes this long after the system.
        linked_s: so long after it came, it is known to hear all nodes.
        bounds: of the oracles.
        prepare: called with the world before anything runs.
        lossy: whether the monitor knows that observations get lost; by default, if they do.
    """
    system, nominal = compiled(name)
    world = SimulatedWorld(seed, conditions)
    if prepare is not None:
        prepare(world)
    if lossy is None:
        lossy = conditions is not None and conditions.tap_loss > 0
    tree = policy_oracle(system) if policy else None
    monitor = ModelMonitor(
        system.nodes,
        system.library,
        bounds,
        synchronised=not join_after_s,
        policy=tree,
    )
    monitor.losses.happen = lossy
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
        for node in monitor.watched:
            monitor.node_started(node, world.now_ns)
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


tour = functools.partial(watched, LAB_TOUR)
"""The same of the lab tour."""


def _intrude(world: SimulatedWorld, system: System, number: int) -> None:
    """A node that publishes what machines compare, within microseconds of what others do."""
    draw = Random(f"{world.seed}/{number}")
    node = SimulatedTransport(world, f"intruder_{number}")
    takers: dict[tuple[str, str], list[Machine]] = {}
    for machine in system.nodes:
        for interface in machine.interfaces:
            if interface.kind is InterfaceKind.SUBSCRIBER and interface.channel:
                takers.setdefault((interface.channel, interface.type_name), []).append(machine)
    senders = [
        _sender(node, channel, system.library.message(type_name), Values(machines, draw))
        for (channel, type_name), machines in sorted(takers.items(), key=lambda item: item[0])
    ]

    def send() -> None:
        draw.choice(senders)()
        # ticks come every 200 ms: mostly close to one, from either side
        rest = 0.2 - (world.now_ns / 1e9) % 0.2
        near = rest + draw.choice([-1, 1]) * draw.random() * draw.choice([1e-6, 1e-4, 1e-2])
        node.after(max(1e-6, near if draw.random() < 0.8 else draw.random() * 0.3), send)

    node.after(draw.random(), send)


def _sender(
    node: SimulatedTransport, channel: str, kind: Structure, values: Values
) -> Callable[[], None]:
    publisher = node.publisher(Topic(channel, kind.name, message_class(kind)))
    return lambda: publisher.publish(values.message(kind))
