"""How a node waits: it is told of each arrival once, and none is lost."""

from __future__ import annotations

import os
import signal
import threading

import pytest
from rclpy.duration import Duration
from std_msgs.msg import Int32

from tests.transports.ros2.bare import Bare
from transports.networks import ThreadedNetwork
from transports.ros2 import arrivals, connect
from transports.ros2.arrivals import Arrivals


def test_what_came_before_anybody_watched_is_taken(network: ThreadedNetwork, bare: Bare) -> None:
    publisher = bare.node.create_publisher(Int32, "/early", 10)
    late = connect("late", {})
    heard: list[int] = []
    late.ros_node.create_subscription(Int32, "/early", lambda seen: heard.append(seen.data), 10)
    assert network.until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(Int32(data=7))
    assert publisher.wait_for_all_acked(Duration(seconds=10))
    late.after(10.0, lambda: heard.append(0))
    late.spin(lambda: bool(heard))
    late.close()
    assert heard == [7]


def test_what_one_spin_left_the_next_one_takes(network: ThreadedNetwork, bare: Bare) -> None:
    publisher = bare.node.create_publisher(Int32, "/burst", 10)
    twice = connect("twice", {})
    heard: list[int] = []
    twice.ros_node.create_subscription(Int32, "/burst", lambda seen: heard.append(seen.data), 10)
    assert network.until(lambda: publisher.get_subscription_count() == 1)
    for number in range(3):
        publisher.publish(Int32(data=number))
    assert publisher.wait_for_all_acked(Duration(seconds=10))
    for most in (1, 2, 3):
        twice.after(10.0, lambda: heard.append(-1))
        twice.spin(lambda most=most: len(heard) >= most)  # type: ignore[misc]
        assert heard == list(range(most))
    twice.close()


def test_more_topics_than_bells_are_all_heard(
    network: ThreadedNetwork, bare: Bare, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(arrivals, "_MOST_BELLS", 2)
    names = [f"/topic_{number}" for number in range(7)]
    heard: list[str] = []
    network.node("ears").tap(names, lambda seen: heard.append(seen.channel))
    publishers = [bare.node.create_publisher(Int32, name, 10) for name in names]
    assert network.until(lambda: all(p.get_subscription_count() == 1 for p in publishers))
    for publisher in reversed(publishers):
        publisher.publish(Int32(data=1))
    assert network.until(lambda: sorted(heard) == names)


def test_a_signal_ends_a_wait_of_the_main_thread() -> None:
    waiting = Arrivals()
    asked = threading.Event()
    before = signal.signal(signal.SIGUSR1, lambda *_: asked.set())
    sender = threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGUSR1))
    try:
        with waiting.woken_by_signals():
            sender.start()
            assert waiting.wait(-1) == []
        assert asked.is_set()
    finally:
        sender.join()
        signal.signal(signal.SIGUSR1, before)
        waiting.close()
