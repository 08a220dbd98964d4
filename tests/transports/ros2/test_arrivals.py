"""How a node waits: it is told of each arrival once, and none is lost."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Sequence
from functools import partial
from typing import Any

import pytest
from rclpy.duration import Duration
from std_msgs.msg import Int32

from tests.transports.ros2.bare import Bare
from transports.conformance import DOUBLE, on, ready
from transports.conformance.stage import Answer, Ask
from transports.interface import CallOutcome, CallResult
from transports.networks import PATIENCE_S, ThreadedNetwork
from transports.ros2 import arrivals, connect
from transports.ros2.executor import arrivals_of

pytestmark = [pytest.mark.ros2, pytest.mark.usefixtures("way")]


def test_what_tells_a_node_is_what_works_here(
    bare: Bare, way: type, monkeypatch: pytest.MonkeyPatch
) -> None:
    from transports.ros2 import native
    from transports.ros2.wait_set import WaitSetArrivals

    def chosen() -> type:
        made = arrivals_of(bare.node)
        made.close()
        made.close()
        return type(made)

    assert chosen() is way
    monkeypatch.setattr(native.functions(), "on_new", {})  # as of an older rcl
    assert chosen() is WaitSetArrivals


class Late:
    """A node that has not spun yet, and to which ``numbers`` were sent already."""

    def __init__(self, network: ThreadedNetwork, bare: Bare, numbers: Sequence[int]) -> None:
        publisher = bare.node.create_publisher(Int32, "/early", 10)
        self.node = connect("late", {})
        self.heard: list[int] = []
        self.node.ros_node.create_subscription(
            Int32, "/early", lambda seen: self.heard.append(seen.data), 10
        )
        assert network.until(lambda: publisher.get_subscription_count() == 1)
        for number in numbers:
            publisher.publish(Int32(data=number))
        assert publisher.wait_for_all_acked(Duration(seconds=10))

    def spin_until(self, count: int) -> None:
        """Until so many were heard; after 10 s one is made up, so that the test fails."""
        self.node.after(10.0, lambda: self.heard.append(-1))
        self.node.spin(lambda: len(self.heard) >= count)


def test_what_came_before_anybody_watched_is_taken(network: ThreadedNetwork, bare: Bare) -> None:
    late = Late(network, bare, [7])
    late.spin_until(1)
    late.node.close()
    assert late.heard == [7]


def test_what_one_spin_left_the_next_one_takes(network: ThreadedNetwork, bare: Bare) -> None:
    late = Late(network, bare, range(3))
    for most in (1, 2, 3):
        late.spin_until(most)
        assert late.heard == list(range(most))
    late.node.close()


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


def test_a_signal_ends_a_wait_of_the_main_thread(bare: Bare) -> None:
    waiting = arrivals_of(bare.node)
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


def test_a_pause_ends_when_it_is_over_or_somebody_rings(bare: Bare) -> None:
    waiting = arrivals_of(bare.node)
    ringer = threading.Timer(1.0, waiting.ring)
    try:
        waiting.ring()
        assert waiting.wait(-1) == []  # what rang before is no reason not to pause
        began = time.monotonic()
        waiting.pause(0.02)
        assert time.monotonic() - began >= 0.02
        ringer.start()
        waiting.pause(30.0)
        assert time.monotonic() - began < 15
        assert waiting.wait(-1) == []  # and the ring is not lost
    finally:
        ringer.join()
        waiting.close()


def test_what_taps_hear_without_a_pause_is_gathered_and_all_heard(
    network: ThreadedNetwork, bare: Bare, way: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    pauses: list[float] = []
    pause = way.pause
    monkeypatch.setattr(way, "pause", lambda own, s: (pauses.append(s), pause(own, s)))
    node = network.node("listener")
    heard: list[int] = []
    on(network, node, lambda: node.tap(["/many"], lambda seen: heard.append(seen.data["data"])))
    publisher = bare.node.create_publisher(Int32, "/many", 1000)
    assert network.until(lambda: publisher.get_subscription_count() == 1)
    deadline, count = time.monotonic() + PATIENCE_S, 0
    while count < 500 or not (pauses or time.monotonic() > deadline):
        publisher.publish(Int32(data=count))
        count += 1
        time.sleep(0.0005)  # the rate is what is tested
    assert network.until(lambda: len(heard) == count)
    assert heard == list(range(count))
    assert pauses


def test_an_answer_behind_somebody_elses_is_taken(network: ThreadedNetwork) -> None:
    """All clients of a service have one topic for its answers, and rmw drops what is for others: as if nothing
    had been there.
    """
    server, busy, other = (network.node(name) for name in ("server", "busy", "other"))
    on(network, server, lambda: server.serve(DOUBLE, lambda r: r.respond(Answer(2 * r.data.value))))
    clients = {node: on(network, node, partial(node.client, DOUBLE)) for node in (busy, other)}
    ready(network, server, busy, other)
    results: list[CallResult] = []

    def call_between_two_of_the_other() -> None:
        """On the busy node's thread, which takes none of the answers meanwhile."""
        for is_mine in (False, True, False):
            if is_mine:
                clients[busy].call(Ask(21), results.append, 5.0)
            else:
                assert clients[other].call_and_wait(Ask(1)).outcome is CallOutcome.RESPONSE

    for _ in range(3):
        results.clear()
        on(network, busy, call_between_two_of_the_other)
        assert network.until(lambda: bool(results))
        assert results[0].outcome is CallOutcome.RESPONSE
        assert results[0].response.value == 42
