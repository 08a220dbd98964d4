"""What a flood of messages does to a node that is slower than it."""

from __future__ import annotations

import logging
import socket
import threading

import msgspec
import pytest

from transports.interface import Topic
from transports.zenoh import connect
from transports.zenoh_link import executor
from transports.zenoh_link.executor import Executor


class Number(msgspec.Struct):
    data: int = 0


FLOOD = Topic("/flood", "std_msgs/msg/Int32", Number)


def drain(running: Executor) -> None:
    """Run all that is waiting."""
    running.post(running.close)
    running.spin()


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executor, "INBOX_MESSAGES", 5)
    monkeypatch.setattr(executor, "INBOX_BYTES", 1000)


def test_messages_that_have_room_are_received_in_order_between_other_work() -> None:
    running = Executor()
    seen: list[object] = []
    inbox = running.inbox("/x", seen.append)
    for number in range(3):
        inbox.offer(number, 1)
        running.post(lambda number=number: seen.append(f"work {number}"))
    drain(running)
    assert seen == [0, "work 0", 1, "work 1", 2, "work 2"]


def test_the_oldest_messages_are_dropped_and_the_burst_is_reported_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.WARNING)
    running = Executor()
    seen: list[int] = []
    inbox = running.inbox("/flood", seen.append)
    for number in range(100):
        inbox.offer(number, 1)
    drain(running)
    assert seen == [95, 96, 97, 98, 99]
    assert [record.getMessage() for record in caplog.records] == [
        "/flood: dropped 95 messages, the oldest: they arrive faster than they are handled"
    ]
    assert inbox.dropped == 95


def test_a_second_burst_is_reported_again(caplog: pytest.LogCaptureFixture) -> None:
    running = Executor()
    seen: list[int] = []
    inbox = running.inbox("/flood", seen.append)
    for _ in range(2):
        for number in range(6):
            inbox.offer(number, 1)
        running.spin(lambda: len(seen) == 5)
        seen.clear()
    assert caplog.text.count("/flood: dropped 1 message, the oldest") == 2


def test_a_flood_that_does_not_end_is_reported_now_and_then(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(executor, "REPORT_PERIOD_NS", 0)
    running = Executor()
    left = 20

    def receive(_: int) -> None:
        nonlocal left
        left -= 1
        for _ in range(2 if left else 0):
            inbox.offer(0, 1)

    inbox = running.inbox("/flood", receive)
    for _ in range(10):
        inbox.offer(0, 1)
    running.spin(lambda: left == 0)
    assert caplog.text.count("/flood: dropped") > 1


def test_large_messages_are_bounded_by_their_size_and_one_is_always_received() -> None:
    running = Executor()
    seen: list[str] = []
    inbox = running.inbox("/image", seen.append)
    for name in ("a", "b", "c"):
        inbox.offer(name, 400)
    inbox.offer("larger than all", 5000)
    inbox.offer("small", 1)
    drain(running)
    assert seen == ["small"]
    assert inbox.dropped == 4


def test_requests_and_responses_are_never_dropped() -> None:
    running = Executor()
    seen: list[int] = []
    inbox = running.inbox("/flood", lambda _: None)
    for number in range(1000):
        inbox.offer(number, 1)
        running.put((seen.append, number))
    drain(running)
    assert seen == list(range(1000))


@pytest.mark.zenoh
def test_on_zenoh_a_flooded_node_keeps_the_newest_messages(
    caplog: pytest.LogCaptureFixture,
) -> None:
    count = 200
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    slow = connect("slow", {"listen": endpoint})
    source = connect("source", {"endpoint": endpoint})
    arrived = threading.Event()
    seen: list[int] = []

    def receive(message: Number) -> None:
        assert arrived.wait(30)  # the first one is handled until all others are there
        seen.append(message.data)
        if message.data == count:
            slow.close()

    slow.subscribe(FLOOD, receive)

    def hear(sample: object) -> None:  # the session's callbacks run in order of arrival
        nonlocal left
        left -= 1
        if left == 0:
            arrived.set()

    left = count
    counter = slow._session.declare_subscriber("flood", hear)
    slow.announce()
    assert source.wait_for_nodes(["slow"], 30) == []
    publisher = source.publisher(FLOOD)
    for number in range(1, count + 1):
        publisher.publish(Number(number))
    slow.spin()
    counter.undeclare()
    source.close()
    assert seen[-5:] == list(range(count - 4, count + 1))
    assert len(seen) < 15
    assert "/flood: dropped 19" in caplog.text
