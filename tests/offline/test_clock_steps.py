"""The clock of the robot's computer is set while it runs: no false alarm, no hang, and it is found again."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from moon.recording.definitions import Definitions
from moon.recording.recorder import Recorder
from moon.recording.writer import RecordingWriter
from moon.verdict import Outcome
from tests.offline.live import LiveRun, monitored, program
from tests.offline.test_same_verdicts import UNEVEN, assert_same, checked
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld

pytestmark = pytest.mark.slow

NS = 10**9
STEPS_S = [-86_400, -3600, -5, -0.3, 0.3, 5, 3600, 30 * 86_400]
BEFORE_S, AFTER_S = 2.0, 4.0


class SetWorld(SimulatedWorld):
    """A world on one computer whose time of day is set by ``set_ns``; timers do not go by it.

    ``is_hybrid``: stamps never go back (Zenoh's hybrid logical clock, Kulkarni et al. 2014); else they
    do (ROS 2's).
    """

    set_ns = 0
    is_hybrid = False

    def stamp(self) -> int:
        shown = self.now_ns + self.set_ns
        if self.is_hybrid or shown > self._last_stamp_ns - NS // 100:
            shown = max(shown, self._last_stamp_ns + 1)
        self._last_stamp_ns = shown
        return shown


class SetRun(LiveRun):
    """A monitored run in such a world."""

    def __init__(self, path: Path, seed: int, is_hybrid: bool, conditions: Conditions) -> None:
        made: list[SetWorld] = []

        def world(*arguments: object) -> SetWorld:
            made.append(SetWorld(*arguments))
            made[0].is_hybrid = is_hybrid
            return made[0]

        super().__init__(path, program(), seed, conditions, world=world)
        (self.set_world,) = made

    def set_clock(self, step_s: float) -> None:
        self.clock_is_ahead_ns += round(step_s * NS)
        self.set_world.set_ns = self.clock_is_ahead_ns


def outcomes(verdicts) -> set[Outcome]:
    return {verdict.outcome for verdict in verdicts}


@pytest.mark.parametrize("is_hybrid", [False, True])
@pytest.mark.parametrize("step_s", STEPS_S)
def test_a_monitor_blames_nobody_when_the_clock_is_set(
    step_s: float, is_hybrid: bool, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    run = SetRun(path, 3, is_hybrid, UNEVEN)
    run.run(BEFORE_S)
    run.set_clock(step_s)
    run.run(AFTER_S)
    live = run.end()
    assert Outcome.VIOLATED not in outcomes(live), [
        v for v in live if v.outcome is Outcome.VIOLATED
    ]
    assert_same(path, live)


@pytest.mark.parametrize("step_s", STEPS_S)
def test_of_a_recording_nobody_is_blamed_when_the_clock_was_set(
    step_s: float, tmp_path: Path
) -> None:
    run = SetRun(tmp_path / "run.mcap", 3, False, UNEVEN)
    path = tmp_path / "alone.mcap"
    writer = RecordingWriter(path, Definitions(monitored().system.library))

    class Clocked(SimulatedTransport):
        def now_ns(self) -> int:
            return super().now_ns() + run.clock_is_ahead_ns

        def tap(self, channels, handler):
            return super().tap(
                channels, lambda seen: handler(replace(seen, received_ns=self.now_ns()))
            )

    recorder = Recorder(
        Clocked(run.world, "moon_record"),
        "simulated",
        writer,
        (),
        lambda said: None,
        lambda: run.world.now_ns,
    )
    recorder.start()
    for _ in range(round(BEFORE_S / 0.5)):
        run.run(0.5)
        recorder.look_around()
    run.set_clock(step_s)
    for _ in range(round(AFTER_S / 0.5)):
        run.run(0.5)
        recorder.look_around()
    recorder.finish()
    run.end()
    result = checked(path)
    assert result.recording.complete
    assert Outcome.VIOLATED not in outcomes(said.verdict for said in result.verdicts)
