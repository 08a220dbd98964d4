"""A channel that could not be received, as its type was not there: a recording says so, and nobody is accused."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.simulation.run import SimulatedRun
from moon.offline.engine import check_recording
from moon.recording.definitions import Definitions
from moon.recording.recorder import Recorder
from moon.recording.writer import RecordingWriter
from moon.verdict import Outcome
from tests.offline.live import SUBJECT, live_run, monitored, program
from tests.offline.test_same_verdicts import assert_same
from transports.interface import BlindSpot, BlindSpotKind
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld
from transports.simulated.routes import Tap

UNREAD = {
    "a topic": ("/BatteryComponent/level",),
    "a service": ("/BlackboardComponent/SetInt",),
    "ticks": ("/BatteryLevelSkill/tick",),
}


@pytest.mark.parametrize("unread", UNREAD.values(), ids=UNREAD)
def test_a_monitor_accuses_nobody_and_neither_does_its_recording(
    unread: tuple[str, ...], tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    live = live_run(path, program(), 1, 12.0, Conditions(unread=unread))
    assert Outcome.VIOLATED not in {verdict.outcome for verdict in live}
    assert any(f"{unread[0]} is not received" in verdict.reason for verdict in live)
    assert_same(path, live)


def test_who_may_not_take_a_message_is_not_judged_and_neither_by_its_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "run.mcap"
    place = "/BatteryComponent/level", "BatteryLevelSkill"
    unsure = {BlindSpot(BlindSpotKind.MAY_NOT_BE_TAKEN, *place): "messages may be dropped"}
    monkeypatch.setattr(Tap, "blind_spots", lambda self: unsure)
    live = live_run(path, program(), 1, 12.0, Conditions())
    said = {verdict.node for verdict in live if verdict.reason == "messages may be dropped"}
    assert "BatteryLevelSkill" in said
    assert "BatteryComponent" not in said
    assert_same(path, live)


def test_whose_timers_follow_another_clock_is_not_judged_and_neither_by_its_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "run.mcap"
    why = "it has its time from /clock"
    nodes = ("BatteryComponent", "BatteryLevelSkill")
    timed = {BlindSpot(BlindSpotKind.OTHER_TIME, "", node): why for node in nodes}
    monkeypatch.setattr(Tap, "blind_spots", lambda self: timed)
    live = live_run(path, program(), 1, 12.0, Conditions())
    said = {verdict.node for verdict in live if verdict.reason == why}
    assert said == {"BatteryComponent"}  # the skill has no timers
    assert_same(path, live)


@pytest.mark.parametrize("unread", UNREAD.values(), ids=UNREAD)
def test_what_a_recorder_alone_could_not_receive_accuses_nobody(
    unread: tuple[str, ...], tmp_path: Path
) -> None:
    path = tmp_path / "alone.mcap"
    world = SimulatedWorld(1, Conditions(unread=unread))
    writer = RecordingWriter(path, Definitions(monitored().system.library))
    recorder = Recorder(SimulatedTransport(world, "moon_record"), "simulated", writer, (), print)
    recorder.start()
    nodes = SimulatedRun(program(), world)
    for _ in range(12):
        nodes.run(1.0)
        recorder.look_around()
    recorder.finish()
    world.close()
    result = check_recording(path, SUBJECT, monitored())
    assert result.recording.complete
    assert Outcome.VIOLATED not in {said.verdict.outcome for said in result.verdicts}
    assert "inconclusive" in {item.verdict for item in result.machines if item.kind == "model"}
