"""What a tap hears on Zenoh, and what it says it could not."""

import subprocess
import sys
import threading

import msgspec
import pytest
import zenoh

from tests.transports.zenoh_network import WAIT_S, Inbox, eventually, linked, peer
from transports import outbox
from transports.interface import ObservationKind, ReadsParts, Service, Topic
from transports.zenoh import names, wire
from transports.zenoh import tap as tap_module

pytestmark = pytest.mark.zenoh


class Long(msgspec.Struct):
    number: int = 0
    many: list[int] = []

    __type_name__ = "test_interfaces/msg/Long"


def test_a_tap_hears_the_four_events_of_a_call_and_only_since_it_listens(network):
    adder, caller, tapper = (network.node(name) for name in ("adder", "caller", "tap"))
    adder.serve(peer.ADD, lambda r: r.respond(peer.AddResponse(r.data.a + r.data.b)))
    adder.announce()
    caller.wait_for_nodes(["adder"], WAIT_S)
    client = caller.client(peer.ADD)
    for _ in range(10):
        client.call_and_wait(peer.AddRequest())
    heard = Inbox()
    tap = tapper.tap([], heard)
    eventually(lambda: client.events.is_tapped and adder._events[peer.ADD.name].is_tapped)
    client.call_and_wait(peer.AddRequest(1, 2))
    events = sorted(heard.wait(4), key=lambda observation: observation.stamp_ns)
    assert [(event.kind, event.source, event.type_name) for event in events] == [
        (ObservationKind.REQUEST_SENT, "caller", "test_interfaces/srv/Add_Request"),
        (ObservationKind.REQUEST_RECEIVED, "adder", "test_interfaces/srv/Add_Request"),
        (ObservationKind.RESPONSE_SENT, "adder", "test_interfaces/srv/Add_Response"),
        (ObservationKind.RESPONSE_RECEIVED, "caller", "test_interfaces/srv/Add_Response"),
    ]
    assert {(event.channel, event.client, event.call) for event in events} == {
        ("/adder/add", "caller", 11)
    }
    assert [event.data for event in events] == [{"a": 1, "b": 2}] * 2 + [{"total": 3}] * 2
    # numbers from 0: nothing was published for the ten calls before
    assert {(event.source, event.sequence) for event in events} == {
        ("caller", 0),
        ("caller", 1),
        ("adder", 0),
        ("adder", 1),
    }
    tap.close()
    eventually(lambda: not client.events.is_tapped)
    client.call_and_wait(peer.AddRequest(1, 2))
    assert client.events.published == 2


def test_a_tap_hears_of_a_call_that_is_never_answered(network):
    adder, caller, tapper = (network.node(name) for name in ("adder", "caller", "tap"))
    adder.serve(peer.ADD, lambda request: None)
    adder.announce()
    caller.wait_for_nodes(["adder"], WAIT_S)
    client = caller.client(peer.ADD)
    heard = Inbox()
    tapper.tap(["/adder/*"], heard)
    eventually(lambda: client.events.is_tapped and adder._events[peer.ADD.name].is_tapped)
    client.call(peer.AddRequest(1, 2), lambda result: None, timeout_s=0.5)
    events = sorted(heard.wait(3), key=lambda observation: observation.stamp_ns)
    sent, ended = (event for event in events if event.source == "caller")
    (received,) = (event for event in events if event.source == "adder")
    kinds = [event.kind.value for event in (sent, received, ended)]
    assert kinds == ["request_sent", "request_received", "response_received"]
    assert ended.error == "timeout: /adder/add: no answer within the time limit"
    assert ended.data is None


def test_all_nodes_tell_what_they_keep_when_a_round_is_over(network, monkeypatch):
    monkeypatch.setattr(outbox, "AT_MOST_S", 10 * WAIT_S)
    adder, caller, tapper = (network.node(name) for name in ("adder", "caller", "tap"))
    adder.serve(peer.ADD, lambda r: r.respond(peer.AddResponse(r.data.a + r.data.b)))
    adder.announce()
    caller.wait_for_nodes(["adder"], WAIT_S)
    client = caller.client(peer.ADD)
    for node in (adder, caller):
        node._shared.outbox._delay_s = 10 * WAIT_S
    heard = Inbox()
    tapper.tap([], heard)
    eventually(lambda: client.events.is_tapped and adder._events[peer.ADD.name].is_tapped)
    client.call_and_wait(peer.AddRequest(1, 2))
    eventually(lambda: adder._shared.outbox._scheduled)
    caller.tick_complete()
    assert {event.source for event in heard.wait(4)} == {"adder", "caller"}


def test_what_a_node_tells_of_several_services_comes_in_the_order_in_which_it_happened(network):
    adder, caller, tapper = (network.node(name) for name in ("adder", "caller", "tap"))
    more = Service("/adder/more", peer.ADD.type_name, peer.ADD.request, peer.ADD.response)
    for service in (peer.ADD, more):
        adder.serve(
            service,
            lambda request: request.respond(peer.AddResponse(request.data.a + request.data.b)),
        )
    adder.announce()
    caller.wait_for_nodes(["adder"], WAIT_S)
    clients = [caller.client(peer.ADD), caller.client(more)]
    heard = Inbox()
    tapper.tap(["/adder/*"], heard)
    eventually(lambda: all(client.events.is_tapped for client in clients))
    eventually(lambda: all(adder._events[name].is_tapped for name in (peer.ADD.name, more.name)))
    for number in range(20):
        clients[number % 2].call_and_wait(peer.AddRequest(number, 0))
    events = heard.wait(80)
    for node in ("adder", "caller"):
        own = [event for event in events if event.source == node]
        assert [event.order for event in own] == sorted(event.order for event in own)
        for channel in (peer.ADD.name, more.name):
            numbers = [event.sequence for event in own if event.channel == channel]
            assert numbers == list(range(20))


def test_a_tap_says_what_it_could_not_decode(network):
    heard = Inbox()
    tap = network.node("tap").tap(["/adder/*"], heard)
    intruder = linked(network.bare(), "adder/count")
    for _ in range(2):
        intruder.put(b"\x81\xa4da", attachment=wire.attachment(0, 0, b"intruder"))
    intruder.put(msgspec.msgpack.encode({"data": 7}), encoding="application/msgpack;x/msg/Y")
    [observation] = heard.wait()
    assert (observation.type_name, observation.data) == ("x/msg/Y", {"data": 7})
    assert tap.problems() == [
        "could not decode 2 messages on /adder/count from intruder: Input data was truncated"
    ]


def test_a_slow_tap_slows_nobody_and_is_told_how_many_it_missed(network, monkeypatch):
    monkeypatch.setattr(tap_module, "RING_CAPACITY", 50)
    tapper, node = network.node("tap"), network.node("node")
    busy, gate, heard = threading.Event(), threading.Event(), Inbox()

    def slow(observation):
        busy.set()
        gate.wait(WAIT_S)
        heard(observation)

    tap = tapper.tap([], slow)
    publisher = node.publisher(peer.COUNT)
    eventually(lambda: publisher.declared.matching_status.matching)
    total = 20_000
    publisher.publish(peer.Number(0))
    assert busy.wait(WAIT_S)
    for number in range(1, total):  # returns although the tap's reader is stuck
        publisher.publish(peer.Number(number))
    gate.set()
    eventually(lambda: heard and heard[-1].data == {"data": total - 1})
    missed = total - len(heard)
    assert missed > 0
    assert tap.problems() == [f"missed {missed} messages on /adder/count from node"]


def test_a_tap_names_its_peers_and_those_it_cannot_hear(network, tmp_path):
    lonely = tmp_path / "zenoh.json5"
    lonely.write_text("{scouting: {gossip: {enabled: false}}}", encoding="utf-8")
    hub = network.node("hub", config=str(lonely))
    node = network.node("far", config=str(lonely))
    hub.announce()
    node.announce()
    tap = network.node("tap", config=str(lonely)).tap([], lambda observation: None)
    eventually(tap.problems)
    assert tap.peers() == ["hub"]
    assert tap.problems() == [
        "far is up, but not linked to this tap: its messages are not received"
    ]


def test_a_tap_is_linked_to_all_by_gossip(network):
    for name in ("hub", "one", "two"):
        network.node(name).announce()
    tap = network.node("tap").tap([], lambda observation: None)
    eventually(lambda: tap.peers() == ["hub", "one", "two"])
    eventually(lambda: tap.problems() == [])


@pytest.mark.parametrize(
    ("globs", "keys"),
    [
        ([], ["**"]),
        (["/a/tick", "/b/*"], ["a/tick/**", "b/**"]),
        (["/a/*", "/a/tick"], ["a/**"]),
        (["/Bat*/tick", "/a"], ["**"]),
    ],
)
def test_globs_become_subscriptions_without_overlap(globs, keys):
    assert names.subscriptions(globs) == keys
    for key in keys:
        zenoh.KeyExpr(key)


ENDING = """
from transports.zenoh import connect

node = connect("ending", {"listen": "tcp/127.0.0.1:0"})
node.tap([], lambda observation: None)
node.close()
"""


def test_a_process_may_end_as_soon_as_its_tap_is_closed():
    """A thread that came back from Zenoh while the interpreter ended aborted two processes of five."""
    command = [sys.executable, "-c", ENDING]
    processes = [subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for _ in range(12)]
    said = [process.communicate(timeout=60)[1] for process in processes]
    assert [process.returncode for process in processes] == [0] * 12, said


def test_a_tap_of_which_little_is_read_makes_little_of_large_messages_and_calls(network):
    adder, caller, tapper = (network.node(name) for name in ("adder", "caller", "tap"))
    service = Service("/long", "test_interfaces/srv/Long", Long, Long)
    adder.serve(service, lambda r: r.respond(Long(5, r.data.many)))
    publisher = adder.publisher(Topic("/long_topic", "test_interfaces/msg/Long", Long))
    adder.announce()
    caller.wait_for_nodes(["adder"], WAIT_S)
    client = caller.client(service)
    heard = Inbox()
    tap = tapper.tap([], heard)
    assert isinstance(tap, ReadsParts)
    fields = {"/long": frozenset({("many",)}), "/long_topic": frozenset({("number",)})}
    tap.read_only(fields.__getitem__)
    eventually(lambda: client.events.is_tapped and adder._events["/long"].is_tapped)
    client.call_and_wait(Long(3, [7] * 5000))
    assert {len(event.data["many"]) for event in heard.wait(4)} == {5000}
    fields["/long"] = frozenset({("number",)})
    client.call_and_wait(Long(3, [7] * 5000))
    assert [event.data["many"] for event in heard.wait(8)[4:]] == [[7] * 256] * 4
    assert sorted(event.data["number"] for event in heard[4:]) == [3, 3, 5, 5]
    eventually(lambda: publisher.declared.matching_status.matching)
    publisher.publish(Long(4, [9] * 5000))
    assert heard.wait(9)[8].data == {"number": 4, "many": [9] * 256}
    tap.close()
