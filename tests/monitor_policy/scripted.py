"""Any tree over the lab tour's leaves, its skills answering at random, watched on virtual time."""

from __future__ import annotations

import functools
import tempfile
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import msgspec

from m2c.model import DiagnosticLog
from m2c.policy.program import Policy, read_policy
from m2c.policy.runner import PolicyRunner
from m2c.runtime.messages import message_class
from moon.policy import PolicyOracle
from moon.verdict import Outcome, Verdict
from tests.oracle.tour import lab_tour
from transports.interface import Observation, Request, Service
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld

CONDITIONS = ("BatteryLevel", "IsPoiDone1", "IsPoiDone2", "VisitorsFollowingRobot")
ACTIONS = ("Alarm", "SetPoi1", "SetPoi2", "Reset", "SetCurrentPoiDone")
HALTED = ("GoToPoi", "Wait")
"""Actions whose skills serve halts."""

Answers = Callable[[str, Random], int | None]
"""The status that a tick service answers; None: it fails the call."""


def at_random(channel: str, draw: Random) -> int | None:
    """Any status; now and then the call fails, or the status is none."""
    if draw.random() < 0.02:
        return draw.choice([None, 7])
    return draw.choice([0, 0, 1, 2])


@functools.cache
def tree(body: str) -> Policy:
    """The policy whose main tree is ``body``, or whose trees it is."""
    trees = body if "<BehaviorTree" in body else f'<BehaviorTree ID="Main">{body}</BehaviorTree>'
    main = trees.partition('ID="')[2].partition('"')[0]
    text = f'<root BTCPP_format="4" main_tree_to_execute="{main}">{trees}</root>'
    log = DiagnosticLog()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "tree.xml"
        path.write_text(text)
        policy = read_policy(path, lab_tour()[0], log)
    assert policy is not None, log.diagnostics
    return policy


def leaf(name: str) -> str:
    """A leaf of the lab tour, as it is written in a policy."""
    kind = "Condition" if name in CONDITIONS else "Action"
    return f'<{kind} ID="{name}" name="{name}" service_name="/{name}Skill/tick"/>'


class Heard(msgspec.Struct):
    """What came of a run."""

    verdicts: list[Verdict]
    observations: list[Observation]
    oracle: PolicyOracle

    @property
    def violations(self) -> list[Verdict]:
        return [v for v in self.verdicts if v.outcome is Outcome.VIOLATED]

    @property
    def reasons(self) -> list[str]:
        return [v.reason for v in self.verdicts]


def run(
    expected: Policy,
    seed: int,
    ticks: int = 60,
    conditions: Conditions | None = None,
    *,
    actual: Policy | None = None,
    answers: Answers = at_random,
    join_after: int = 0,
    runs: int = 1,
    rate_hz: float | None = None,
    plugins: Any = None,
    oracle: PolicyOracle | None = None,
) -> Heard:
    """Run ``actual`` (by default what is expected) and judge it live by ``expected``.

    Args:
        expected: the policy that is monitored.
        seed: of the world and of the answers.
        ticks: of the tree, in each run.
        conditions: of the network.
        actual: the policy that runs.
        answers: of the skills.
        join_after: the monitor comes after so many ticks.
        runs: how often the policy is run to its end, one after the other.
        rate_hz: at which it is ticked, if not at the system's rate.
        plugins: node classes of plugins.
        oracle: to judge by, if not a new one for ``expected``.
    """
    actual = actual or expected
    world = SimulatedWorld(seed, conditions)
    draw = Random(seed)
    server = SimulatedTransport(world, "skills")
    _serve(server, actual, lambda channel: answers(channel, draw))
    server.announce()
    oracle = oracle or PolicyOracle(expected, synchronised=not join_after)
    verdicts: list[Verdict] = []
    observations: list[Observation] = []

    def hear(observation: Observation) -> None:
        observations.append(observation)
        verdicts.extend(oracle.feed(observation))

    def listen() -> None:
        listener = SimulatedTransport(world, "listener")
        listener.tap([], hear)
        listener.every(0.02, lambda: verdicts.extend(oracle.advance(world.now_ns)))
        world.run_for(0.01)

    rate = rate_hz or actual.tick_rate_hz
    for _ in range(runs):
        if oracle.outputs:
            oracle.start(world.now_ns)  # as a monitor does, which hears that it is up again
        transport = SimulatedTransport(world, "policy")
        runner = PolicyRunner(transport, actual, plugins or {}, tick_timeout_s=1.0)
        transport.announce()
        if join_after:
            for _ in range(join_after):
                runner.tick()
                world.run_for(1 / rate)
            join_after = 0
            listen()
        elif not oracle.outputs and not observations:
            listen()
        runner.run(rate, ticks)
        world.run_for(0.5)
        transport.close()
    world.run_for(2.0)
    world.close()
    return Heard(verdicts, observations, oracle)


def _serve(server: SimulatedTransport, policy: Policy, answer: Callable[[str], int | None]) -> None:
    served: set[str] = set()

    def serve(channel: str, kind: str, request: Any, response: Any) -> None:
        if not channel or channel in served or request is None:
            return
        served.add(channel)
        service = Service(channel, kind, message_class(request), message_class(response))

        def handle(asked: Request) -> None:
            status = answer(channel) if channel.endswith("/tick") else 0
            if status is None:
                asked.fail("no")
            elif channel.endswith("/tick"):
                asked.respond(service.response(status=status))
            else:
                asked.respond(service.response())

        server.serve(service, handle)

    for found in policy.leaves:
        serve(found.tick, found.tick_type, found.tick_request, found.tick_response)
        serve(found.halt, found.halt_type, found.halt_request, found.halt_response)
