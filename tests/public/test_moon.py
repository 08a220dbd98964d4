"""``moon.Monitor``, ``check_recording``, ``Recording``, ``PropertySet`` and ``Oracle`` by themselves."""

from __future__ import annotations

import shutil
import threading
from pathlib import Path

import msgspec
import pytest
from click.testing import CliRunner

import m2c
import moon
import transports
from moon.cli import main
from tests.monitor.hand_driven import write_models
from tests.monitor.processes import free_endpoint
from transports import Observation, SimulatedWorld, Topic

ROOT = Path(__file__).parents[2]
TOUR = ROOT / "examples" / "lab_tour"
FAULTY = ROOT / "tests" / "recordings" / "zenoh-T3.mcap"
HIGH = """\
ports:
  level: {topic: /level, field: data}
properties:
  - {id: high, formula: "historically{level >= 30}"}
"""


class Number(msgspec.Struct):
    data: int = 0

    __type_name__ = "std_msgs/msg/Int32"


@pytest.fixture(scope="module")
def tour() -> m2c.System:
    return m2c.read_system(TOUR / "system.xml")


@pytest.fixture(scope="module")
def broken_tour(tmp_path_factory: pytest.TempPathFactory) -> m2c.System:
    """The tour with the paper's fault T3: a skill that answers at random."""
    folder = tmp_path_factory.mktemp("broken") / "tour"
    shutil.copytree(TOUR, folder)
    shutil.copy(
        folder / "faults" / "T3-BatteryLevelSkill.scxml", folder / "skills/BatteryLevelSkill.scxml"
    )
    return m2c.read_system(folder / "system.xml")


def properties_of(tour: m2c.System) -> moon.PropertySet:
    return moon.PropertySet.from_files(TOUR / "properties.yaml", system=tour)


def test_a_monitor_finds_a_node_that_does_not_as_its_model(
    tour: m2c.System, broken_tour: m2c.System
) -> None:
    world = SimulatedWorld(seed=1)
    verdicts: list[moon.Verdict] = []
    monitor = moon.Monitor(world.connect("monitor"), tour, on_verdict=verdicts.append)
    monitor.start()
    world.run_for(0.01)
    run = m2c.simulate(broken_tour, world)
    run.run(30.0)
    wrong = [verdict for verdict in verdicts if verdict.outcome == "violated"]
    assert {verdict.node for verdict in wrong} == {"BatteryLevelSkill"}
    assert monitor.violations >= len(wrong) > 0
    violated = [status.machine for status in monitor.statuses() if status.violations]
    assert violated == ["BatteryLevelSkill"]
    assert monitor.problems() == []


def test_a_monitor_watches_properties_without_models() -> None:
    world = SimulatedWorld(seed=1)
    verdicts: list[moon.Verdict] = []
    properties = moon.PropertySet.from_text(HIGH)
    monitor = moon.Monitor(
        world.connect("monitor"), properties=properties, on_verdict=verdicts.append
    )
    monitor.start()
    world.run_for(0.01)
    robot = world.connect("robot")
    level = robot.publisher(Topic("/level", "std_msgs/msg/Int32", Number))
    robot.announce()
    for charge in (80, 20):
        robot.post(lambda charge=charge: level.publish(Number(charge)))
        world.run_for(1.0)
    assert [str(verdict.outcome) for verdict in verdicts] == ["conforming", "violated"]
    assert monitor.violations == 1
    assert properties.now_ns == -1  # what was given is as it was


@pytest.mark.zenoh
def test_a_monitor_watches_a_live_transport() -> None:
    endpoint = free_endpoint()
    verdicts: list[moon.Verdict] = []
    connection = transports.connect("zenoh", "monitor", {"listen": endpoint})
    robot = transports.connect("zenoh", "robot", {"endpoint": endpoint})
    spinning = threading.Thread(target=robot.spin)
    try:
        monitor = moon.Monitor(
            connection,
            properties=moon.PropertySet.from_text(HIGH),
            on_verdict=verdicts.append,
        )
        monitor.start()
        level = robot.publisher(Topic("/level", "std_msgs/msg/Int32", Number))
        robot.announce()
        robot.every(0.02, lambda: level.publish(Number(20)))
        spinning.start()
        connection.spin(until=lambda: monitor.violations > 0)
    finally:
        robot.close()
        connection.close()
        if spinning.ident is not None:
            spinning.join()
    assert verdicts[-1].machine == "high"
    assert verdicts[-1].outcome == "violated"


def test_nothing_to_monitor_and_times_that_are_none_are_refused(tour: m2c.System) -> None:
    node = SimulatedWorld().connect("monitor")
    with pytest.raises(ValueError, match="give a system, properties, or judges"):
        moon.Monitor(node)
    with pytest.raises(ValueError, match="latency_s is a number of seconds above 0, not -1"):
        moon.Monitor(node, tour, latency_s=-1)
    with pytest.raises(ValueError, match="deadline_s is a number of seconds above 0, not nan"):
        moon.check_recording(FAULTY, tour, deadline_s=float("nan"))


def test_a_system_with_errors_is_refused(tmp_path: Path) -> None:
    model = write_models(tmp_path)
    model.write_text(model.read_text().replace("level &gt; 30 ? 0 : 1", "nobody"))
    system = m2c.read_system(model)
    with pytest.raises(m2c.ModelError, match="nobody"):
        moon.Monitor(SimulatedWorld().connect("monitor"), system)
    with pytest.raises(m2c.ModelError, match="nobody"):
        moon.check_recording(FAULTY, system)


def test_a_recording_is_checked_as_by_the_command(tour: m2c.System, tmp_path: Path) -> None:
    result = moon.check_recording(FAULTY, tour, properties_of(tour))
    log = tmp_path / "log"
    files = [FAULTY, TOUR / "system.xml", "--properties", TOUR / "properties.yaml", "--log", log]
    ran = CliRunner().invoke(main, ["check", *map(str, files)])
    assert ran.exit_code == 1
    logged = [
        (item["machine"], item["outcome"], item["stamp_ns"])
        for item in map(msgspec.json.decode, log.read_text().splitlines())
    ]
    assert [
        (said.verdict.machine, str(said.verdict.outcome), said.verdict.stamp_ns)
        for said in result.verdicts
    ] == logged
    assert [said.verdict.machine for said in result.violated] == ["P1", "BatteryLevelSkill"]
    assert result.properties == (str(TOUR / "properties.yaml"),)


def test_a_property_set_is_used_again_and_again(tour: m2c.System) -> None:
    properties = properties_of(tour)
    first, second = (moon.check_recording(FAULTY, properties=properties) for _ in range(2))
    assert [said.verdict for said in first.verdicts] == [said.verdict for said in second.verdicts]
    assert [said.verdict.machine for said in first.violated] == ["P1"]


def test_what_is_no_recording_is_said(tmp_path: Path, tour: m2c.System) -> None:
    (tmp_path / "run.mcap").write_bytes(b"nonsense")
    for read in (
        lambda path: moon.check_recording(path, tour),
        moon.Recording.open,
    ):
        with pytest.raises(moon.RecordingError, match="is no recording"):
            read(tmp_path / "run.mcap")
        with pytest.raises(moon.RecordingError, match="cannot be read"):
            read(str(tmp_path / "nowhere"))


def test_a_recording_is_read_by_hand(tour: m2c.System) -> None:
    recording = moon.Recording.open(FAULTY, tour.library)
    seen = [entry for entry in recording.entries() if isinstance(entry, Observation)]
    assert recording.contents.count == len(seen) > 0
    assert recording.faults() == []
    assert recording.ended


def test_a_property_set_is_the_same_from_a_file_and_from_its_text(tour: m2c.System) -> None:
    for name in ("properties.yaml", "properties.xml"):
        path = TOUR / name
        read = moon.PropertySet.from_files(str(path), system=tour).properties
        parsed = moon.PropertySet.from_text(path.read_text(), name=str(path), system=tour)
        assert parsed.properties == read
        assert read


def test_what_is_wrong_in_properties_is_an_error_with_its_place(tour: m2c.System) -> None:
    with pytest.raises(m2c.ModelError, match=r"mine:4:\d+: error: "):
        moon.PropertySet.from_text(HIGH.replace("level >= 30", "level >="), name="mine")
    with pytest.raises(m2c.ModelError, match=r"<text>:\d+:\d+: error: .*/level"):
        moon.PropertySet.from_text(HIGH, system=tour)
    assert moon.PropertySet.from_text(HIGH).properties[0].name == "high"


def test_an_oracle_judges_one_machine(tour: m2c.System) -> None:
    machine = tour.node("BatteryLevelSkill")
    assert machine is not None
    for name, expected in (("zenoh-T3.mcap", "violated"), ("zenoh-nominal.mcap", "conforming")):
        oracle = moon.Oracle(machine, library=tour.library)
        for entry in moon.Recording.open(FAULTY.with_name(name), tour.library).entries():
            if isinstance(entry, Observation):
                oracle.feed(entry)
        assert str(oracle.outcome) == expected


def test_a_monitor_that_is_closed_judges_nothing_more(
    tour: m2c.System,
) -> None:
    with SimulatedWorld(seed=1) as world:
        with moon.Monitor(world.connect("monitor"), tour) as monitor:
            monitor.start()
            world.run_for(0.01)
            run = m2c.simulate(tour, world)
            run.run(5.0)
            before = monitor.statuses()
        for node in run.nodes:
            world.nodes[node].close()  # what it owes now is never sent
        world.run_for(20.0)
        assert monitor.statuses() == before
        assert not monitor.violations
    assert not world.nodes


def test_a_recording_that_is_closed_is_read_no_further(tour: m2c.System) -> None:
    with moon.Recording.open("tests/recordings/zenoh-T3.mcap", tour.library) as recording:
        entries = recording.entries()
        next(entries)
    assert list(entries) == []
