"""The tour as ``ros2 bag record`` would have kept it: what can be concluded is, and nothing else."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from m2c.model.machine import InterfaceKind
from moon.monitor.subject import Subject, read_subject
from moon.offline.engine import check_recording
from moon.offline.result import CheckResult
from moon.oracle.bounds import Bounds
from moon.recording.reader import open_recording
from tests.offline.live import monitored
from tests.recording import bags
from tests.recordings.make import HERE as GOLDEN
from tests.recordings.make import load
from transports.interface import Observation
from transports.service_events import EVENT_SUFFIX, TYPE_SUFFIX

pytestmark = pytest.mark.slow

TOUR = Path(__file__).parents[2] / "examples" / "lab_tour"
KNOWN = load()
RUN = GOLDEN / "zenoh-T5.mcap"
CASES = [
    (StoragePlugin.MCAP, CompressionMode.NONE),
    (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
]


def checked(path: Path, models: tuple[Path, ...], properties: tuple[Path, ...]) -> CheckResult:
    subject = Subject(models, properties, (), (), (), Bounds())
    return check_recording(path, subject, read_subject(subject))


def services() -> list[tuple[str, str]]:
    """Topic and type of the events of each service: who was there offered them, asked or not."""
    return [
        (f"{interface.channel}{EVENT_SUFFIX}", f"{interface.type_name}{TYPE_SUFFIX}")
        for machine in monitored().system.nodes
        for interface in machine.interfaces
        if interface.kind is InterfaceKind.SERVER
    ]


@pytest.mark.parametrize(("plugin", "mode"), CASES)
def test_a_bag_holds_the_same_messages_and_calls(
    tmp_path: Path, plugin: StoragePlugin, mode: CompressionMode
):
    folder = bags.foreign(RUN, tmp_path / "bag", plugin, mode)
    recording = open_recording(folder)
    assert recording.form == "rosbag2"

    def essence(seen: Observation) -> str:
        return f"{seen.channel} {seen.kind} {seen.type_name} {seen.call} {seen.data}"

    ours = [seen for seen in open_recording(RUN).entries() if isinstance(seen, Observation)]
    theirs = [seen for seen in recording.entries() if isinstance(seen, Observation)]
    assert recording.faults() == []
    in_cdr = [seen for seen in ours if not seen.type_name.startswith(("m2c/", "moon_msgs/"))]
    assert Counter(map(essence, theirs)) == Counter(map(essence, in_cdr))


@pytest.mark.parametrize(("plugin", "mode"), CASES)
def test_the_fault_is_found_where_the_models_leave_one_node_that_can_have_done_it(
    tmp_path: Path, plugin: StoragePlugin, mode: CompressionMode
):
    result = checked(bags.foreign(RUN, tmp_path / "bag", plugin, mode), (TOUR / "system.xml",), ())
    assert {item.machine for item in result.machines if item.violations} == {"BatteryLevelSkill"}
    said = "\n".join(result.recording.limits)
    assert "BatteryLevelSkill, VisitorsFollowingRobotSkill" in said
    assert "what only one node of the models can have sent is attributed to it" in said
    assert (
        "IsPoiDone1Skill is not judged: IsPoiDone1Skill and IsPoiDone2Skill each call "
        "/BlackboardComponent/GetInt, and who did is not known"
    ) in said


@pytest.mark.parametrize("name", sorted(KNOWN))
def test_of_a_bag_nobody_is_blamed_for_what_is_not_recorded(tmp_path: Path, name: str):
    result = checked(bags.foreign(GOLDEN / name, tmp_path / "bag"), (TOUR / "system.xml",), ())
    violated = {item.machine for item in result.machines if item.violations}
    assert violated <= set(KNOWN[name].violated)
    judged = {item.machine for item in result.machines}
    assert "BatteryLevelSkill" in judged
    assert violated == judged & set(KNOWN[name].violated)


@pytest.mark.parametrize(
    "name", ["zenoh-T2.mcap", "zenoh-T3.mcap", "zenoh-T4.mcap", "zenoh-T6.mcap"]
)
def test_properties_find_in_a_bag_what_they_find_in_our_own_recording(tmp_path: Path, name: str):
    properties = (TOUR / "properties.yaml",)
    ours = checked(GOLDEN / name, (), properties)
    bag = bags.foreign(GOLDEN / name, tmp_path / "bag", silent=services())
    theirs = checked(bag, (), properties)
    violated = {item.machine for item in ours.machines if item.violations}
    assert violated
    assert {item.machine for item in theirs.machines if item.violations} == violated


def test_in_a_bag_without_a_service_nothing_is_concluded_of_it(tmp_path: Path):
    bag = bags.foreign(GOLDEN / "zenoh-T6.mcap", tmp_path / "bag")
    found = {item.machine: item for item in checked(bag, (), (TOUR / "properties.yaml",)).machines}
    assert (found["A3"].verdict, found["A3"].violations) == ("inconclusive", 0)
    assert found["A3"].last == "/BlackboardComponent/GetInt: not recorded"


def test_of_a_log_without_types_and_senders_no_model_is_judged(tmp_path: Path):
    path = tmp_path / "log.txt"
    path.write_text(
        '{"service": "/BatteryLevelSkill/tick", "time": 1, "request": {}}\n'
        '{"service": "/BatteryLevelSkill/tick", "time": 9, "response": {"status": 1, "is_ok": true}}\n'
    )
    result = checked(path, (TOUR / "system.xml",), ())
    assert result.violations == 0
    assert result.machines == ()
