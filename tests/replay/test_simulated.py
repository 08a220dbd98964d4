"""One node of the lab tour against the recorded rest, in virtual time."""

from __future__ import annotations

from typing import Any, cast

import pytest

from moon.recording.reader import Recording
from moon.replay.replay import Replay
from moon.replay.script import Selected, script_of
from tests.replay.worlds import Received, live, of, tour
from transports.interface import Observation, ObservationKind
from transports.simulated import SimulatedTransport, SimulatedWorld

SECONDS = 12.0


def replayed(
    received: Received,
    without: tuple[str, ...] = (),
    rate: float = 1.0,
    only: tuple[str, ...] = (),
    played: tuple[str, ...] = (),
    seconds: float = 100.0,
) -> tuple[Replay, list[Observation], list[str]]:
    """``received``, replayed beside the nodes in ``without``: the replay, what was received, what it said."""
    world, said = SimulatedWorld(4), []
    now = live(world, *without)
    recording = cast(Recording, received)
    replay = Replay(
        script_of(recording, Selected(only)),
        SimulatedTransport(world, "moon_replay_1"),
        lambda name: SimulatedTransport(world, name),
        lambda name: name not in without and (not played or name in played),
        rate,
        said.append,
    )
    replay.prepare()
    replay.begin(recording)
    assert world.run_until(lambda: replay.finished, seconds)
    world.run_for(1.0)
    return replay, now, said


@pytest.mark.parametrize(
    "skill", ["BatteryLevelSkill", "SetPoi1Skill", "VisitorsFollowingRobotSkill"]
)
def test_a_skill_does_against_the_recording_what_it_did_in_it(skill: str):
    received = tour(SECONDS)
    replay, now, said = replayed(received, (skill,))
    assert said == []
    assert replay.counts.asked > 50
    assert replay.counts.differently == 0
    assert of(now, skill) == of(received.observations, skill)


def test_the_goals_of_a_skill_go_as_they_went():
    received = tour(SECONDS)
    replay, now, _ = replayed(received, ("GoToPoiSkill",))
    parts = (
        "/NavigationComponent/GoToPoi/_action/send_goal",
        "/NavigationComponent/GoToPoi/_action/get_result",
    )

    def goals(observations: list[Observation]) -> list[Any]:
        return [
            seen.data.get("goal") or seen.data.get("result") or seen.data.get("accepted")
            for seen in observations
            if seen.channel in parts
            and seen.source == "NavigationComponent"
            and seen.data.keys() != {"goal_id"}
        ]

    assert goals(now)[:3] == goals(received.observations)[:3]
    assert len(goals(now)) >= 3
    assert replay.counts.equal > 2
    assert "NavigationComponent" in replay.played


def test_a_recorded_client_drives_a_live_action_server():
    received = tour(SECONDS)
    replay, now, _ = replayed(received, ("NavigationComponent",))
    sent = [
        seen.data["goal"]
        for seen in now
        if seen.channel.endswith("send_goal") and seen.kind is ObservationKind.REQUEST_RECEIVED
    ]
    then = [
        seen.data["goal"]
        for seen in received.observations
        if seen.channel.endswith("send_goal") and seen.kind is ObservationKind.REQUEST_RECEIVED
    ]
    assert sent == then
    assert {
        seen.source
        for seen in now
        if seen.channel.endswith("/feedback") and seen.kind is ObservationKind.MESSAGE
    } == {"NavigationComponent"}
    canceled = [seen for seen in now if seen.channel.endswith("cancel_goal")]
    assert bool(canceled) == any(s.channel.endswith("cancel_goal") for s in received.observations)
    assert replay.counts.asked >= len(then)


def levels_in(observations: list[Observation]) -> list[Observation]:
    """The messages that were published, not that they were taken."""
    return [
        seen
        for seen in observations
        if seen.channel == "/BatteryComponent/level" and seen.kind is ObservationKind.MESSAGE
    ]


def test_what_was_published_is_published_by_the_same_nodes_at_the_same_time():
    received = tour(SECONDS)
    _, now, _ = replayed(received, only=("/BatteryComponent/level",))

    def levels(observations: list[Observation]) -> list[tuple[int, str, Any]]:
        first = observations[0].stamp_ns
        return [
            (round((seen.stamp_ns - first) / 1e7), seen.source, seen.data) for seen in observations
        ]

    recorded = levels_in(received.observations)
    published = [s for s in now if s.kind is ObservationKind.MESSAGE]
    assert len(recorded) > 10
    assert levels(published) == levels(recorded)


def test_a_rate_scales_time():
    received = tour(SECONDS)
    _, now, _ = replayed(received, only=("/BatteryComponent/level",), rate=4.0)
    recorded = [seen.stamp_ns for seen in levels_in(received.observations)]
    published = [s.stamp_ns for s in now if s.kind is ObservationKind.MESSAGE]
    assert len(published) == len(recorded)
    ratio = (recorded[-1] - recorded[0]) / (published[-1] - published[0])
    assert ratio == pytest.approx(4.0, rel=0.01)


def test_only_the_nodes_that_are_named_are_played():
    received = tour(SECONDS)
    replay, now, _ = replayed(received, played=("BatteryComponent",))
    assert replay.played == ["BatteryComponent"]
    assert {seen.source for seen in now} == {"BatteryComponent"}


def test_a_request_that_was_not_recorded_gets_the_next_answer_and_it_is_said():
    received = tour(SECONDS)
    changed = [
        seen
        if seen.channel != "/SchedulerComponent/SetPoi" or "poi" not in (seen.data or {})
        else _with_poi(seen, 9)
        for seen in received.observations
    ]
    replay, _, said = replayed(Received(changed), ("SetPoi1Skill",))
    assert replay.counts.other > 0
    assert said[0] == (
        '/SchedulerComponent/SetPoi {"poi":1}: no equal request was recorded: the next recorded response is given'
    )


def test_when_no_answer_is_left_it_is_said_and_the_caller_hears_so():
    received = tour(SECONDS)
    first = next(s for s in received.observations if s.channel == "/SchedulerComponent/SetPoi")
    kept = [
        seen
        for seen in received.observations
        if seen.channel != "/SchedulerComponent/SetPoi" or seen.call == first.call
    ]
    replay, now, said = replayed(Received(kept), ("SetPoi1Skill",))
    assert replay.counts.without > 0
    assert '/SchedulerComponent/SetPoi {"poi":1}: no recorded answer is left' in said
    errors = [s.error for s in now if s.source == "SetPoi1Skill" and s.error]
    assert any("no recorded answer is left" in error for error in errors)


def test_a_request_that_had_no_answer_then_has_none_now():
    """The third answer of the scheduler was not given: the skill that asks waits for it in vain."""
    received = tour(SECONDS)
    channel, answers = "/SchedulerComponent/SetPoi", ObservationKind.RESPONSE_SENT
    calls = [s.call for s in received.observations if s.channel == channel and s.kind is answers]
    missing = calls[2]
    kept = [
        seen
        for seen in received.observations
        if seen.channel != channel
        or seen.call != missing
        or seen.kind in (ObservationKind.REQUEST_SENT, ObservationKind.REQUEST_RECEIVED)
    ]
    replay, now, said = replayed(Received(kept), ("SetPoi1Skill",))
    asked = [
        s.call for s in now if s.channel == channel and s.kind is ObservationKind.REQUEST_RECEIVED
    ]
    answered = {s.call for s in now if s.channel == channel and s.kind is answers}
    assert [call in answered for call in asked[:4]] == [True, True, False, True]
    assert replay.counts.unanswered == 1
    assert "left 1 without a response, as recorded" in replay.summary()
    ended = [s.error for s in now if s.call == asked[2] and s.source == "SetPoi1Skill" and s.error]
    assert [error.partition(":")[0] for error in ended] in (
        [],
        ["timeout"],
    )  # no error of the server's
    assert not any("no recorded answer" in sentence for sentence in said)


def test_who_answered_nobody_then_is_there_and_answers_nobody_now():
    received = tour(SECONDS)
    channel = "/SchedulerComponent/SetPoi"
    answers = (ObservationKind.RESPONSE_SENT, ObservationKind.RESPONSE_RECEIVED)
    kept = [s for s in received.observations if s.channel != channel or s.kind not in answers]
    replay, now, _ = replayed(Received(kept), ("SetPoi1Skill",))
    here = [seen for seen in now if seen.channel == channel]
    assert replay.counts.unanswered == sum(s.kind is ObservationKind.REQUEST_RECEIVED for s in here)
    assert replay.counts.unanswered > 0
    assert not any(seen.kind is ObservationKind.RESPONSE_SENT for seen in here)


def _with_poi(seen: Observation, poi: int) -> Observation:
    import msgspec

    return msgspec.structs.replace(seen, data={"poi": poi})


class SetClock(SimulatedTransport):
    """A connection whose time of day is set after two seconds."""

    step_ns = 0

    def now_ns(self) -> int:
        began_ns = self.__dict__.setdefault("began_ns", super().now_ns())
        is_set = super().now_ns() > began_ns + 2 * 10**9
        return super().now_ns() + (self.step_ns if is_set else 0)


@pytest.mark.parametrize("step_s", [-86_400, -3600, -5, 5, 3600, 86_400])
def test_a_clock_that_is_set_neither_stops_a_replay_nor_hurries_it(step_s: int):
    received = tour(4.0)
    world, now = SimulatedWorld(4), []
    SimulatedTransport(world, "tap").tap([], now.append)
    conductor = SetClock(world, "moon_replay_1")
    conductor.step_ns = step_s * 10**9
    recording = cast(Recording, received)
    replay = Replay(
        script_of(recording, Selected()),
        conductor,
        lambda name: SimulatedTransport(world, name),
        lambda name: True,
        1.0,
        lambda said: None,
    )
    replay.prepare()
    replay.begin(recording)
    began_ns = world.now_ns
    assert world.run_until(lambda: replay.finished, 30.0)
    span_ns = received.observations[-1].stamp_ns - received.observations[0].stamp_ns
    assert abs(world.now_ns - began_ns - span_ns) < 10**9
