"""What publishers offered is kept in recordings, and read from those of others."""

from __future__ import annotations

from pathlib import Path

import pytest
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.metadata import parse_qos

from m2c.model.interfaces import InterfaceLibrary
from moon.recording.definitions import Definitions
from moon.recording.offers import Offer, declared, offer_of, text_of
from moon.recording.reader import open_recording
from moon.recording.writer import RecordingWriter
from moon.replay.types import topic
from tests.recording.bags import INT32, STORE, T0, new
from tests.replay.worlds import lab_tour
from transports.interface import Observation, ObservationKind, Reliability

INT = "std_msgs/msg/Int32"
NEVER = QosTime(9223372036, 854775807)


def profile(reliability: QosReliability, durability: QosDurability) -> Qos:
    return Qos(
        QosHistory.KEEP_LAST,
        10,
        reliability,
        durability,
        NEVER,
        NEVER,
        QosLiveliness.AUTOMATIC,
        NEVER,
        avoid_ros_namespace_conventions=False,
    )


def bag(folder: Path, plugin: StoragePlugin, version: int, qos: list[Qos]) -> Path:
    with Writer(folder, version=version, storage_plugin=plugin) as writer:  # type: ignore[arg-type]
        connection = writer.add_connection(
            "/level", INT, msgdef=INT32, rihs01="RIHS01_0", offered_qos_profiles=qos
        )
        writer.write(connection, T0, STORE.serialize_cdr(new(INT, 1), INT))
    return folder


@pytest.mark.parametrize(
    ("plugin", "version"),
    [(StoragePlugin.MCAP, 9), (StoragePlugin.SQLITE3, 9), (StoragePlugin.SQLITE3, 8)],
)
def test_a_bag_is_replayed_with_the_qualities_that_its_publishers_offered(
    plugin: StoragePlugin, version: int, tmp_path: Path
) -> None:
    offered = profile(QosReliability.BEST_EFFORT, QosDurability.TRANSIENT_LOCAL)
    recording = open_recording(bag(tmp_path / "bag", plugin, version, [offered]))
    assert len(list(recording.entries())) == 1
    assert recording.offer("/level") == Offer(best_effort=True, transient_local=True)
    found = topic(recording, "/level", INT)
    assert found.reliability is Reliability.BEST_EFFORT
    assert found.transient_local


def test_a_topic_that_one_of_two_offered_reliably_is_reliable(tmp_path: Path) -> None:
    offered = [
        profile(QosReliability.BEST_EFFORT, QosDurability.VOLATILE),
        profile(QosReliability.RELIABLE, QosDurability.VOLATILE),
    ]
    recording = open_recording(bag(tmp_path / "bag", StoragePlugin.MCAP, 9, offered))
    list(recording.entries())
    assert recording.offer("/level") == Offer()
    assert (recording.publishers("/level"), recording.publishers("/other")) == (2, 0)


@pytest.mark.parametrize(
    ("text", "offer"),
    [
        ("", Offer()),
        ("- reliability: 2\n  durability: 1\n", Offer(best_effort=True, transient_local=True)),
        ("- reliability: 1\n  durability: 2\n", Offer()),
        ("- reliability: &a best_effort", Offer()),
        ("- [[[", Offer()),
        ("reliability: best_effort", Offer()),
        ("- reliability: {a: b}\n", Offer()),
    ],
)
def test_profiles_in_numbers_are_read_and_what_is_no_profile_offers_the_usual(
    text: str, offer: Offer
) -> None:
    assert offer_of([text]) == offer


@pytest.mark.parametrize("offer", [Offer(best_effort=True), Offer(transient_local=True)])
def test_what_models_declare_is_recorded_so_that_others_read_it_too(
    offer: Offer, tmp_path: Path
) -> None:
    library: InterfaceLibrary = lab_tour()[0].library
    path = tmp_path / "run.mcap"
    writer = RecordingWriter(path, Definitions(library), offers={"/level": offer})
    for channel in ("/level", "/other"):
        writer.add(
            Observation(
                stamp_ns=T0,
                received_ns=T0,
                channel=channel,
                kind=ObservationKind.MESSAGE,
                type_name=INT,
                data={"data": 1},
                source="node",
                sequence=0,
            )
        )
    writer.close()
    recording = open_recording(path)
    list(recording.entries())
    assert recording.offer("/level") == offer
    assert recording.offer("/other") == Offer()
    (as_rosbags_reads_it,) = parse_qos(text_of(offer))
    assert (as_rosbags_reads_it.reliability is QosReliability.BEST_EFFORT) == offer.best_effort
    assert (
        as_rosbags_reads_it.durability is QosDurability.TRANSIENT_LOCAL
    ) == offer.transient_local


def test_models_that_declare_nothing_have_nothing_to_record() -> None:
    assert declared(lab_tour()[0].nodes) == {}
