"""Properties over a simulated network: deadlines to the nanosecond, orders that delays blur."""

from __future__ import annotations

import random
from collections.abc import Sequence

import msgspec
import pytest

from moon.properties.monitor import PropertySet
from moon.properties.ordering import OrderedProperties
from moon.properties.property import Port, Property, Status, Verdict
from moon.properties.syntax import parse_formula
from tests.properties.differential import random_formula
from transports.interface import Observation, Topic
from transports.simulated.conditions import Conditions
from transports.simulated.world import START_NS, SimulatedTransport, SimulatedWorld

MS = 1_000_000
LATENCY = 50 * MS
SECOND = 1000 * MS


class Value(msgspec.Struct):
    v: bool

    __type_name__ = "t/msg/Value"


def topic(name: str) -> Topic:
    return Topic(f"/{name}", "t/msg/Value", Value)


def state(name: str) -> Port:
    return Port(name, f"/{name}", path=("v",), initial=False)


def event(name: str) -> Port:
    return Port(name, f"/{name}", event=True)


@pytest.fixture
def world():
    made = SimulatedWorld(seed=1, conditions=Conditions((0, 0), (0, 0)))
    yield made
    made.close()


def test_a_response_that_never_comes_is_reported_at_exactly_its_deadline(world):
    source = "historically(not((not {answered}) since[2s:] {asked}))"
    item = Property("f", parse_formula(source), (event("asked"), event("answered")))
    monitors = PropertySet([item])
    tap, node = SimulatedTransport(world, "monitor"), SimulatedTransport(world, "node")
    said: list[tuple[int, Verdict]] = []

    def take(changes: Sequence[tuple[str, Verdict]]) -> None:
        said.extend((tap.now_ns(), verdict) for _, verdict in changes)
        if (due := monitors.next_deadline()) is not None:
            tap.after(max(0, due - tap.now_ns()) / 1e9, lambda: take(monitors.advance(due)))

    tap.tap([], lambda seen: take(monitors.observe(seen)))
    publisher = node.publisher(topic("asked"))
    node.after(0.3, lambda: publisher.publish(Value(True)))
    world.run_for(5)
    (violation,) = [(at, verdict) for at, verdict in said if verdict.status is Status.FALSE]
    at, verdict = violation
    assert at == verdict.since_ns == START_NS + 300 * MS + 2 * SECOND


class Run:
    """Two nodes that publish at random, received late by a tap."""

    def __init__(self, seed: int) -> None:
        choice = random.Random(seed)
        self.formula = random_formula(choice, choice.randint(1, 3), longest=4)
        for old, new in (("{n > 2}", "{p}"), ("{n <= 1}", "not {q}")):
            self.formula = self.formula.replace(old, new)
        ports = (state("p"), state("q"), event("r"))
        self.item = Property("f", parse_formula(self.formula, ticks_per_unit=MS), ports)
        self.true: list[Observation] = []
        """What happened, at its true time."""
        self.received: list[tuple[int, Observation]] = []
        """The same, and when it was received."""
        conditions = Conditions((0, 0), (0.0, LATENCY / 1e9))
        self.world = SimulatedWorld(seed, conditions)
        tap = SimulatedTransport(self.world, "monitor")

        def hear(seen: Observation) -> None:
            self.true.append(seen)
            self.received.append((tap.now_ns(), seen))

        tap.tap([], hear)
        for name in "ab":
            node = SimulatedTransport(self.world, name)
            publishers = [node.publisher(topic(letter)) for letter in "pqr"]
            for _ in range(choice.randint(1, 4)):
                message = Value(choice.random() < 0.5)
                publish = choice.choice(publishers).publish
                node.after(choice.randint(1, 12) / 1e3, lambda p=publish, m=message: p(m))
        self.world.run_for(0.2)
        self.world.close()
        self.end_ns = START_NS + 100 * MS

    def truth(self) -> tuple[Status, bool]:
        """The verdict at the end, and whether the property was false at any moment."""
        monitors = PropertySet([self.item])
        changes = list(monitors.advance(START_NS))
        for seen in sorted(self.true, key=lambda seen: seen.stamp_ns):
            changes += monitors.observe(seen)
        changes += monitors.advance(self.end_ns)
        broken = any(verdict.status is Status.FALSE for _, verdict in changes)
        return monitors.verdicts()["f"].status, broken

    def judged(self) -> tuple[Status, set[Status]]:
        """The verdict at the end, and all that were said, of what was received as it was received."""
        ordered = OrderedProperties([self.item], LATENCY)
        said = list(ordered.advance(START_NS + LATENCY))
        for now, seen in self.received:
            said += ordered.advance(now)
            ordered.observe(seen)
        said += ordered.advance(self.end_ns + LATENCY)
        return ordered.verdicts()["f"].status, {verdict.status for _, verdict in said}


@pytest.mark.parametrize("seed", range(150))
def test_delays_change_no_verdict(seed):
    run = Run(seed)
    assert [now for now, _ in run.received] != sorted(seen.stamp_ns for seen in run.true)
    status, broken = run.truth()
    final, said = run.judged()
    assert final is status
    assert (Status.FALSE in said) == broken
