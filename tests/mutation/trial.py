"""One mutant on trial: it runs in the original's place, and the original's oracle listens."""

from __future__ import annotations

from enum import StrEnum

import msgspec

from m2c.model.machine import Machine
from m2c.model.system import System
from m2c.simulation.program import NodeClass, Program
from m2c.simulation.run import SimulatedRun
from moon.feed.asking import Asking, Silences
from moon.oracle.oracle import Oracle
from moon.verdict import Outcome, Verdict
from tests.mutation.exercise import answerers, callers
from transports.interface import Answer, Observation
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld

CONDITIONS = Conditions(delay_s=(0.0, 0.002), tap_delay_s=(0.0, 0.002))
"""A local network."""

_PERIOD_S = 0.02


class Scene(StrEnum):
    """What a mutant runs among."""

    SYSTEM = "the system"
    """The nominal system, the policy ticking."""
    CALLED = "the system, and further callers"
    """The same, and nodes that call the machine's services, send goals and publish."""
    ALONE = "among moody partners"
    """The machine's node, callers, and a node that answers what it asks in every way."""


SCENES = tuple(Scene)


class Trial(msgspec.Struct):
    """What came of it.

    Attributes:
        verdict: the violation, if there was one.
        after_s: virtual seconds until then, or that were run.
        said: what the node did, in order.
        inconclusive: how often the oracle lost the thread.
    """

    verdict: Verdict | None
    after_s: float
    said: list[Observation]
    inconclusive: int = 0


def trial(
    system: System,
    program: Program,
    machine: Machine,
    node: NodeClass,
    scene: Scene,
    seconds: float,
    seed: int,
) -> Trial:
    """Run ``node`` in the place of ``machine``'s until the oracle of ``machine`` is violated.

    As ``moon monitor`` does, a node that is silent when something is due is asked whether that is all.

    Args:
        system: the models.
        program: their code.
        machine: the original.
        node: the code of the mutant.
        scene: what it runs among.
        seconds: of virtual time, at most.
        seed: of the world.
    """
    world = SimulatedWorld(seed, CONDITIONS)
    oracle = Oracle(machine, system.library, machine.name)
    found: list[Verdict] = []
    lost = 0
    said: list[Observation] = []

    def take(verdicts: list[Verdict]) -> None:
        nonlocal lost
        for verdict in verdicts:
            if verdict.outcome is Outcome.VIOLATED:
                found.append(verdict)
            else:
                lost += 1

    def hear(observation: Observation) -> None:
        if observation.source == machine.name:
            said.append(observation)
        if (
            oracle.channels.concerns(observation.channel, observation.source, observation.kind)
            or observation.source == machine.name
        ):
            take(oracle.feed(observation))

    def answered(_: str, answer: Answer, asked_ns: int) -> None:
        take(oracle.reported(answer.next_order, answer.stamp_ns, world.now_ns))

    silences = Silences()

    def advance() -> None:
        take(oracle.advance(world.now_ns))
        for node in silences.look([(machine.name, oracle.silent_ns)], world.now_ns):
            asking.ask(tap, node)

    listener = SimulatedTransport(world, "listener")
    tap = listener.tap([], hear)
    asking = Asking(answered, lambda: world.now_ns)
    listener.every(_PERIOD_S, advance)
    oracle.start(world.now_ns)
    began_ns = world.now_ns
    if scene is Scene.ALONE:
        run = SimulatedRun(Program({machine.name: node}, {}, None), world)
        callers(world, machine, system.library)
        answerers(world, machine, system.library)
    else:
        run = SimulatedRun(program.replacing(machine.name, node), world)
        if scene is Scene.CALLED:
            callers(world, machine, system.library)
    asking.ask(tap, machine.name)  # whether it reports what it takes
    passed = 0.0
    while passed < seconds and not found:
        run.run(min(1.0, seconds - passed))
        passed = (world.now_ns - began_ns) / 1e9
    world.close()
    return Trial(found[0] if found else None, passed, said, lost)
