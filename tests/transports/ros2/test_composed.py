"""Several nodes of a process in one rclpy context: each is known for what it does."""

from __future__ import annotations

import logging
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from tests.transports import ros2_composed_peer as peer
from tests.transports.ros2.bare import Bare
from transports.conformance import DOUBLE, NUMBERS, Answer, Number, Text, calls, on
from transports.interface import (
    CallOutcome,
    Connection,
    Observation,
    ObservationKind,
    Request,
    Topic,
    TransportError,
)
from transports.networks import PATIENCE_S, ThreadedNetwork, spinning

pytestmark = pytest.mark.ros2

ROOT = Path(__file__).parents[3]
LEASES = 3
"""As often as PATIENCE_S, in which DDS has given up who was killed."""
KINDS = ObservationKind


def spinning_beside(owner: Connection, name: str) -> Any:
    """A node beside ``owner``, on a thread of its name; it ends with its owner."""
    node = owner.beside(name)
    threading.Thread(target=node.spin, name=name).start()
    return node


@contextmanager
def owner_with(arguments: str) -> Iterator[Any]:
    """A node with ROS arguments, on a thread of its own."""
    from transports.ros2 import connect

    owner = connect("owner", {"args": arguments})
    with spinning(owner):
        yield owner


@contextmanager
def processes() -> Iterator[list[subprocess.Popen[str]]]:
    """Both processes of the peer, which end as their input does."""
    started = [
        subprocess.Popen(
            [sys.executable, "-m", "tests.transports.ros2_composed_peer", name],
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for name in peer.PROCESSES
    ]
    try:
        yield started
    finally:
        for process in started:
            process.send_signal(signal.SIGCONT)
            try:
                process.communicate(timeout=PATIENCE_S)
            finally:
                process.kill()
            assert process.returncode == 0


def tell(process: subprocess.Popen[str], word: str) -> None:
    assert process.stdin is not None
    process.stdin.write(f"{word}\n")
    process.stdin.flush()


def heard_from(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


def of(heard: list[Observation], end: str) -> list[Observation]:
    """Those of channels whose names end so."""
    return [seen for seen in heard if seen.channel.endswith(end)]


def are_all(count: int, heard: list[Observation], end: str) -> bool:
    return len(of(heard, end)) == count


def right_source_and_client(seen: Observation, callers: dict[tuple[str, str, int], str]) -> Any:
    """Source and client as they must be, by what the observation contains; ``callers``: of each call."""
    process, _, part = seen.channel.removeprefix("/").partition("/")
    server = f"{process}_server"
    call = (seen.channel, seen.client, seen.call)
    if seen.channel == NUMBERS.name:
        return seen.data["text"], ""
    if seen.kind is KINDS.MESSAGE:  # feedback, status
        return server, ""
    if seen.kind in (KINDS.REQUEST_SENT, KINDS.REQUEST_RECEIVED):
        if part == "double":
            callers[call] = peer.caller_of(seen.data["value"])
        elif part.endswith("send_goal"):
            callers[call] = seen.data["goal"]["text"]
    elif seen.data is not None and part == "double":
        assert peer.caller_of(seen.data["value"] // 2) == callers.get(call, seen.client)
    elif seen.data is not None and part.endswith("get_result"):
        assert seen.data["result"]["text"] == seen.client
    caller = callers.get(call, seen.client)
    is_client = seen.kind in (KINDS.REQUEST_SENT, KINDS.RESPONSE_RECEIVED)
    return caller if is_client else server, caller


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_tap_knows_who_did_what_in_processes_of_several_nodes(network: ThreadedNetwork) -> None:
    tapper = network.node(peer.TAPPER)
    heard: list[Observation] = []
    changes: list[tuple[str, bool]] = []
    on(network, tapper, lambda: tapper.watch_nodes(lambda *change: changes.append(change)))
    tap = on(network, tapper, lambda: tapper.tap([], heard.append))
    on(network, tapper, tapper.announce)
    with processes() as (left, right):
        for process in (left, right):
            assert heard_from(process) == "up"
        assert not tapper.wait_for_nodes(peer.NODES, PATIENCE_S)
        assert network.until(lambda: tap.is_complete)
        for process in (left, right):
            tell(process, "act")
        for process in (left, right):
            assert heard_from(process) == "acted []"
        servers = len(peer.PROCESSES)
        expected = {
            "/double": 4 * len(peer.CALLERS) * servers * peer.CALLS,
            "/send_goal": 4 * len(peer.CALLERS) * servers,
            "/get_result": 4 * len(peer.CALLERS) * servers,
            NUMBERS.name: len(peer.NODES) * peer.CALLS,
        }
        for channel, count in expected.items():
            assert network.until(partial(are_all, count, heard, channel)), channel
        fail = [name for name in peer.CALLERS if name.endswith("two")]
        assert len([seen for seen in heard if seen.error]) == 2 * len(fail) * servers
        callers: dict[tuple[str, str, int], str] = {}
        for seen in heard:
            assert (seen.source, seen.client) == right_source_and_client(seen, callers), seen
        assert not tap.problems()
        assert not any(tap.is_contested(name) for name in peer.NODES)
        for name in peer.NODES:
            mine = [o.sequence for o in of(heard, NUMBERS.name) if o.source == name]
            assert mine == list(range(peer.CALLS)), (name, mine)
        assert {(name, True) for name in peer.NODES} < set(changes)

        changes.clear()
        tell(left, "close left_one")
        assert heard_from(left) == "closed"
        assert network.until(lambda: bool(changes))
        right.send_signal(signal.SIGSTOP)  # as if killed, which would leave its shared memory
        gone = [name for name in peer.NODES if name.startswith("right")]
        assert any(network.until(lambda: len(changes) > len(gone)) for _ in range(LEASES))
        assert changes[0] == ("left_one", False)
        assert sorted(changes[1:]) == sorted((name, False) for name in gone)


def test_a_topic_has_one_type_in_a_process(network: ThreadedNetwork) -> None:
    owner = network.node("owner")
    first, second = owner.beside("first"), owner.beside("second")
    first.subscribe(NUMBERS, lambda message: None)
    with pytest.raises(
        TransportError, match=r"first has declared it as .*one type per topic in a process"
    ):
        second.publisher(Topic(NUMBERS.name, Text.__type_name__, Text))
    second.publisher(NUMBERS).publish(Number(1))
    first.close()
    with pytest.raises(TransportError, match="one type per topic"):
        second.subscribe(Topic(NUMBERS.name, Text.__type_name__, Text), lambda message: None)


def test_a_failed_call_ends_for_the_client_that_made_it(network: ThreadedNetwork) -> None:
    owner = network.node("owner")
    server, first, second = (spinning_beside(owner, name) for name in ("server", "first", "second"))
    requests: list[Request] = []
    server.serve(DOUBLE, requests.append)
    results = [calls(network, node, range(1, 2)) for node in (first, second)]
    assert network.until(lambda: len(requests) == 2)
    one, other = sorted(requests, key=lambda request: request.client)
    assert (one.client, other.client) == ("first", "second")
    other.fail("no")  # each has one call under way, its number 1
    assert network.until(lambda: bool(results[1]))
    one.respond(Answer(2))
    assert network.until(lambda: bool(results[0]))
    outcomes = [ended[0][1].outcome for ended in results]
    assert outcomes == [CallOutcome.RESPONSE, CallOutcome.REMOTE_ERROR]


def test_what_each_node_logs_is_its_own_on_rosout(network: ThreadedNetwork) -> None:
    from rcl_interfaces.msg import Log
    from rclpy.qos import QoSDurabilityPolicy, QoSProfile

    owner = network.node("owner")
    first, second = spinning_beside(owner, "first"), spinning_beside(owner, "second")
    said: set[tuple[str, str]] = set()
    heard: list[Observation] = []
    profile = QoSProfile(depth=100, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
    network.node("listener").ros_node.create_subscription(
        Log, "/rosout", lambda log: said.add((log.name, log.msg)), profile
    )
    tapper = network.node("tapper")
    on(network, tapper, lambda: tapper.tap(["/rosout"], heard.append))
    for node in (owner, first, second):  # before, ROS 2 may know one of them only
        node.announce()
    assert tapper.wait_for_nodes(["owner", "first", "second"], PATIENCE_S) == []
    log = logging.getLogger("tests.composed")
    log.propagate = False
    handler = owner.log_handler(logging.INFO)
    log.addHandler(handler)
    named = logging.LogRecord("second", logging.INFO, "", 0, "by the name of its log", (), None)
    try:
        on(network, first, lambda: log.error("on its thread"))
        on(network, owner, lambda: log.warning("on the owner's"))
        handler.handle(named)
        log.error("of nobody")
        expected = {
            ("first", "tests.composed: on its thread"),
            ("owner", "tests.composed: on the owner's"),
            ("second", "by the name of its log"),
            ("owner", "tests.composed: of nobody"),
        }
        assert network.until(lambda: expected <= said), said
        first.close()
        on_thread = threading.Thread(target=lambda: log.error("once more"), name="first")
        on_thread.start()
        on_thread.join()
        assert network.until(lambda: ("owner", "tests.composed: once more") in said)
        assert network.until(lambda: len(heard) >= len(expected))
        assert all(seen.source == seen.data["name"] for seen in heard), heard
    finally:
        log.removeHandler(handler)


def test_each_node_has_parameters_and_the_simulations_time(
    network: ThreadedNetwork, bare: Bare
) -> None:
    from rosgraph_msgs.msg import Clock

    fired: list[str] = []
    publisher = bare.node.create_publisher(Clock, "/clock", 10)
    with owner_with("-p rate_hz.x:=3.0 -p first:rate_hz.y:=4.0 -p use_sim_time:=true") as owner:
        nodes = [owner, spinning_beside(owner, "first"), spinning_beside(owner, "second")]
        rates = [tuple(node.parameter(f"rate_hz.{n}", 1.0, "") for n in "xy") for node in nodes]
        assert rates == [(3.0, 1.0), (3.0, 4.0), (3.0, 1.0)]

        def reach(time_s: int) -> bool:
            clock = Clock()
            clock.clock.sec = time_s
            publisher.publish(clock)
            return all(node.now_ns() == time_s * 10**9 for node in nodes)

        assert network.until(lambda: reach(10))
        for node in nodes:
            node.after(5.0, partial(fired.append, node.node))
        assert network.until(lambda: reach(14))
        assert not fired
        assert network.until(lambda: reach(15))
        assert network.until(lambda: sorted(fired) == ["first", "owner", "second"])


def test_an_argument_that_renames_all_nodes_is_refused() -> None:
    with owner_with("-r __node:=all") as owner:
        assert owner.node == "all"
        with pytest.raises(TransportError, match=r"to rename one of several: -r first:__node:="):
            owner.beside("first")


def test_an_argument_may_rename_one_node() -> None:
    with owner_with("-r first:__node:=renamed") as owner:
        assert [owner.beside(name).node for name in ("first", "second")] == ["renamed", "second"]
        with pytest.raises(TransportError, match="two nodes of this process are named second"):
            owner.beside("second")


def test_a_name_is_free_again_once_its_node_is_closed(network: ThreadedNetwork) -> None:
    owner = network.node("owner")
    for _ in range(3):
        again = spinning_beside(owner, "again")
        again.announce()
        assert owner.wait_for_nodes(["again"], PATIENCE_S) == []
        again.close()


def test_who_is_closed_by_several_at_once_ends(network: ThreadedNetwork) -> None:
    owner = network.node("owner")
    first, second = spinning_beside(owner, "first"), spinning_beside(owner, "second")
    begun = threading.Event()

    def close_too(node: Connection) -> None:
        begun.set()
        assert network.until(owner._is_closing)
        node.close()

    first.post(lambda: close_too(owner))
    owner.post(lambda: close_too(owner))
    second.post(lambda: close_too(second))
    assert begun.wait(PATIENCE_S)
    closing = threading.Thread(target=owner.close)
    closing.start()
    closing.join(PATIENCE_S)
    assert not closing.is_alive()


def test_a_subscriber_that_stands_still_holds_up_the_end_once() -> None:
    from transports.ros2.last_words import LastWords

    class Unheard:
        """A publisher whose subscriber stands still."""

        asked = 0

        def wait_for_all_acked(self, patience: Any) -> bool:
            self.asked += 1
            return threading.Event().wait(patience.nanoseconds / 1e9)

    publishers = [Unheard(), Unheard()]
    last_words = LastWords(0.05)
    for _ in range(2):
        last_words.wait(publishers)
    assert [publisher.asked for publisher in publishers] == [1, 0]


def test_what_a_node_declares_once_it_is_up_is_known_to_be_its_own(
    network: ThreadedNetwork, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also to somebody whom ROS 2 does not tell whose it is."""
    from transports.ros2.graph import Graph

    owner = network.node("owner")
    first = spinning_beside(owner, "first")
    for node in (owner, first):
        node.announce()
    listener = network.node("listener")
    monkeypatch.setattr(Graph, "_learn", lambda graph, endpoints: [])
    assert listener.wait_for_nodes(["owner", "first"], PATIENCE_S) == []
    publisher = first.publisher(NUMBERS)
    heard: list[Observation] = []
    on(network, listener, lambda: listener.tap([NUMBERS.name], heard.append))
    assert network.until(lambda: publisher.declared.get_subscription_count() == 1)
    publisher.publish(Number(1))
    assert network.until(lambda: bool(heard))
    assert heard[0].source == "first"
