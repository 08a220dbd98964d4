"""What ``moon explain --recording`` says: what a recording tells of each machine, and what it does not."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from moon.cli import main
from moon.recording.definitions import Definitions
from moon.recording.entries import Began, Ended
from moon.recording.writer import RecordingWriter
from tests.recording import bags
from tests.replay.worlds import LAB_TOUR, Received, lab_tour, tour
from transports.interface import Observation, ObservationKind

SKILL = "BatteryLevelSkill"
TICK = "/BatteryLevelSkill/tick"


@pytest.fixture(scope="module")
def received() -> Received:
    return tour(5.0)


def written(path: Path, observations: list[Observation]) -> Path:
    writer = RecordingWriter(path, Definitions(lab_tour()[0].library))
    writer.add(Began(observations[0].received_ns))
    for seen in observations:
        writer.add(seen)
    writer.add(Ended(observations[-1].received_ns))
    writer.close()
    return path


def explained(recording: Path, *options: str) -> str:
    result = CliRunner().invoke(
        main, ["explain", str(LAB_TOUR), "--recording", str(recording), *options]
    )
    assert result.exit_code == 0, result.output
    return result.output


def test_a_whole_recording_has_nothing_that_cannot_be_judged(tmp_path: Path, received: Received):
    said = explained(written(tmp_path / "run.mcap", received.observations), "--only", SKILL)
    count = sum(
        seen.channel in (TICK, "/BatteryComponent/level")
        and seen.kind is not ObservationKind.MESSAGE_TAKEN
        for seen in received.observations
    )
    assert f"{SKILL}: can be judged ({count} observations)\n" in said
    assert "could not be read" not in said


def test_a_machine_whose_own_end_is_missing_cannot_be_judged(tmp_path: Path, received: Received):
    kept = [seen for seen in received.observations if seen.source != SKILL]
    said = explained(written(tmp_path / "run.mcap", kept), "--only", SKILL)
    assert (
        f"{SKILL}: cannot be judged: nothing that was recorded is known to be from its node" in said
    )
    assert f"{TICK}  only the other end of its calls was recorded, not {SKILL}'s own" in said
    assert f"calls of {TICK} were recorded at the client's end only" in said


def test_a_channel_of_which_nothing_was_recorded_is_named(tmp_path: Path, received: Received):
    kept = [seen for seen in received.observations if seen.channel != "/BatteryComponent/level"]
    said = explained(written(tmp_path / "run.mcap", kept), "--only", SKILL)
    assert f"{SKILL}: can be judged by what there is" in said
    assert "/BatteryComponent/level  no message was recorded" in said
    kept = [seen for seen in received.observations if seen.channel != TICK]
    said = explained(written(tmp_path / "without.mcap", kept), "--only", SKILL)
    assert (
        f"{TICK}  no event of a call was recorded (a bag has them on {TICK}/_service_event)"
        in " ".join(said.split()).replace(f"{TICK} no event", f"{TICK}  no event")
    )


def test_of_a_bag_it_is_said_that_nobody_is_named(tmp_path: Path):
    folder = bags.write(
        tmp_path / "bag",
        [
            bags.Stored(
                "/BatteryComponent/level",
                "std_msgs/msg/Int32",
                bags.T0 + n,
                bags.new("std_msgs/msg/Int32", n),
                bags.INT32,
            )
            for n in range(3)
        ],
    )
    said = explained(folder, "--only", "BatteryComponent", "--only", SKILL)
    assert "rosbag2, 3 observations on 1 channel" in said
    assert "who published the messages on /BatteryComponent/level is not recorded" in said
    assert "events on /BatteryComponent/level have no number" in said
    assert (
        "BatteryComponent: cannot be judged: nothing that was recorded is known to be from its"
        in said
    )
    assert "/BatteryComponent/level  who sent what was recorded is not known" in said
    assert (
        "BatteryComponent is not judged: when it published on /BatteryComponent/level is known to "
        "the latency bound only" in said
    )


def test_it_is_data_for_programs_too(tmp_path: Path, received: Received):
    kept = [
        seen for seen in received.observations if seen.kind is not ObservationKind.RESPONSE_SENT
    ]
    path = written(tmp_path / "run.mcap", kept)
    first, *machines = map(json.loads, explained(path, "--json").splitlines())
    assert (first["path"], first["form"], first["faults"]) == (str(path), "moon recording", [])
    assert first["observations"] == len(kept)
    assert {item["machine"] for item in machines} == {node.name for node in lab_tour()[0].nodes}
    (skill,) = [item for item in machines if item["machine"] == SKILL]
    assert skill["own"]


def test_a_path_that_is_no_recording_ends_with_two(tmp_path: Path):
    (tmp_path / "empty.mcap").write_bytes(b"")
    result = CliRunner().invoke(
        main, ["explain", str(LAB_TOUR), "--recording", str(tmp_path / "empty.mcap")]
    )
    assert result.exit_code == 2
    assert "is empty (0 bytes)" in result.output


def test_by_which_time_a_bag_would_be_judged_is_said_and_can_be_chosen(
    tmp_path: Path, received: Received
):
    bag = bags.foreign(written(tmp_path / "run.mcap", received.observations), tmp_path / "bag")
    said = explained(bag, "--only", SKILL)
    assert "  is judged by its time\n    publish_time, when each message was published" in said
    assert f"{SKILL}: can be judged" in said
    said = explained(bag, "--only", SKILL, "--time", "log")
    assert "  is judged by its time\n    log_time, when each entry was recorded\n" in said
    assert (
        f"{SKILL} is not judged: in which order its node did what it did is known to the latency"
        in said
    )
    arguments = ["explain", str(LAB_TOUR), "--recording", str(bag), "--time", "clock"]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 2
    assert "no time on /clock was recorded; expected --time log or --time publish" in result.output
