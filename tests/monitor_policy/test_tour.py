"""The lab tour's policy, watched together with its machines; and others that run in its place."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from m2c.model import DiagnosticLog
from m2c.policy.program import Policy, read_policy
from m2c.policy.runner import PolicyRunner
from m2c.simulation.run import SimulatedRun
from moon.monitor.models import ModelMonitor
from moon.oracle.confirmation import UNCONFIRMED
from moon.verdict import Outcome, Verdict
from tests.oracle.tour import lab_tour, policy_oracle
from transports.interface import Observation, ObservationKind
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld

pytestmark = pytest.mark.slow

LATE = Conditions(delay_s=(0.0, 0.02), tap_delay_s=(0.0, 0.15))
SECONDS = 60.0


class Heard(msgspec.Struct):
    """What came of a run."""

    monitor: ModelMonitor
    verdicts: list[Verdict]
    observations: list[Observation]

    @property
    def of_policy(self) -> list[Verdict]:
        return [v for v in self.verdicts if v.node == "policy"]

    def calls(self, channel: str) -> list[int]:
        """Stamps of the policy's calls of ``channel``."""
        sent = ObservationKind.REQUEST_SENT
        return sorted(
            seen.stamp_ns
            for seen in self.observations
            if seen.source == "policy" and seen.channel == channel and seen.kind is sent
        )


def tour(
    seed: int,
    seconds: float = SECONDS,
    conditions: Conditions = LATE,
    policy: Policy | None = None,
    change: Callable[[Observation], Observation | None] = lambda seen: seen,
    rate_hz: float = 0.0,
    stop_after_s: float = 0.0,
) -> Heard:
    """Run the tour under a monitor of its machines and its policy.

    Args:
        seed: of the world.
        seconds: of virtual time.
        conditions: of the network.
        policy: what ticks the skills instead of the tour's own.
        change: what was done instead of what is said, or None.
        rate_hz: at which the tree is ticked, if not at the system's rate.
        stop_after_s: nothing happens any more after this time.
    """
    system, program = lab_tour()
    if policy is not None:
        program = msgspec.structs.replace(program, policy=policy)
    if rate_hz:
        faster = msgspec.structs.replace(program.policy, tick_rate_hz=rate_hz)
        program = msgspec.structs.replace(program, policy=faster)
    world = SimulatedWorld(seed, conditions)
    oracle = policy_oracle(system)
    monitor = ModelMonitor(system.nodes, system.library, policy=oracle)
    verdicts: list[Verdict] = []
    observations: list[Observation] = []
    for name in (*monitor.oracles, "policy"):
        monitor.node_started(name, world.now_ns)

    undone: list[tuple[str, int]] = []

    def hear(seen: Observation) -> None:
        heard = change(seen)
        if heard is None:
            undone.append((seen.source, seen.order))
        else:
            # it did not happen: nobody numbered it
            before = sum(
                item < (seen.source, seen.order) for item in undone if item[0] == seen.source
            )
            heard = msgspec.structs.replace(heard, order=heard.order - before)
            observations.append(heard)
            verdicts.extend(monitor.feed(heard))

    listener = SimulatedTransport(world, "listener")
    listener.tap([], hear)
    listener.every(0.02, lambda: verdicts.extend(monitor.advance(world.now_ns)))
    SimulatedRun(program, world).run(seconds)
    if stop_after_s:
        world.run_for(stop_after_s)
    world.close()
    return Heard(monitor, verdicts, observations)


def policy_with(folder: Path, old: str, new: str) -> Policy:
    """The tour's policy with ``old`` replaced by ``new`` in its file."""
    system, _ = lab_tour()
    assert system.policy is not None
    text = system.policy.read_text()
    assert text.count(old) == 1, old
    path = folder / "policy.xml"
    path.write_text(text.replace(old, new))
    log = DiagnosticLog()
    policy = read_policy(path, system, log)
    assert policy is not None, log.diagnostics
    return policy


@pytest.mark.parametrize("seed", range(3))
def test_the_nominal_tour_raises_no_verdict(seed: int) -> None:
    longest = (0.0001, 0.002, 0.02, 0.099)[seed % 4]
    conditions = Conditions(
        delay_s=(0.0, longest), tap_delay_s=(0.0, longest), busy_s=(0.0, 0.0002 * (seed % 3))
    )
    heard = tour(seed, conditions=conditions)
    assert not heard.verdicts, [v.reason for v in heard.verdicts][:3]
    oracle = heard.monitor.policy
    assert oracle is not None
    assert oracle.outcome is Outcome.CONFORMING
    assert oracle.outputs > 400
    assert oracle.states()


@pytest.mark.parametrize("seed", range(3))
def test_lost_observations_make_the_policy_inconclusive_and_it_is_found_again(seed: int) -> None:
    conditions = Conditions(
        delay_s=(0.0, 0.01), tap_delay_s=(0.0, 0.01), tap_loss=0.002, duplication=0.05
    )
    heard = tour(seed, conditions=conditions)
    said = heard.of_policy
    assert said
    assert {verdict.outcome for verdict in said} == {Outcome.INCONCLUSIVE}
    assert heard.monitor.policy is not None
    assert heard.monitor.policy.outcome is Outcome.CONFORMING


BATTERY = '<ReactiveFallback name="battery">'
ALARM = '      <Action ID="ROS2Action" name="Alarm" service_name="/AlarmSkill/tick"/>\n'
SET_POI_1 = '        <Action ID="ROS2Action" name="SetPoi1" service_name="/SetPoi1Skill/tick"/>\n'
SUB_TREES = '      <SubTree ID="Battery"/>\n      <SubTree ID="PoiScheduler"/>\n'
DONE_1 = (
    '          <Condition ID="ROS2Condition" name="IsPoiDone1" '
    'service_name="/IsPoiDone1Skill/tick"/>\n'
)


def _without_inverter(text: str) -> tuple[str, str]:
    return f"        <Inverter>\n{text}        </Inverter>\n", text


@pytest.mark.parametrize(
    ("change", "expected", "observed"),
    [
        pytest.param(
            (BATTERY, '<ForceSuccess><Sequence name="battery">'),
            "IsPoiDone1",
            "Alarm",
            id="fallback-to-sequence",
        ),
        pytest.param((SET_POI_1, ""), "SetPoi1", "VisitorsFollowingRobot", id="leaf-dropped"),
        pytest.param(
            (SUB_TREES, '      <SubTree ID="PoiScheduler"/>\n      <SubTree ID="Battery"/>\n'),
            "BatteryLevel",
            "IsPoiDone1",
            id="trees-exchanged",
        ),
        pytest.param(_without_inverter(DONE_1), "SetPoi1", "IsPoiDone2", id="inverter-dropped"),
        pytest.param(
            (DONE_1, f"<ForceSuccess>{DONE_1}</ForceSuccess>"),
            "SetPoi1",
            "IsPoiDone2",
            id="answer-ignored",
        ),
        pytest.param(
            ('service_name="/SetPoi1Skill/tick"', 'service_name="/SetPoi2Skill/tick"'),
            "SetPoi1",
            "SetPoi2",
            id="wrong-leaf",
        ),
    ],
)
@pytest.mark.parametrize("seed", range(2))
def test_another_tree_in_its_place_is_noticed_at_the_first_wrong_tick(
    change: tuple[str, str], expected: str, observed: str, seed: int, tmp_path: Path
) -> None:
    old, new = change
    if "ForceSuccess><Sequence" in new:
        whole = lab_tour()[0].policy
        assert whole is not None
        end = '    </ReactiveFallback>\n  </BehaviorTree>\n\n  <BehaviorTree ID="PoiScheduler">'
        body = whole.read_text().partition(BATTERY)[2].partition(end)[0]
        old, new = BATTERY + body + end[:23], new + body + "    </Sequence></ForceSuccess>"
    heard = tour(seed, 10.0, policy=policy_with(tmp_path, old, new))
    first = heard.of_policy[0]
    assert first.outcome is Outcome.VIOLATED
    assert first.stamp_ns == heard.calls(f"/{observed}Skill/tick")[0]
    assert first.reason == (
        f"expected tick {expected} (/{expected}Skill/tick), "
        f"observed tick {observed} (/{observed}Skill/tick)"
    )
    system, _ = lab_tour()
    assert system.policy is not None
    lines = system.policy.read_text().splitlines()
    assert first.explanation is not None
    (place,) = first.explanation.places
    file, line, _ = place.rsplit(":", 2)
    assert Path(file).name == "policy.xml"
    assert f'name="{expected}"' in lines[int(line) - 1]
    if expected != "BatteryLevel":
        assert "answer" in first.explanation.evidence[-1].text


def test_a_tick_that_is_left_out_is_noticed_at_the_next_one(tmp_path: Path) -> None:
    """From some moment on, nothing is heard of one leaf, as if the policy did not tick it."""
    moment: list[int] = []

    def without_battery_level(seen: Observation) -> Observation | None:
        if seen.channel != "/BatteryLevelSkill/tick":
            return seen
        if not moment and seen.sequence > 100 and seen.kind is ObservationKind.REQUEST_SENT:
            moment.append(seen.stamp_ns)
        return None if moment and seen.stamp_ns >= moment[0] else seen

    heard = tour(1, 60.0, Conditions(), change=without_battery_level)
    first = heard.of_policy[0]
    assert first.outcome is Outcome.VIOLATED
    assert first.reason.startswith("expected tick BatteryLevel")
    assert first.stamp_ns == min(
        seen.stamp_ns
        for seen in heard.observations
        if seen.source == "policy"
        and seen.kind is ObservationKind.REQUEST_SENT
        and seen.stamp_ns > moment[0]
    )


def test_a_call_before_the_answer_to_the_last_one_is_a_violation() -> None:
    """The answer to one tick is stamped and numbered as if it had come after the next tick."""
    late: list[Observation] = []

    def answered_late(seen: Observation) -> Observation:
        answer = seen.kind is ObservationKind.RESPONSE_RECEIVED
        if seen.channel == "/BatteryLevelSkill/tick" and answer and seen.call > 100 and not late:
            late.append(seen)
            return msgspec.structs.replace(
                seen, stamp_ns=seen.stamp_ns + 1_000_000, order=seen.order + 1
            )
        if late and seen.source == "policy" and seen.order == late[0].order + 1:
            return msgspec.structs.replace(seen, order=seen.order - 1)
        return seen

    heard = tour(1, 20.0, Conditions(), change=answered_late)
    outcomes = [verdict.outcome for verdict in heard.of_policy]
    assert outcomes == [Outcome.INCONCLUSIVE, Outcome.VIOLATED], [v.reason for v in heard.of_policy]
    assert heard.of_policy[1].reason.startswith("expected the answer on /BatteryLevelSkill/tick")
    assert heard.monitor.policy is not None
    assert heard.monitor.policy.outcome is Outcome.CONFORMING


@pytest.mark.parametrize("seed", range(3))
def test_a_tree_that_is_ticked_too_fast_is_noticed(seed: int) -> None:
    heard = tour(seed, 10.0, Conditions(), rate_hz=5.2)
    first = heard.of_policy[0]
    assert first.outcome is Outcome.VIOLATED
    assert "before the next tick of the tree is due" in first.reason


def test_a_tree_that_is_ticked_more_slowly_is_not_blamed() -> None:
    assert not tour(1, 30.0, rate_hz=2.0).of_policy


def test_a_policy_that_stops_in_the_middle_of_a_tick_is_unresponsive(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What its transport would send after some moment is never heard: it hangs."""
    limit: list[int] = []

    def hung(seen: Observation) -> Observation | None:
        answer = seen.kind is ObservationKind.RESPONSE_RECEIVED
        if seen.channel == "/BatteryLevelSkill/tick" and answer and seen.call > 100 and not limit:
            limit.append(seen.stamp_ns)
        return None if limit and seen.stamp_ns > limit[0] else seen

    heard = tour(1, 20.0, Conditions(), change=hung)
    reasons = [v.reason for v in heard.of_policy]
    assert reasons == [
        f"{UNCONFIRMED}unresponsive: "
        "expected tick IsPoiDone1 (/IsPoiDone1Skill/tick), observed nothing"
    ]


def test_the_policy_runner_ends_with_halts_and_that_is_no_violation() -> None:
    system, program = lab_tour()
    assert program.policy is not None
    world = SimulatedWorld(3, LATE)
    oracle = policy_oracle(system)
    verdicts: list[Verdict] = []
    seen: list[Observation] = []

    def hear(observation: Observation) -> None:
        seen.append(observation)
        verdicts.extend(oracle.feed(observation))

    SimulatedTransport(world, "listener").tap([], hear)
    run = SimulatedRun(msgspec.structs.replace(program, policy=None), world)
    runner = PolicyRunner(SimulatedTransport(world, "policy"), program.policy)
    runner.run(program.policy.tick_rate_hz, 20)
    run.run(2.0)
    world.close()
    verdicts += oracle.advance(world.now_ns + 10**10)
    assert any(found.channel.endswith("/halt") for found in seen)
    assert not verdicts
