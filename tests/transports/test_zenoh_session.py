"""How a node joins a Zenoh network, and leaves it."""

import json
import threading

import pytest

from tests.transports.zenoh_network import WAIT_S, Inbox, close_and, eventually, peer
from transports.interface import (
    CallOutcome,
    TransportError,
)
from transports.zenoh import connect
from transports.zenoh_link import session

pytestmark = pytest.mark.zenoh


def test_two_nodes_of_one_name_are_reported(network, caplog):
    for _ in range(2):
        network.node("twin").announce()
    eventually(lambda: len(caplog.messages) == 2)
    assert "two nodes are named twin" in caplog.messages[0]


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


def test_a_process_that_forgets_to_close_ends_all_the_same(network):
    network.node("hub")
    assert network.process("careless").wait(WAIT_S) == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"endpont": "x"},
            "the zenoh transport has no option 'endpont'; "
            "it has endpoint, rendezvous, listen, config, namespace, secure, identity, mode",
        ),
        (
            {"endpoint": "localhost"},
            "endpoint 'localhost' is not an endpoint; "
            "write <protocol>/<address>, e.g. tcp/127.0.0.1:7447",
        ),
        (
            {"args": "-r __ns:=/x"},
            "--ros-args is for ros2, not zenoh; the prefix of channels is --namespace, and `m2c run` "
            "has --param and --remap on every transport",
        ),
        ({"mode": "star"}, "mode 'star': it is one of peer, client, router"),
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


@pytest.mark.parametrize("option", ["endpoint", "rendezvous"])
def test_who_has_no_certificate_is_told_of_it_where_links_need_one(monkeypatch, option):
    monkeypatch.setattr(session, "CONNECT_TIMEOUT_MS", 200)
    with pytest.raises(TransportError) as error:
        connect("node", {option: "tls/127.0.0.1:1"})
    assert str(error.value).startswith(
        "cannot reach tls/127.0.0.1:1 within 0.2 s: is a node or router listening there, "
        "and does it take who has no certificate (--secure DIR)?"
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
    ("endpoint", "of_two"),
    [("tcp/127.0.0.1:7447", "greater-zid"), ("tcp/192.0.2.1:7447", "always")],
)
def test_of_two_peers_on_loopback_one_connects_to_the_other(endpoint, of_two):
    config = session.configuration({"endpoint": endpoint, "listen": "tcp/127.0.0.1:0"})
    strategy = json.loads(config.get_json("scouting/gossip/autoconnect_strategy"))
    assert ((strategy or {}).get("peer") or {}).get("to_peer", "always") == of_two


def test_a_router_connects_nowhere_whatever_the_nodes_file_says(tmp_path):
    path = tmp_path / "zenoh.json5"
    path.write_text('{mode: "client", connect: {endpoints: ["tcp/127.0.0.1:1"]}}', encoding="utf-8")
    options = {"config": str(path), "mode": "router", "listen": "tcp/127.0.0.1:2"}
    config = session.configuration(options)
    assert json.loads(config.get_json("mode")) == "router"
    assert json.loads(config.get_json("connect/endpoints")) == []
    assert json.loads(config.get_json("listen/endpoints")) == ["tcp/127.0.0.1:2"]


def test_a_client_refuses_a_peer_in_the_place_of_its_router(network):
    network.node("peer")
    with pytest.raises(session.NotARouterError) as error:
        connect("client", {"endpoint": network.endpoint, "mode": "client"})
    assert str(error.value).startswith(
        f"what listens at {network.endpoint} is a peer, not a router"
    )


def test_who_comes_first_is_where_the_others_meet_and_so_is_who_comes_when_it_has_gone(network):
    meeting = {"rendezvous": network.endpoint}
    names = ("first", "second", "third")
    first, second, third = (connect(name, meeting) for name in names)
    spinning = [threading.Thread(target=node.spin) for node in (second, third)]
    for thread in spinning:
        thread.start()
    try:
        for node in (first, second, third):
            node.announce()
        assert not second.wait_for_nodes(names, WAIT_S)
        assert not third.wait_for_nodes(names, WAIT_S)
        first.close()
        late = connect("late", meeting)  # listens there now
        late.announce()
        assert not late.wait_for_nodes(["second", "third"], WAIT_S)
        assert not third.wait_for_nodes(["second", "late"], WAIT_S)
        late.close()
    finally:
        for node in (first, second, third):
            node.close()
        for thread in spinning:
            thread.join(WAIT_S)


def test_a_file_that_a_configuration_names_and_that_is_not_there_is_named(tmp_path):
    config = tmp_path / "tls.json5"
    config.write_text(
        '{connect: {endpoints: ["tls/127.0.0.1:7447"]},'
        ' transport: {link: {tls: {root_ca_certificate: "/no/such/ca.pem"}}}}'
    )
    with pytest.raises(TransportError) as error:
        connect("node", {"config": str(config)})
    assert str(error.value) == (
        f"{config}: transport/link/tls/root_ca_certificate: the file /no/such/ca.pem does not exist"
    )


@pytest.mark.parametrize(
    ("endpoint", "listening"),
    [
        ("tcp/127.0.0.1:7447", ["tcp/127.0.0.1:0"]),
        ("tcp/localhost:7447", ["tcp/127.0.0.1:0"]),
        ("tcp/0.0.0.0:7447", ["tcp/0.0.0.0:0"]),
        ("tcp/[::]:7447", ["tcp/[::]:0"]),
        ("tcp/no.such.host.invalid:7447", ["tcp/127.0.0.1:0"]),
        ("tcp/a..b:7447", ["tcp/127.0.0.1:0"]),
        ("unixsock-stream//tmp/meeting", ["tcp/127.0.0.1:0"]),
        ("tls/0.0.0.0:7447", ["tcp/127.0.0.1:0"]),  # nobody listens there without a certificate
    ],
)
def test_a_node_listens_where_its_endpoint_says_that_others_may_reach_it(endpoint, listening):
    config = session.configuration({"endpoint": endpoint})
    assert json.loads(config.get_json("listen/endpoints")) == {"peer": listening}


def test_who_publishes_while_another_thread_closes_its_node_is_told_so(network):
    """Zenoh raises RuntimeError then: the publisher is being undeclared."""
    node = network.node("node")
    publisher = node.publisher(peer.COUNT)

    class Undeclared:
        def put(self, *_, **__):
            raise RuntimeError("Already mutably borrowed")

        def undeclare(self):
            pass

    publisher.declared = Undeclared()
    with pytest.raises(TransportError, match="cannot publish on /adder/count"):
        publisher.publish(peer.Number(7))


DECLARES = {
    "publisher": lambda node: node.publisher(peer.COUNT),
    "subscribe": lambda node: node.subscribe(peer.COUNT, print),
    "serve": lambda node: node.serve(peer.ADD, print),
    "client": lambda node: node.client(peer.ADD),
    "tap": lambda node: node.tap([], print),
    "announce": lambda node: node.announce(),
    "watch_nodes": lambda node: node.watch_nodes(print),
    "watch_namespaces": lambda node: node.watch_namespaces("*", print),
    "wait_for_nodes": lambda node: node.wait_for_nodes(["other"], 0.1),
    "beside": lambda node: node.beside("other"),
}


@pytest.mark.parametrize("declares", DECLARES.values(), ids=DECLARES)
def test_a_handler_that_declares_as_its_node_closes_ends_quietly(network, declares):
    node = connect("node", {"listen": network.endpoint})
    refused = Inbox()

    node.post(lambda: close_and(node, lambda: declares(node), refused))
    node.spin()
    assert refused.wait() == ["node is closed"]
