"""One session that listens to the systems of many namespaces."""

import threading

import msgspec
import pytest

from tests.transports.zenoh_network import WAIT_S, Inbox, eventually, linked, peer
from transports import interface
from transports.interface import HERE, Answer, Topic
from transports.zenoh import namespaces, waiting, wire

pytestmark = pytest.mark.zenoh


@pytest.fixture
def listener(network):
    return network.node("moon_monitor")


def robot(network, name):
    node = network.node("adder", namespace=name)
    node.serve(peer.ADD, lambda r: r.respond(peer.AddResponse(r.data.a + r.data.b)))
    return node, node.publisher(peer.COUNT)


def no_failure(error):
    raise AssertionError from error


def test_zenoh_listens_to_many_namespaces(listener):
    assert isinstance(listener, interface.Namespaces)


def test_namespaces_come_with_their_first_node_and_go_with_their_last(network, listener):
    changes = Inbox()
    listener.watch_namespaces("robots/r*", lambda name, up: changes((name, up)))
    first, _ = robot(network, "robots/r1")
    network.node("other", namespace="robots/x1").announce()
    network.node("none").announce()
    first.announce()
    assert changes.wait() == [("robots/r1", True)]
    second = network.node("second", namespace="robots/r1")
    second.announce()
    second.wait_for_nodes(["adder", "second"], WAIT_S)
    third, _ = robot(network, "robots/r2")
    third.announce()
    assert changes.wait(2)[1:] == [("robots/r2", True)]
    first.close()
    second.close()
    assert changes.wait(3)[2:] == [("robots/r1", False)]
    again, _ = robot(network, "robots/r1")
    again.announce()
    assert changes.wait(4)[3:] == [("robots/r1", True)]


def test_a_tap_within_a_namespace_hears_its_channels_and_nodes_by_their_own_names(
    network, listener
):
    nodes, publishers = zip(*(robot(network, f"robots/r{n}") for n in (1, 2)), strict=True)
    for node in nodes:
        node.announce()
    heard, ups = Inbox(), Inbox()
    within = listener.within("robots/r1", no_failure)
    within.watch_nodes(lambda name, up: ups((name, up)))
    tap = within.tap([], heard)
    assert ups.wait() == [("adder", True)]
    assert within.up_since("adder") > 0
    assert [within.clock_of(name) for name in ("", "adder", "nobody")] == [HERE, HERE, ""]
    for node, publisher in zip(nodes, publishers, strict=True):
        if node is nodes[0]:
            eventually(lambda publisher=publisher: publisher.declared.matching_status.matching)
        publisher.publish(peer.Number(7 if node is nodes[0] else 8))
    (seen,) = heard.wait()
    assert (seen.channel, seen.source, seen.data) == ("/adder/count", "adder", {"data": 7})
    eventually(lambda: tap.peers() == ["adder"])
    answers = Inbox()
    tap.ask("adder", answers, WAIT_S)
    (answer,) = answers.wait()
    assert isinstance(answer, Answer)
    assert answer.next_order == seen.order + 1
    assert tap.problems() == []


def test_what_is_published_within_a_namespace_is_received_there(network, listener):
    node = network.node("reader", namespace="robots/r1")
    other = network.node("reader", namespace="robots/r2")
    received, elsewhere = Inbox(), Inbox()
    topic = Topic("/moon/verdicts", "std_msgs/msg/Int32", peer.Number)
    node.subscribe(topic, received)
    other.subscribe(topic, elsewhere)
    publisher = listener.within("robots/r1", no_failure).publisher(topic)
    eventually(lambda: publisher.declared.matching_status.matching)
    publisher.publish(peer.Number(3))
    assert [message.data for message in received.wait()] == [3]
    assert elsewhere == []


def test_closing_one_listener_leaves_the_others(network, listener):
    _, publisher = robot(network, "robots/r2")
    heard = Inbox()
    listener.within("robots/r2", no_failure).tap([], heard)
    first = listener.within("robots/r1", no_failure)
    first.tap([], heard)
    first.close()
    first.close()
    eventually(lambda: publisher.declared.matching_status.matching)
    publisher.publish(peer.Number(1))
    heard.wait()


def test_what_a_handler_raises_ends_its_own_listener_only(network, listener):
    publishers = {name: robot(network, name)[1] for name in ("robots/r1", "robots/r2")}
    failures, heard = Inbox(), Inbox()

    def fail(observation):
        raise ValueError(observation.channel)

    bad = listener.within("robots/r1", failures)
    bad.tap([], fail)
    listener.within("robots/r2", no_failure).tap([], heard)
    for publisher in publishers.values():
        eventually(lambda publisher=publisher: publisher.declared.matching_status.matching)
        for number in range(3):
            publisher.publish(peer.Number(number))
    assert len(heard.wait(3)) == 3
    assert [str(error) for error in failures.wait()] == ["/adder/count"]
    bad.post(lambda: heard("never"))
    done = Inbox()
    listener.post(lambda: done(True))
    done.wait()
    assert "never" not in heard
    assert len(failures) == 1


def test_a_flood_in_one_namespace_loses_nothing_of_another(network, listener, monkeypatch):
    monkeypatch.setattr(waiting, "MOST_WAITING_BYTES", 200_000)
    _, publisher = robot(network, "robots/r2")
    gate, busy, flood, heard = threading.Event(), threading.Event(), Inbox(), Inbox()

    def slow(observation):
        busy.set()
        gate.wait(WAIT_S)
        flood(observation)

    flooded = listener.within("robots/r1", no_failure).tap([], slow)
    other = listener.within("robots/r2", no_failure).tap([], heard)
    eventually(lambda: publisher.declared.matching_status.matching)
    intruder = linked(network.bare(), "robots/r1/adder/count")
    intruder.put(msgspec.msgpack.encode({"data": 0}), attachment=wire.attachment(0, 0, b"adder"))
    assert busy.wait(WAIT_S)
    for number in range(1, 3 * namespaces.RING_CAPACITY):
        intruder.put(
            msgspec.msgpack.encode({"data": number}),
            attachment=wire.attachment(number, number, b"adder"),
        )
    for number in range(100):
        publisher.publish(peer.Number(number))
    eventually(flooded.problems)
    gate.set()
    assert [seen.data["data"] for seen in heard.wait(100)] == list(range(100))
    assert other.problems() == []
    assert any("dropped" in problem or "missed" in problem for problem in flooded.problems())


def test_forged_tokens_are_refused_and_counted(network, listener):
    changes = Inbox()
    listener.watch_namespaces("robots/*", lambda name, up: changes((name, up)))
    liveliness = network.bare().liveliness()
    tokens = [
        liveliness.declare_token(f"robots/r1/@m2c/node/{wrong}")
        for wrong in ("x", "zid/name/soon", "zid/name/1/2", "!/name/1")
    ]
    tokens += [
        liveliness.declare_token(f"robots/{name}/@m2c/node/ab/n/1")
        for name in ("x" * 60_000, "a\x1b[31m")
    ]
    node, _ = robot(network, "robots/r2")
    node.announce()
    assert changes.wait() == [("robots/r2", True)]
    eventually(lambda: listener._refusals.total == 6)
    for token in tokens:
        token.undeclare()
