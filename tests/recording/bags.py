"""Small bags as rosbag2 makes them, written by the rosbags library."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import msgspec
import numpy
from rosbags.interfaces import Nodetype
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from moon.recording.format import Form, form_of
from moon.recording.mcap_file import McapFile
from moon.recording.stored import StoredChannel

T0 = 1_700_000_000_000_000_000
SECOND = 10**9

ADD = "int64 a\nint64 b\n---\nint64 sum\n"
GO = "int32 poi\n---\nbool is_ok\n---\nfloat32 left\n"
INT32 = "int32 data\n"
RULE = "=" * 80 + "\n"

INFO = "service_msgs/msg/ServiceEventInfo"
UUID = "unique_identifier_msgs/msg/UUID"
TIME = "builtin_interfaces/msg/Time"


def _base(name: str) -> Any:
    return (Nodetype.BASE, (name, 0))


def _of(name: str) -> Any:
    return (Nodetype.NAME, name)


def _event_of(service: str) -> Any:
    return (
        [],
        [
            ("info", _of(INFO)),
            ("request", (Nodetype.SEQUENCE, (_of(f"{service}_Request"), 1))),
            ("response", (Nodetype.SEQUENCE, (_of(f"{service}_Response"), 1))),
        ],
    )


STORE = get_typestore(Stores.ROS2_JAZZY)
STORE.register(
    {
        "demo/srv/Add_Request": ([], [("a", _base("int64")), ("b", _base("int64"))]),
        "demo/srv/Add_Response": ([], [("sum", _base("int64"))]),
        "demo/srv/Add_Event": _event_of("demo/srv/Add"),
        "demo/action/Go_Goal": ([], [("poi", _base("int32"))]),
        "demo/action/Go_Result": ([], [("is_ok", _base("bool"))]),
        "demo/action/Go_Feedback": ([], [("left", _base("float32"))]),
        "demo/action/Go_SendGoal_Request": (
            [],
            [("goal_id", _of(UUID)), ("goal", _of("demo/action/Go_Goal"))],
        ),
        "demo/action/Go_SendGoal_Response": (
            [],
            [("accepted", _base("bool")), ("stamp", _of(TIME))],
        ),
        "demo/action/Go_SendGoal_Event": _event_of("demo/action/Go_SendGoal"),
        "demo/action/Go_GetResult_Request": ([], [("goal_id", _of(UUID))]),
        "demo/action/Go_GetResult_Response": (
            [],
            [("status", _base("int8")), ("result", _of("demo/action/Go_Result"))],
        ),
        "demo/action/Go_GetResult_Event": _event_of("demo/action/Go_GetResult"),
        "demo/action/Go_FeedbackMessage": (
            [],
            [("goal_id", _of(UUID)), ("feedback", _of("demo/action/Go_Feedback"))],
        ),
    }
)


def new(type_name: str, *values: Any) -> Any:
    """A message of rosbags."""
    return STORE.types[type_name](*values)


def gid(participant: int, entity: int) -> Any:
    return numpy.array([1, 15] + [participant] * 10 + [0, 0, entity, 4], dtype=numpy.uint8)


def uuid(number: int) -> Any:
    return new(UUID, numpy.array([number] * 16, dtype=numpy.uint8))


def event(service: str, kind: int, at_ns: int, client: Any, call: int, contents: Any) -> Any:
    """A service event; ``kind`` as in ServiceEventInfo; ``contents`` None: metadata only."""
    some = [] if contents is None else [contents]
    info = new(INFO, kind, new(TIME, *divmod(at_ns, SECOND)), client, call)
    return new(f"{service}_Event", info, some if kind < 2 else [], some if kind >= 2 else [])


class Stored(msgspec.Struct, frozen=True):
    """One message to be stored.

    Attributes:
        topic, type_name: where.
        at_ns: when it was received.
        message: of rosbags.
        definition: the text stored with the topic; "": none.
    """

    topic: str
    type_name: str
    at_ns: int
    message: Any
    definition: str = ""


def a_call(service: str, topic: str, at_ns: int, call: int, definition: str) -> list[Stored]:
    """The four events of ``Add``: the client's end names itself by another entity than the server's."""
    asked = new("demo/srv/Add_Request", 2, call)
    answered = new("demo/srv/Add_Response", 2 + call)
    return [
        Stored(
            f"{topic}/_service_event",
            f"{service}_Event",
            at_ns + 1000 * kind,
            event(
                service,
                kind,
                at_ns + 1000 * kind - 500,
                gid(7, 3 if kind in (0, 3) else 4),
                call,
                asked if kind < 2 else answered,
            ),
            definition,
        )
        for kind in range(4)
    ]


def levels(count: int, step_ns: int = SECOND // 10) -> list[Stored]:
    return [
        Stored(
            "/level", "std_msgs/msg/Int32", T0 + n * step_ns, new("std_msgs/msg/Int32", n), INT32
        )
        for n in range(count)
    ]


def write(
    folder: Path,
    stored: list[Stored],
    plugin: StoragePlugin = StoragePlugin.MCAP,
    mode: CompressionMode = CompressionMode.NONE,
) -> Path:
    """A rosbag2 folder with ``stored`` in it, in that order."""
    writer = Writer(folder, version=9, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections: dict[str, Any] = {}
        for item in stored:
            connection = connections.get(item.topic)
            if connection is None:
                connection = connections[item.topic] = writer.add_connection(
                    item.topic, item.type_name, msgdef=item.definition, rihs01="RIHS01_0"
                )
            data = STORE.serialize_cdr(item.message, item.type_name)
            writer.write(connection, item.at_ns, data)
    return folder


def _as_ros2_has_it(channel: StoredChannel) -> bool:
    return form_of(channel.metadata) is Form.OBSERVATION


def foreign(
    recording: Path,
    folder: Path,
    plugin: StoragePlugin = StoragePlugin.MCAP,
    mode: CompressionMode = CompressionMode.NONE,
    silent: Iterable[tuple[str, str]] = (),
) -> Path:
    """What ``ros2 bag record --all`` would have kept of the same run: no names, no numbers.

    Also of the topics (and their types) that were ``silent`` it says that they were recorded.
    """
    with recording.open("rb") as opened:
        kept = list(McapFile(opened, "").messages(_as_ros2_has_it))
    writer = Writer(folder, version=9, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections: dict[str, Any] = {}
        for topic, type_name in silent:
            if topic not in {message.channel.topic for message in kept}:
                writer.add_connection(topic, type_name, msgdef="", rihs01="RIHS01_0")
        for message in kept:
            channel = message.channel
            connection = connections.get(channel.topic)
            if connection is None:
                connection = connections[channel.topic] = writer.add_connection(
                    channel.topic, channel.type_name, msgdef=channel.schema, rihs01="RIHS01_0"
                )
            writer.write(connection, message.received_ns, message.data)
    return folder
