"""A node knows when the taps of another receive what it does; who only listens is not up."""

from __future__ import annotations

import threading
from functools import partial
from typing import Any

import pytest

from transports.conformance import DOUBLE, NUMBERS, Answer, Ask, Number, on, ready
from transports.interface import CallOutcome, CallResult, Observation, ObservationKind
from transports.networks import PATIENCE_S, ThreadedNetwork
from transports.registry import connect

pytestmark = pytest.mark.ros2


def test_what_it_does_first_is_received_calls_too(network: ThreadedNetwork) -> None:
    listener = network.node("listener")
    heard: list[Observation] = []
    on(network, listener, lambda: listener.tap([], heard.append))
    server, client = network.node("server"), network.node("client")
    on(network, server, lambda: server.serve(DOUBLE, lambda it: it.respond(Answer(it.data.value))))
    publisher = on(network, client, lambda: client.publisher(NUMBERS))
    calling = on(network, client, lambda: client.client(DOUBLE))
    linked: list[str] = []
    for node in (server, client):
        node.when_observed("listener", (), partial(linked.append, node.node))
    assert network.until(lambda: len(linked) == 2)
    results: list[CallResult] = []
    client.post(partial(publisher.publish, Number(1)))
    client.post(partial(calling.call, Ask(2), results.append))
    assert network.until(lambda: len(results) == 1 and len(heard) == 5), heard
    assert results[0].outcome is CallOutcome.RESPONSE
    assert {it.sequence for it in heard if it.kind is ObservationKind.MESSAGE} == {0}
    assert len({it.kind for it in heard}) == 5


def test_who_has_no_tap_or_is_not_there_does_not_observe_it(network: ThreadedNetwork) -> None:
    source, other = network.node("source"), network.node("other")
    ready(network, source, other)
    known: list[str] = []
    for name in ("nobody", "other", "listener"):
        source.when_observed(name, (), partial(known.append, name))
    listener = network.node("listener")
    on(network, listener, lambda: listener.tap([], lambda _: None))
    assert network.until(lambda: bool(known))
    assert known == ["listener"]


def test_it_learns_of_its_links_before_its_executor_runs(network: ThreadedNetwork) -> None:
    listener = network.node("listener")
    on(network, listener, lambda: listener.tap([], lambda _: None))
    source: Any = connect("ros2", "source", {})
    try:
        source.publisher(NUMBERS)
        linked = threading.Event()
        source.when_observed("listener", (), linked.set)
        assert linked.wait(PATIENCE_S)
    finally:
        source.close()


def test_who_only_listens_is_not_up_until_it_says_that_it_is_ready(
    network: ThreadedNetwork,
) -> None:
    source, listener = network.node("source"), network.node("listener")
    on(network, listener, lambda: listener.tap([], lambda _: None))
    on(network, source, lambda: source.publisher(NUMBERS))
    up: list[tuple[str, bool]] = []
    source.watch_nodes(lambda name, is_up: up.append((name, is_up)))
    linked = threading.Event()
    source.when_observed("listener", (), linked.set)
    assert network.until(linked.is_set)
    assert not up
    listener.post(listener.announce)
    assert network.until(lambda: up == [("listener", True)])


def test_it_may_wait_until_the_other_has_been_told_of_some_nodes(network: ThreadedNetwork) -> None:
    source, listener = network.node("source"), network.node("listener")
    on(network, listener, lambda: listener.tap([], lambda _: None))
    told: list[tuple[str, bool]] = []
    listener.watch_nodes(lambda name, is_up: told.append((name, is_up)))
    on(network, source, lambda: source.publisher(NUMBERS))
    known: list[str] = []
    source.when_observed("listener", (), lambda: known.append("tapped"))
    source.when_observed("listener", ("source",), lambda: known.append(str(told)))
    assert network.until(lambda: known == ["tapped"])
    source.post(source.announce)
    assert network.until(lambda: known == ["tapped", str([("source", True)])]), known
