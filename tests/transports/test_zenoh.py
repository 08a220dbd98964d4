"""The Zenoh transport among processes, bad input and lost peers."""

import importlib.util
import json
import logging
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import msgspec
import pytest
import zenoh

from transports.interface import (
    Action,
    CallOutcome,
    GoalEvents,
    GoalStatus,
    ObservationKind,
    Service,
    Topic,
    TransportError,
)
from transports.zenoh import connect, names, session
from transports.zenoh import tap as tap_module

PEER = Path(__file__).with_name("zenoh_peer.py")
_spec = importlib.util.spec_from_file_location("zenoh_peer", PEER)
peer = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(peer)

pytestmark = pytest.mark.zenoh
WAIT_S = 20.0
"""How long a test waits for what must happen; only a failing test waits that long."""


def eventually(condition):
    """Wait for ``condition``, about something that has no event to wait for."""
    pause, deadline = threading.Event(), time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < deadline, "it did not happen"
        pause.wait(0.01)


class Inbox(list):
    """What a handler heard; ``wait(n)`` until there are n."""

    def __init__(self):
        super().__init__()
        self._changed = threading.Condition()

    def __call__(self, *item):
        with self._changed:
            self.append(item[0] if len(item) == 1 else item)
            self._changed.notify_all()

    def wait(self, count=1):
        with self._changed:
            assert self._changed.wait_for(lambda: len(self) >= count, WAIT_S), list(self)
        return self


class Network:
    """Nodes of one test around one endpoint; the first to come listens on it."""

    def __init__(self):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
        self._nodes, self._threads, self._processes, self._sessions = [], [], [], []

    def node(self, name, **options):
        place = "endpoint" if self._nodes else "listen"
        transport = connect(name, {place: self.endpoint} | options)
        thread = threading.Thread(target=transport.spin)
        thread.start()
        self._nodes.append(transport)
        self._threads.append(thread)
        return transport

    def bare(self):
        opened = session.open_session({"endpoint": self.endpoint})
        self._sessions.append(opened)
        return opened

    def process(self, role):
        process = subprocess.Popen([sys.executable, str(PEER), role, self.endpoint])
        self._processes.append(process)
        return process

    def close(self):
        for opened in self._sessions:
            opened.close()
        for transport in reversed(self._nodes):
            transport.close()
        for thread in self._threads:
            thread.join(WAIT_S)
            assert not thread.is_alive()
        for process in self._processes:
            process.kill()
            process.wait()


@pytest.fixture
def network():
    opened = Network()
    yield opened
    opened.close()


def linked(bare, key):
    """A publisher of a bare session whose publications somebody hears."""
    publisher = bare.declare_publisher(key)
    eventually(lambda: publisher.matching_status.matching)
    return publisher


def test_topics_and_services_reach_another_process(network):
    caller = network.node("caller")
    counts = Inbox()
    caller.subscribe(peer.COUNT, counts)
    network.process("adder")
    assert caller.wait_for_nodes(["adder"], WAIT_S) == []
    client = caller.client(peer.ADD)
    assert client.call_and_wait(peer.AddRequest(2, 3)).response == peer.AddResponse(5)
    results = Inbox()
    client.call(peer.AddRequest(4, 5), results)
    assert results.wait()[0].response == peer.AddResponse(9)
    assert counts.wait(2) == [peer.Number(2), peer.Number(4)]


def test_a_server_killed_in_the_middle_of_a_call_is_reconnected_to(network):
    caller = network.node("caller")
    changes, counts, results = Inbox(), Inbox(), Inbox()
    caller.watch_nodes(changes)
    caller.subscribe(peer.COUNT, counts)
    stuck = network.process("stuck")
    assert changes.wait(1) == [("adder", True)]
    client = caller.client(peer.ADD)
    client.call(peer.AddRequest(1, 1), results, timeout_s=60)
    counts.wait()  # the server has the request, and keeps it
    stuck.send_signal(signal.SIGKILL)
    assert results.wait()[0].outcome is CallOutcome.UNAVAILABLE
    assert changes.wait(2)[1] == ("adder", False)
    network.process("adder")
    assert changes.wait(3)[2] == ("adder", True)
    assert client.call_and_wait(peer.AddRequest(1, 1)).response == peer.AddResponse(2)
    assert len(results) == 1


def test_a_callee_that_never_answers_ends_in_a_timeout(network):
    caller = network.node("caller")
    network.process("stuck")
    caller.wait_for_nodes(["adder"], WAIT_S)
    client = caller.client(peer.ADD)
    results = Inbox()
    client.call(peer.AddRequest(), results, timeout_s=0.2)
    assert results.wait()[0].outcome is CallOutcome.TIMEOUT
    result = client.call_and_wait(peer.AddRequest(), timeout_s=0.2)
    assert result.outcome is CallOutcome.TIMEOUT
    assert result.error == "/adder/add: no answer within the time limit"
    assert len(results) == 1


def test_a_call_that_nobody_serves_ends_at_once_as_unavailable(network):
    result = network.node("caller").client(peer.ADD).call_and_wait(peer.AddRequest(), 60)
    assert result.outcome is CallOutcome.UNAVAILABLE
    assert result.error == "/adder/add: nobody answers: no node serves it, or it went away"


@pytest.mark.parametrize(
    ("payload", "type_name", "complaint"),
    [
        (b"\x81\xa4da", "std_msgs/msg/Int32", "Input data was truncated"),
        (
            msgspec.msgpack.encode({"data": "x"}),
            "std_msgs/msg/Int32",
            "Expected `int`, got `str` - at `$.data`",
        ),
        (
            msgspec.msgpack.encode({"data": 1}),
            "std_msgs/msg/Int64",
            "expected type std_msgs/msg/Int32, got std_msgs/msg/Int64",
        ),
        (b"\x91" * 100_000, "std_msgs/msg/Int32", "Expected `object`, got `array`"),
    ],
)
def test_a_bad_payload_is_reported_and_dropped_and_the_node_lives(
    network, caplog, payload, type_name, complaint
):
    node = network.node("node")
    heard = Inbox()
    node.subscribe(peer.COUNT, heard)
    intruder = linked(network.bare(), "adder/count")
    with caplog.at_level(logging.WARNING, "transports.zenoh"):
        intruder.put(
            payload,
            encoding=f"application/msgpack;{type_name}",
            attachment=bytes(8) + b"intruder",
        )
        intruder.put(msgspec.msgpack.encode({"data": 7}))
        assert heard.wait() == [peer.Number(7)]
    assert caplog.messages == [f"/adder/count: message from intruder dropped: {complaint}"]


def test_a_bad_request_is_answered_with_the_reason(network, caplog):
    network.node("adder").serve(peer.ADD, lambda request: request.respond(peer.AddResponse(1)))
    replies = list(network.bare().get("adder/add", payload=msgspec.msgpack.encode({"a": []})))
    assert [reply.err.payload.to_string() for reply in replies] == [
        "bad request: Expected `int`, got `array` - at `$.a`"
    ]
    assert "/adder/add: message from an unnamed node dropped" in caplog.messages[0]


def test_a_bad_response_is_a_remote_error(network, caplog):
    caller = network.node("caller")
    bare = network.bare()
    bare.declare_queryable(
        "adder/add",
        lambda query: query.reply("adder/add", msgspec.msgpack.encode({"total": "x"})),
        complete=True,
    )
    client = caller.client(peer.ADD)
    eventually(lambda: client.call_and_wait(peer.AddRequest()).outcome != CallOutcome.UNAVAILABLE)
    result = client.call_and_wait(peer.AddRequest())
    assert result.outcome is CallOutcome.REMOTE_ERROR
    assert result.error == ("/adder/add: bad response: Expected `int`, got `str` - at `$.total`")


def test_any_zenoh_tool_can_call_a_service(network):
    network.node("adder").serve(
        peer.ADD, lambda r: r.respond(peer.AddResponse(r.data.a + r.data.b))
    )
    payload = msgspec.msgpack.encode({"a": 1, "b": 2})
    [reply] = network.bare().get("adder/add", payload=payload)
    assert msgspec.msgpack.decode(reply.ok.payload.to_bytes()) == {"total": 3}
    assert str(reply.ok.encoding) == "application/msgpack;test_interfaces/srv/Add_Response"


def test_two_servers_of_one_service_are_reported_by_name(network, caplog):
    for name in ("one", "other"):
        network.node(name).serve(peer.ADD, lambda request: None)
    eventually(lambda: len(caplog.messages) == 2)
    assert sorted(caplog.messages) == [
        "two nodes serve /adder/add: one and other; a call reaches only one of them",
        "two nodes serve /adder/add: other and one; a call reaches only one of them",
    ]


def test_serving_a_service_twice_in_one_node_is_refused(network):
    node = network.node("adder")
    node.serve(peer.ADD, lambda request: None)
    with pytest.raises(TransportError, match="/adder/add is served by adder already"):
        node.serve(peer.ADD, lambda request: None)


def test_two_nodes_of_one_name_are_reported(network, caplog):
    for _ in range(2):
        network.node("twin").announce()
    eventually(lambda: len(caplog.messages) == 2)
    assert "two nodes are named twin" in caplog.messages[0]


def test_a_latched_topic_gives_the_last_message_to_who_comes_late(network):
    topic = Topic("/map", "std_msgs/msg/Int32", peer.Number, latched=True)
    publisher = network.node("mapper").publisher(topic)
    publisher.publish(peer.Number(1))
    publisher.publish(peer.Number(2))
    heard = Inbox()
    network.node("late").subscribe(topic, heard)
    assert heard.wait() == [peer.Number(2)]
    publisher.publish(peer.Number(3))
    assert heard.wait(2) == [peer.Number(2), peer.Number(3)]


def test_nodes_in_different_namespaces_do_not_hear_each_other(network):
    hub = network.node("hub", namespace="red")
    hub.serve(peer.ADD, lambda request: request.respond(peer.AddResponse(1)))
    hub.announce()
    red, blue = network.node("red", namespace="red"), network.node("blue", namespace="blue")
    assert red.wait_for_nodes(["hub"], WAIT_S) == []
    answered = red.client(peer.ADD).call_and_wait(peer.AddRequest())
    assert answered.outcome is CallOutcome.RESPONSE
    unheard = blue.client(peer.ADD).call_and_wait(peer.AddRequest())
    assert unheard.outcome is CallOutcome.UNAVAILABLE


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
    eventually(lambda: client._events.heard and adder._events[peer.ADD.name].heard)
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
    eventually(lambda: not client._events.heard)
    client.call_and_wait(peer.AddRequest(1, 2))
    assert client._events._sequence.next == 2


def test_a_tap_hears_of_a_call_that_is_never_answered(network):
    adder, caller, tapper = (network.node(name) for name in ("adder", "caller", "tap"))
    adder.serve(peer.ADD, lambda request: None)
    adder.announce()
    caller.wait_for_nodes(["adder"], WAIT_S)
    client = caller.client(peer.ADD)
    heard = Inbox()
    tapper.tap(["/adder/*"], heard)
    eventually(lambda: client._events.heard and adder._events[peer.ADD.name].heard)
    client.call(peer.AddRequest(1, 2), lambda result: None, timeout_s=0.5)
    events = sorted(heard.wait(3), key=lambda observation: observation.stamp_ns)
    assert [event.kind.value for event in events] == [
        "request_sent",
        "request_received",
        "response_received",
    ]
    assert events[2].error == "timeout: /adder/add: no answer within the time limit"
    assert events[2].data is None


def test_a_tap_says_what_it_could_not_decode(network):
    heard = Inbox()
    tap = network.node("tap").tap(["/adder/*"], heard)
    intruder = linked(network.bare(), "adder/count")
    for _ in range(2):
        intruder.put(b"\x81\xa4da", attachment=bytes(8) + b"intruder")
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
    assert tap.problems() == ["far is up, but not linked to this tap: it is not heard"]


def test_a_tap_is_linked_to_all_by_gossip(network):
    for name in ("hub", "one", "two"):
        network.node(name).announce()
    tap = network.node("tap").tap([], lambda observation: None)
    eventually(lambda: tap.peers() == ["hub", "one", "two"])
    eventually(lambda: tap.problems() == [])


def test_an_action_runs_to_its_canceled_end_and_a_tap_hears_its_parts(network):
    action = Action("/go", "test_interfaces/action/Go", peer.Number, peer.Number, peer.Number)
    server, caller, tapper = (network.node(name) for name in ("server", "caller", "tap"))
    heard, accepted, feedback, results = Inbox(), Inbox(), Inbox(), Inbox()

    def start(goal):
        goal.accept()
        goal.publish_feedback(peer.Number(goal.goal.data + 1))

    server.serve_action(action, start, lambda goal: goal.canceled(peer.Number(9)))
    server.announce()
    tapper.tap(["/go"], heard)
    caller.wait_for_nodes(["server"], WAIT_S)
    client = caller.action_client(action)
    events = GoalEvents(accepted, Inbox(), feedback, results, Inbox())
    eventually(lambda: all(e.heard for e in (*server._events.values(), *caller._events.values())))
    goal_id = client.send_goal(peer.Number(1), events)
    assert accepted.wait() == [goal_id]
    assert feedback.wait() == [(goal_id, peer.Number(2))]
    client.cancel(goal_id)
    assert results.wait() == [(goal_id, GoalStatus.CANCELED, peer.Number(9))]
    eventually(lambda: sum(o.kind is ObservationKind.RESPONSE_RECEIVED for o in list(heard)) == 3)
    assert {observation.channel for observation in heard} == {
        f"/go/_action/{part}"
        for part in ("send_goal", "cancel_goal", "get_result", "feedback", "status")
    }


def test_closing_ends_a_call_that_waits(network):
    adder, caller = network.node("adder"), network.node("caller")
    arrived = Inbox()
    adder.serve(peer.ADD, arrived)
    adder.announce()
    caller.wait_for_nodes(["adder"], WAIT_S)
    client, results = caller.client(peer.ADD), Inbox()
    waiter = threading.Thread(target=lambda: results(client.call_and_wait(peer.AddRequest(), 600)))
    waiter.start()
    arrived.wait()
    caller.close()
    caller.close()
    assert results.wait()[0].outcome is CallOutcome.UNAVAILABLE
    waiter.join()


def test_a_process_that_forgets_to_close_ends_all_the_same(network):
    network.node("hub")
    assert network.process("careless").wait(WAIT_S) == 0


def test_timers_of_answered_calls_are_not_kept(network):
    node = network.node("node")
    node.serve(peer.ADD, lambda request: request.respond(peer.AddResponse(1)))
    client, results = node.client(peer.ADD), Inbox()
    for number in range(1, 501):
        client.call(peer.AddRequest(), results, timeout_s=600)
        results.wait(number)
    assert len(node._executor._timers._heap) <= 64


def test_answering_twice_is_refused(network):
    caller = network.node("caller")
    errors = Inbox()

    def serve(request):
        request.respond(peer.AddResponse(1))
        with pytest.raises(TransportError) as caught:
            request.fail("again")
        errors(str(caught.value))

    caller.serve(peer.ADD, serve)
    caller.client(peer.ADD).call_and_wait(peer.AddRequest())
    assert errors.wait() == ["call 1 of caller to /adder/add is answered already"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"endpont": "x"},
            "the zenoh transport has no option 'endpont'; "
            "it has endpoint, listen, config, namespace",
        ),
        (
            {"endpoint": "localhost"},
            "endpoint 'localhost' is not an endpoint; "
            "write <protocol>/<address>, e.g. tcp/127.0.0.1:7447",
        ),
        ({"config": "/no/such.json5"}, "there is no Zenoh configuration file /no/such.json5"),
        (
            {"namespace": "a//b"},
            "namespace 'a//b': Invalid Key Expr `a//b`: "
            "empty chunks are forbidden, as well as leading and trailing slashes",
        ),
    ],
)
def test_a_wrong_option_is_refused_with_what_would_be_right(options, message):
    with pytest.raises(TransportError) as error:
        connect("node", options)
    assert str(error.value) == message


def test_an_endpoint_that_nobody_listens_on_is_an_error_within_a_bounded_time(monkeypatch):
    monkeypatch.setattr(session, "CONNECT_TIMEOUT_MS", 200)
    with pytest.raises(TransportError) as error:
        connect("node", {"endpoint": "tcp/127.0.0.1:1"})
    assert str(error.value).startswith(
        "cannot reach tcp/127.0.0.1:1 within 0.2 s: is a node or router listening there?"
    )


def test_a_port_in_use_is_an_error(network):
    network.node("first")
    with pytest.raises(TransportError) as error:
        connect("second", {"listen": network.endpoint})
    assert str(error.value).startswith(f"cannot listen on {network.endpoint}: the port is in use")


def test_the_configuration_file_wins_over_defaults_and_options_over_the_file(tmp_path):
    path = tmp_path / "zenoh.json5"
    path.write_text(
        '{mode: "client", namespace: "file", connect: {endpoints: ["tcp/127.0.0.1:1"]}}',
        encoding="utf-8",
    )
    config = session.configuration({"config": str(path), "namespace": "option"})
    assert json.loads(config.get_json("mode")) == "client"
    assert json.loads(config.get_json("namespace")) == "option"
    assert json.loads(config.get_json("connect/endpoints")) == ["tcp/127.0.0.1:1"]
    assert json.loads(config.get_json("timestamping/enabled")) is True


@pytest.mark.parametrize(
    ("channel", "fault"),
    [
        ("relative", "it must start with '/'"),
        ("/a//b", "it has an empty part"),
        ("/a/", "it has an empty part"),
        ("/a/*", "'*' is not allowed in it"),
        ("/a?b", "'?' is not allowed in it"),
        ("/@a", "a part may not start with '@'"),
    ],
)
def test_a_channel_that_zenoh_cannot_name_is_refused(channel, fault):
    with pytest.raises(TransportError) as error:
        names.key_of(channel)
    assert str(error.value) == f"channel {channel!r} cannot be named on Zenoh: {fault}"


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


def test_a_message_of_another_type_cannot_be_published(network):
    publisher = network.node("node").publisher(peer.COUNT)
    with pytest.raises(TransportError) as error:
        publisher.publish(peer.AddRequest())
    assert str(error.value) == ("expected a message of type std_msgs/msg/Int32, got AddRequest")


def test_a_service_of_another_type_is_told_apart(network):
    network.node("adder").serve(peer.ADD, lambda request: request.respond(peer.AddResponse(1)))
    caller = network.node("caller")
    other = Service("/adder/add", "other/srv/Add", peer.AddRequest, peer.AddResponse)
    client = caller.client(other)
    eventually(lambda: client.call_and_wait(peer.AddRequest()).outcome != CallOutcome.UNAVAILABLE)
    assert client.call_and_wait(peer.AddRequest()).error == (
        "bad request: expected type test_interfaces/srv/Add_Request, got other/srv/Add_Request"
    )
