"""Bags that rosbag2 recorded are read as a tap would have received what is in them."""

from __future__ import annotations

from pathlib import Path

import pytest
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from m2c.diagnostics import DiagnosticLog
from m2c.model.interfaces import InterfaceLibrary
from moon.recording.reader import open_recording
from tests.recording import bags
from tests.recording.bags import SECOND, T0, Stored, new
from transports.interface import Observation, ObservationKind

SRV = f"{bags.RULE}SRV: demo/srv/Add\n{bags.ADD}"
EVENT = (
    "service_msgs/ServiceEventInfo info\n"
    "demo/srv/Add_Request[<=1] request\ndemo/srv/Add_Response[<=1] response\n"
    f"{bags.RULE}MSG: demo/srv/Add_Request\nint64 a\nint64 b\n"
    f"{bags.RULE}MSG: demo/srv/Add_Response\nint64 sum\n"
    f"{bags.RULE}MSG: service_msgs/ServiceEventInfo\n"
    "uint8 REQUEST_SENT = 0\nuint8 event_type\nbuiltin_interfaces/Time stamp\n"
    "char[16] client_gid\nint64 sequence_number\n"
    f"{bags.RULE}MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
)


def read(path: Path, library: InterfaceLibrary | None = None) -> list[Observation]:
    recording = open_recording(path, library)
    seen = list(recording.entries())
    assert recording.faults() == []
    return seen


@pytest.mark.parametrize("plugin", list(StoragePlugin))
@pytest.mark.parametrize("mode", list(CompressionMode))
def test_every_storage_and_compression_is_read(
    tmp_path: Path, plugin: StoragePlugin, mode: CompressionMode
):
    if (plugin, mode) == (StoragePlugin.SQLITE3, CompressionMode.STORAGE):
        mode = CompressionMode.FILE  # SQLite has no compression of its own
    folder = bags.write(tmp_path / "bag", bags.levels(50), plugin, mode)
    seen = read(folder)
    assert [item.data for item in seen] == [{"data": n} for n in range(50)]
    assert seen[3] == Observation(
        stamp_ns=T0 + 3 * SECOND // 10,
        received_ns=T0 + 3 * SECOND // 10,
        channel="/level",
        kind=ObservationKind.MESSAGE,
        type_name="std_msgs/msg/Int32",
        data={"data": 3},
        source="",
    )


@pytest.mark.parametrize("definition", [SRV, EVENT], ids=["service's text", "event's text"])
def test_service_events_become_the_four_observations_of_a_call(tmp_path: Path, definition: str):
    stored = bags.a_call("demo/srv/Add", "/add", T0, 5, definition)
    seen = read(bags.write(tmp_path / "bag", stored))
    assert [item.kind for item in seen] == [
        ObservationKind.REQUEST_SENT,
        ObservationKind.REQUEST_RECEIVED,
        ObservationKind.RESPONSE_SENT,
        ObservationKind.RESPONSE_RECEIVED,
    ]
    assert {(item.channel, item.client, item.call) for item in seen} == {("/add", "client-1", 5)}
    assert [item.source for item in seen] == ["client-1", "", "", "client-1"]
    assert [item.data for item in seen] == [{"a": 2, "b": 5}] * 2 + [{"sum": 7}] * 2
    assert seen[1].type_name == "demo/srv/Add_Request"
    assert seen[2].type_name == "demo/srv/Add_Response"
    assert seen[2].stamp_ns == T0 + 1500
    assert seen[2].received_ns == T0 + 2000


def test_events_without_a_definition_are_read_with_the_models_interfaces(tmp_path: Path):
    (tmp_path / "demo" / "srv").mkdir(parents=True)
    (tmp_path / "demo" / "srv" / "Add.srv").write_text(bags.ADD)
    library = InterfaceLibrary.load([tmp_path], DiagnosticLog())
    folder = bags.write(tmp_path / "bag", bags.a_call("demo/srv/Add", "/add", T0, 1, ""))
    assert [item.data for item in read(folder, library)][2] == {"sum": 3}


def test_a_type_that_nothing_defines_is_said_and_the_rest_is_read(tmp_path: Path):
    stored = bags.a_call("demo/srv/Add", "/add", T0, 1, "") + bags.levels(2)
    recording = open_recording(bags.write(tmp_path / "bag", stored))
    assert [item.channel for item in recording.entries()] == ["/level"] * 2
    assert recording.faults() == [
        "/add/_service_event is not read: demo/srv/Add_Request: the recording does not define it, "
        "nor do the models' interfaces"
    ]


def test_the_parts_of_an_action_are_read_by_the_actions_definition(tmp_path: Path):
    text = f"{bags.RULE}ACTION: demo/action/Go\n{bags.GO}"
    goal = new("demo/action/Go_SendGoal_Request", bags.uuid(9), new("demo/action/Go_Goal", 2))
    feedback = new(
        "demo/action/Go_FeedbackMessage", bags.uuid(9), new("demo/action/Go_Feedback", 0.5)
    )
    result = new("demo/action/Go_GetResult_Response", 4, new("demo/action/Go_Result", True))
    base, part = "/go/_action", "demo/action/Go"
    info = new("action_msgs/msg/GoalInfo", bags.uuid(9), new(bags.TIME, 3, 4))
    status = new("action_msgs/msg/GoalStatusArray", [new("action_msgs/msg/GoalStatus", info, 2)])
    seen = read(
        bags.write(
            tmp_path / "bag",
            [
                Stored(
                    f"{base}/send_goal/_service_event",
                    f"{part}_SendGoal_Event",
                    T0,
                    bags.event(f"{part}_SendGoal", 1, T0, bags.gid(1, 1), 1, goal),
                    text,
                ),
                Stored(f"{base}/feedback", f"{part}_FeedbackMessage", T0 + 1, feedback, text),
                Stored(f"{base}/status", "action_msgs/msg/GoalStatusArray", T0 + 2, status),
                Stored(
                    f"{base}/get_result/_service_event",
                    f"{part}_GetResult_Event",
                    T0 + 3,
                    bags.event(f"{part}_GetResult", 2, T0, bags.gid(1, 1), 2, result),
                    text,
                ),
            ],
        )
    )
    assert [(item.channel, item.type_name) for item in seen] == [
        ("/go/_action/send_goal", "demo/action/Go_SendGoal_Request"),
        ("/go/_action/feedback", "demo/action/Go_FeedbackMessage"),
        ("/go/_action/status", "action_msgs/msg/GoalStatusArray"),
        ("/go/_action/get_result", "demo/action/Go_GetResult_Response"),
    ]
    assert seen[0].data == {"goal_id": {"uuid": [9] * 16}, "goal": {"poi": 2}}
    assert seen[1].data == {"goal_id": {"uuid": [9] * 16}, "feedback": {"left": 0.5}}
    assert seen[2].data["status_list"][0]["status"] == 2
    assert seen[3].data == {"status": 4, "result": {"is_ok": True}}


def test_what_is_not_wanted_is_not_decoded(tmp_path: Path):
    broken = Stored("/broken", "nobody/msg/Knows", T0, new("std_msgs/msg/Int32", 1))
    bags.STORE.types.setdefault("nobody/msg/Knows", bags.STORE.types["std_msgs/msg/Int32"])
    bags.STORE.fielddefs.setdefault("nobody/msg/Knows", bags.STORE.fielddefs["std_msgs/msg/Int32"])
    recording = open_recording(bags.write(tmp_path / "bag", [broken, *bags.levels(2)]))
    assert len(list(recording.entries(lambda channel: channel == "/level"))) == 2
    assert recording.faults() == []


def test_one_file_of_a_bag_is_read_without_its_folder(tmp_path: Path):
    for plugin in StoragePlugin:
        folder = bags.write(tmp_path / plugin.name, bags.levels(3), plugin)
        (file,) = [path for path in folder.iterdir() if path.suffix in (".mcap", ".db3")]
        assert len(read(file)) == 3


def test_a_folder_without_metadata_is_read_in_the_order_of_its_files(tmp_path: Path):
    for number in (2, 10):
        part = bags.write(tmp_path / f"part_{number}", bags.levels(2, number))
        (tmp_path / "bag").mkdir(exist_ok=True)
        (part / f"part_{number}.mcap").rename(tmp_path / "bag" / f"run_{number}.mcap")
    recording = open_recording(tmp_path / "bag")
    assert [item.stamp_ns - T0 for item in recording.entries()] == [0, 2, 0, 10]
    (said,) = recording.faults()
    assert "metadata.yaml: is missing" in said


def test_messages_a_little_out_of_order_are_put_in_order(tmp_path: Path):
    stored = bags.levels(20)
    mixed = [item for pair in zip(stored[1::2], stored[::2], strict=True) for item in pair]
    assert [item.data["data"] for item in read(bags.write(tmp_path / "bag", mixed))] == list(
        range(20)
    )


def test_calls_of_two_clients_with_one_number_are_told_apart(tmp_path: Path):
    stored = [
        Stored(
            "/add/_service_event",
            "demo/srv/Add_Event",
            T0 + who,
            bags.event(
                "demo/srv/Add", 1, T0, bags.gid(who, 1), 1, new("demo/srv/Add_Request", 1, who)
            ),
            SRV,
        )
        for who in (3, 5)
    ]
    assert [item.client for item in read(bags.write(tmp_path / "bag", stored))] == [
        "client-1",
        "client-2",
    ]


def test_what_cannot_be_concluded_is_said(tmp_path: Path):
    stored = bags.levels(2) + bags.a_call("demo/srv/Add", "/add", T0, 1, SRV)[:1]
    hollow = bags.event("demo/srv/Add", 1, T0, bags.gid(1, 1), 1, None)
    stored.append(Stored("/bare/_service_event", "demo/srv/Add_Event", T0, hollow, SRV))
    recording = open_recording(bags.write(tmp_path / "bag", stored, StoragePlugin.SQLITE3))
    list(recording.entries())
    said = "\n".join(recording.limits())
    assert "who published the messages on /level is not recorded" in said
    assert "events on /add, /bare, /level have no number" in said
    assert "who called /add is not recorded" in said
    assert "who served /bare is not recorded" in said
    assert "calls of /add were recorded at the client's end only" in said
    assert "calls of /bare were recorded at the server's end only" in said
    assert "the events of /bare carry no contents" in said
    assert "stamped when they were recorded, not when they were published" in said
