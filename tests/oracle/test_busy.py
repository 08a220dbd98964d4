"""A machine that is never between two steps for long is found in the middle of its run, and judged."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random

import pytest
from msgspec.structs import replace

from m2c.simulation.program import Program, compile_system
from m2c.simulation.run import SimulatedRun
from moon.monitor.subject import Monitored, Subject, read_subject
from moon.oracle.bounds import Bounds
from moon.run import Run
from moon.sources.source import Outputs
from moon.verdict import Outcome, Verdict
from transports.interface import Observation, ObservationKind, Tap
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld

pytestmark = pytest.mark.slow

HEAD = """<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="{name}" initial="s0">
  <ros_topic_publisher name="a" topic="/{name}/a" type="std_msgs/Int32"/>
  <ros_topic_publisher name="b" topic="/{name}/b" type="std_msgs/Int32"/>
  <ros_topic_subscriber name="in" topic="/{other}/a" type="std_msgs/Int32"/>
  <ros_time_rate name="tick" rate_hz="{rate}"/>
  <datamodel><data id="n" type="int32" expr="0"/><data id="m" type="int32" expr="0"/></datamodel>
"""
JOIN_AFTER_S, SECONDS = 2.0, 5.0
SEEDS = range(4)
LAB_TOUR = Path(__file__).parents[2] / "examples" / "lab_tour"
DRIVEN_S = 8.0
"""The first drive of the lab tour, which says something ten times a second, is over then."""


def _publish(name: str, value: str) -> str:
    return (
        f'<ros_topic_publish name="{name}"><field name="data" expr="{value}"/></ros_topic_publish>'
    )


def _model(name: str, other: str, draw: Random, wrong: int = 0) -> str:
    """A machine that publishes at each tick, faster than once a latency bound; ``wrong`` is added to all it says."""
    lines = [HEAD.format(name=name, other=other, rate=draw.choice((7, 10, 18, 40)))]
    states = draw.randint(1, 3)
    for state in range(states):
        values = [draw.choice((f"{state}", "n % 5", "m % 3 + 10", "Math.floor(Math.random() * 7)"))]
        values += [draw.choice((f"{20 + state}", "n % 2"))] * draw.randint(0, 2)
        values = [f"{value} + {wrong}" if wrong else value for value in values]
        body = "".join(_publish(draw.choice("ab"), value) for value in values)
        lines += [
            f'<state id="s{state}">',
            f'<ros_rate_callback name="tick" target="s{(state + 1) % states}">',
            '<assign location="n" expr="(n + 1) % 1000"/>',
            f"{body}</ros_rate_callback>",
            '<ros_topic_callback name="in"><assign location="m" expr="_msg.data"/></ros_topic_callback></state>',
        ]
    return "\n".join([*lines, "</scxml>"])


def _system(folder: Path, seed: int, wrong: int = 0) -> Monitored:
    folder.mkdir()
    draw = Random(seed)
    (folder / "One.scxml").write_text(_model("One", "Two", draw, wrong))
    (folder / "Two.scxml").write_text(_model("Two", "One", draw))
    return read_subject(Subject((folder,), (), (), (), (), Bounds()))


class _Joined:
    """A monitor that joins late; ``plain``: nodes only publish, as those of rclpy, and say nothing of themselves."""

    def __init__(self, subject: Monitored, code: Program, seed: int, plain: bool) -> None:
        self.verdicts: list[Verdict] = []
        draw = Random(f"join {seed}")
        longest_s = draw.choice((0.0001, 0.003, 0.02))
        world = SimulatedWorld(
            seed, Conditions(delay_s=(0.0, longest_s), tap_delay_s=(0.0, longest_s))
        )
        nodes = SimulatedRun(code, world)
        nodes.run(JOIN_AFTER_S + draw.random())
        transport = SimulatedTransport(world, "monitor")
        connection = _Plain(transport) if plain else transport
        self.watch = Run(connection, subject, Outputs([self]))
        self.watch.start(finds_nodes=not plain)
        nodes.run(SECONDS)
        world.close()

    def take(self, verdict: Verdict) -> None:
        self.verdicts.append(verdict)

    @property
    def accused(self) -> set[str]:
        """Who was violated."""
        return {v.machine for v in self.verdicts if v.outcome is Outcome.VIOLATED}

    @property
    def kept_s(self) -> float:
        """Between which stamps of messages it cannot be told which were taken (s)."""
        followed = [h for it in self.watch.oracles().values() for h in it.judge.hypotheses or ()]
        stamps = [fact.stamp for hypothesis in followed for fact in hypothesis.pending]
        return (max(stamps) - min(stamps)) / 1e9 if stamps else 0.0

    @property
    def conforming(self) -> list[str]:
        """Who conforms at the end."""
        oracles = self.watch.oracles().items()
        return [name for name, oracle in oracles if oracle.outcome is Outcome.CONFORMING]


@pytest.mark.parametrize("plain", [False, True])
def test_a_fast_publisher_that_is_joined_late_is_found_and_conforms(
    plain: bool, tmp_path: Path
) -> None:
    found = 0
    for seed in SEEDS:
        subject = _system(tmp_path / str(seed), seed)
        joined = _Joined(subject, compile_system(subject.system), seed, plain)
        assert not joined.accused, f"seed {seed}: {joined.verdicts}"
        assert joined.kept_s < 1.0, f"seed {seed}"
        found += len(joined.conforming)
    assert found >= 2 * len(SEEDS) - 1, "all but those that do the same in two states"


@pytest.mark.parametrize("plain", [False, True])
def test_a_wrong_value_of_it_is_found(plain: bool, tmp_path: Path) -> None:
    found = 0
    for seed in SEEDS:
        subject = _system(tmp_path / f"{seed}", seed)
        wrong = _system(tmp_path / f"{seed} wrong", seed, wrong=100)
        joined = _Joined(subject, compile_system(wrong.system), seed, plain)
        assert joined.accused <= {"One"}, f"seed {seed}: {joined.verdicts}"
        found += len(joined.accused)
    # who takes a topic on which nothing was published yet waits for the first message there
    assert found >= len(SEEDS) * 2 // 3


@pytest.mark.parametrize("joins_s", [1.0, 1.7, 2.4, 3.1])
def test_a_server_that_is_joined_in_the_middle_of_a_goal_is_known_once_that_is_over(
    joins_s: float,
) -> None:
    """However often nothing could be made of the middle of the goal."""
    subject = read_subject(Subject((LAB_TOUR / "system.xml",), (), (), (), (), Bounds()))
    world = SimulatedWorld(1, Conditions(delay_s=(0.0, 0.001), tap_delay_s=(0.0, 0.001)))
    nodes = SimulatedRun(compile_system(subject.system), world)
    nodes.run(joins_s)
    watch = Run(SimulatedTransport(world, "monitor"), subject, Outputs([]))
    watch.start(finds_nodes=True)
    nodes.run(DRIVEN_S + 1.0 - joins_s)
    assert watch.oracles()["NavigationComponent"].outcome is Outcome.CONFORMING
    world.close()


class _Plain:
    """A connection by which nothing is heard but messages, without numbers over all that a node does."""

    def __init__(self, home: SimulatedTransport) -> None:
        self._home = home
        self.repair_s = home.repair_s
        self.now_ns, self.steady_ns = home.now_ns, home.steady_ns
        self.after, self.post = home.after, home.post

    def tap(self, channels: Sequence[str], handler: Callable[[Observation], None]) -> Tap:
        def receive(seen: Observation) -> None:
            if seen.kind is ObservationKind.MESSAGE:
                handler(replace(seen, sequence=-1, order=-1, life=0))

        return self._home.tap(channels, receive)

    def watch_nodes(self, handler: Callable[[str, bool], None]) -> None:
        """Nobody says that it is there."""

    def up_since(self, name: str) -> int:
        return 0
