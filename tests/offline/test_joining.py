"""A recording that began in the middle of a run, when its tap did not hear everything yet."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from msgspec.structs import replace

from m2c.simulation.run import SimulatedRun
from moon.offline.engine import check_recording
from moon.offline.result import CheckResult
from moon.recording.definitions import Definitions
from moon.recording.entries import Began, Entry, NodeChange, Pulse, Whole
from moon.recording.reader import open_recording
from moon.recording.recorder import Recorder
from moon.recording.writer import RecordingWriter
from moon.sources.played import WHOLE_NS
from moon.tap.completeness import AT_MOST_S
from tests.offline.live import SUBJECT, faulty_program, monitored, program
from transports.interface import Observation, ObservationKind, Tap
from transports.simulated import SimulatedTransport, SimulatedWorld
from transports.simulated.routes import Tap as SimulatedTap

pytestmark = pytest.mark.slow

BEFORE_S = 2.0
PARTIAL_S = 1.5
FOUND_S = 2.5
"""All nodes that act once a second are found by then."""
REQUESTS: tuple[ObservationKind, ...] = (
    ObservationKind.REQUEST_SENT,
    ObservationKind.REQUEST_RECEIVED,
)


class Partial(SimulatedTransport):
    """A connection whose tap hears no requests at first; where nothing is numbered, as on ROS 2."""

    drops = REQUESTS

    def __init__(self, world: SimulatedWorld, whole_after_s: float) -> None:
        super().__init__(world, "recorder")
        self.whole_ns = self.now_ns() + round(whole_after_s * 1e9)

    @property
    def hears_everything(self) -> bool:
        return self.now_ns() >= self.whole_ns

    def tap(self, channels: Sequence[str], handler: Callable[[Observation], None]) -> Tap:
        def hear(seen: Observation) -> None:
            if self.hears_everything or seen.kind not in self.drops:
                handler(replace(seen, sequence=-1, order=-1))

        return super().tap(channels, hear)


class WaitsForQuiet(Partial):
    """Hears everything, and knows it late."""

    drops = ()


def recorded(
    path: Path, whole_after_s: float, seconds: float = 5.0, say: Callable[[str], None] = print
) -> Path:
    """The lab tour, recorded from its second second on."""
    world = SimulatedWorld(5)
    nodes = SimulatedRun(program(), world)
    nodes.run(BEFORE_S)
    writer = RecordingWriter(path, Definitions(monitored().system.library))
    recorder = Recorder(Partial(world, whole_after_s), "simulated", writer, (), say)
    recorder.start()
    nodes.run(seconds)
    recorder.finish()
    world.close()
    return path


@pytest.fixture
def knows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Taps know whether they hear everything."""
    monkeypatch.setattr(
        SimulatedTap, "is_complete", property(lambda tap: tap._node.hears_everything)
    )


def checked(path: Path) -> CheckResult:
    return check_recording(path, SUBJECT, monitored())


def accused(result: CheckResult) -> set[str]:
    assert result.recording.complete, result.recording.faults
    seen = [item.machine for item in result.machines if item.verdict == "unseen"]
    assert not seen
    return {item.machine for item in result.machines if item.verdict == "violated"}


def entries(path: Path) -> list[Entry]:
    return [item for item in open_recording(path).entries() if not isinstance(item, Observation)]


def test_what_was_heard_in_part_accuses_nobody(tmp_path: Path, knows: None) -> None:
    said: list[str] = []
    path = recorded(tmp_path / "run.mcap", PARTIAL_S, say=said.append)
    assert said == ["what is recorded from here on is judged in any case"]
    began = entries(path)[0]
    assert isinstance(began, Began)
    assert not began.whole
    (whole,) = (item for item in entries(path) if isinstance(item, Whole))
    assert whole.received_ns - began.received_ns == pytest.approx(PARTIAL_S * 1e9, abs=0.05e9)
    assert list(open_recording(path).entries()).index(whole) > 20, "all is kept"
    assert accused(checked(path)) == set()


def test_it_accuses_nobody_either_where_the_tap_does_not_know(tmp_path: Path) -> None:
    path = recorded(tmp_path / "run.mcap", PARTIAL_S)
    began = entries(path)[0]
    assert isinstance(began, Began)
    assert began.whole
    assert not accused(checked(path))


def test_who_hears_everything_at_once_says_nothing(tmp_path: Path, knows: None) -> None:
    path = recorded(tmp_path / "run.mcap", 0.0, say=pytest.fail)
    assert [type(item) for item in entries(path)[:3]] == [Began, Pulse, NodeChange]
    assert not [item for item in entries(path) if isinstance(item, Whole)]
    assert accused(checked(path)) == set()


def test_from_when_on_it_is_judged_is_said(tmp_path: Path, knows: None) -> None:
    result = checked(recorded(tmp_path / "run.mcap", PARTIAL_S))
    (limit,) = (text for text in result.recording.limits if "judged" in text)
    assert re.fullmatch(
        r"its recorder was connected to all nodes from 1\.5 s on: .* is not judged", limit
    )


def test_a_run_that_is_over_before_is_not_judged(tmp_path: Path, knows: None) -> None:
    result = checked(recorded(tmp_path / "run.mcap", 1000.0))
    assert "violated" not in {item.verdict for item in result.machines}
    assert {item.verdict for item in result.machines} > {"unseen"}, "it is known who was there"
    assert any("nothing is judged" in text for text in result.recording.limits)


def test_where_that_is_damaged_it_is_judged_after_a_while(tmp_path: Path, knows: None) -> None:
    path = recorded(tmp_path / "run.mcap", PARTIAL_S, WHOLE_NS / 1e9 + 5.0)
    whole = tmp_path / "without.mcap"
    writer = RecordingWriter(whole, Definitions(monitored().system.library))
    for entry in open_recording(path).entries():
        if not isinstance(entry, Whole):
            writer.add(entry)
    writer.close()
    result = checked(whole)
    assert any("connected to all nodes from 20.0 s on" in text for text in result.recording.limits)
    assert accused(result) == set()
    assert "conforming" in {item.verdict for item in result.machines}


def test_a_system_that_starts_after_the_recorder_is_judged_from_the_start(
    tmp_path: Path, knows: None
) -> None:
    """Whoever comes up is told as being up once the tap hears it all."""
    path = tmp_path / "run.mcap"
    world = SimulatedWorld(5)
    writer = RecordingWriter(path, Definitions(monitored().system.library))
    recorder = Recorder(WaitsForQuiet(world, 6.0), "simulated", writer, (), print)
    recorder.start()
    world.run_for(0.01)
    SimulatedRun(faulty_program("T1"), world).run(8.0)
    recorder.finish()
    world.close()
    (whole,) = (item for item in entries(path) if isinstance(item, Whole))
    result = checked(path)
    assert not [text for text in result.recording.limits if "judged" in text]
    first = min(
        said.verdict.stamp_ns for said in result.verdicts if said.verdict.outcome == "violated"
    )
    assert first < whole.received_ns


def test_a_graph_that_goes_on_changing_is_not_waited_for_for_ever(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(SimulatedTap, "is_complete", False)
    said: list[str] = []
    path = recorded(tmp_path / "run.mcap", 0.0, AT_MOST_S + 5.0, said.append)
    assert said[0].startswith("warning: the graph goes on changing")
    result = checked(path)
    assert accused(result) == set()
    assert any("goes on changing" in problem for problem in result.problems)


@pytest.mark.parametrize("is_known", [True, False])
def test_after_a_gap_all_are_found_anew(tmp_path: Path, knows: None, is_known: bool) -> None:
    found = list(open_recording(recorded(tmp_path / "run.mcap", 0.0)).entries())
    began = found[0]
    assert isinstance(began, Began)
    path = tmp_path / "gap.mcap"
    writer = RecordingWriter(path, Definitions(monitored().system.library))
    gap_ns = began.received_ns + round(FOUND_S * 1e9)
    missing = [entry for entry in found if gap_ns <= entry.received_ns < gap_ns + 330_000_000]
    assert len(missing) > 10
    for entry in found:
        if entry not in missing:
            writer.add(entry)
        elif entry is missing[-1] and is_known:
            writer.add(replace(began, received_ns=entry.received_ns))
    writer.close()
    assert bool(accused(checked(path))) == (not is_known)
