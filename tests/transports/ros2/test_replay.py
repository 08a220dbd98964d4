"""``moon replay`` on a live ROS 2 graph: topics are offered as they were when they were recorded."""

from __future__ import annotations

from pathlib import Path

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Int32

from m2c.diagnostics import DiagnosticLog
from m2c.model.interfaces import InterfaceLibrary
from moon.recording.definitions import Definitions
from moon.recording.offers import Offer
from moon.recording.writer import RecordingWriter
from tests.monitor.processes import Process
from tests.transports.ros2.bare import Bare
from transports.interface import Observation, ObservationKind
from transports.networks import ThreadedNetwork

pytestmark = [pytest.mark.ros2, pytest.mark.slow]

TRANSIENT_LOCAL, LOSSY = "/map_version", "/laser_range"
GAP_NS = 20_000_000
MESSAGES = 1500
"""Half a minute: discovery has time to find who listens, and the test ends when enough was heard."""
ENOUGH = 20


def recorded(path: Path) -> None:
    """A transient local topic that had one message, and a best-effort one that had many."""
    offers = {TRANSIENT_LOCAL: Offer(transient_local=True), LOSSY: Offer(best_effort=True)}
    writer = RecordingWriter(
        path, Definitions(InterfaceLibrary.load([], DiagnosticLog())), offers=offers
    )
    for number in range(MESSAGES):
        for channel in (TRANSIENT_LOCAL, LOSSY) if not number else (LOSSY,):
            stamp_ns = 10**18 + number * GAP_NS
            writer.add(
                Observation(
                    stamp_ns=stamp_ns,
                    received_ns=stamp_ns,
                    channel=channel,
                    kind=ObservationKind.MESSAGE,
                    type_name="std_msgs/msg/Int32",
                    data={"data": number + 7},
                    source="robot",
                    sequence=number if channel == LOSSY else 0,
                )
            )
    writer.close()


def test_topics_are_offered_and_heard_in_the_qos_of_then(
    network: ThreadedNetwork, bare: Bare, tmp_path: Path
) -> None:
    recorded(tmp_path / "run.mcap")
    ranges: list[int] = []
    versions: list[int] = []
    best_effort = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    transient_local = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    bare.node.create_subscription(Int32, LOSSY, lambda m: ranges.append(m.data), best_effort)
    replaying = Process("moon", "replay", tmp_path / "run.mcap", "--transport", "ros2", "--stay")
    try:
        assert network.until(lambda: len(ranges) >= ENOUGH), replaying.err
        # who subscribes so late hears the transient local one all the same
        bare.node.create_subscription(
            Int32, TRANSIENT_LOCAL, lambda m: versions.append(m.data), transient_local
        )
        assert network.until(lambda: versions), replaying.err
        for topic, reliability, durability in (
            (TRANSIENT_LOCAL, ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL),
            (LOSSY, ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE),
        ):
            (offered,) = bare.node.get_publishers_info_by_topic(topic)
            assert offered.qos_profile.reliability == reliability
            assert offered.qos_profile.durability == durability
    finally:
        replaying.close()
    assert versions == [7]
    assert ranges == sorted(ranges)
    assert set(ranges) <= set(range(7, 7 + MESSAGES))
