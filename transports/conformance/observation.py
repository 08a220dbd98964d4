"""What every transport must report to a tap.

Every public function is a check.
"""

from __future__ import annotations

import threading
from functools import partial
from typing import Any

from transports.conformance.stage import (
    COUNT,
    DOUBLE,
    NUMBERS,
    Answer,
    Ask,
    Number,
    calls,
    on,
    ready,
)
from transports.interface import (
    CallResult,
    Connection,
    LinksByChannel,
    Observation,
    ObservationKind,
    Publisher,
    Topic,
)
from transports.networks import Network


def _tapped_publisher(network: Network) -> tuple[Connection, Publisher, list[Observation]]:
    """The node ``source``, its publisher of ``NUMBERS``, and what another node learns of it."""
    source, listener = network.node("source"), network.node("listener")
    received: list[Observation] = []
    publisher = on(network, source, lambda: source.publisher(NUMBERS))
    on(network, listener, lambda: listener.tap([], received.append))
    ready(network, source, listener)
    return source, publisher, received


def a_tap_receives_every_message_once_and_in_order(network: Network) -> None:
    """With its source, its type, its data as plain values, and gapless numbers."""
    source, publisher, received = _tapped_publisher(network)
    before = source.now_ns()
    for value in range(COUNT):
        source.post(partial(publisher.publish, Number(value, "x")))
    wanted = [("value", COUNT - 1)]
    assert network.until(
        lambda: any(o.channel == NUMBERS.name and o.data["value"] == wanted[0][1] for o in received)
    ), "the tap does not receive the last message"
    mine = [o for o in received if o.channel == NUMBERS.name]
    assert [o.data for o in mine] == [{"value": v, "text": "x"} for v in range(COUNT)], (
        f"the tap received {len(mine)} of {COUNT} messages, or not in order"
    )
    first = mine[0].sequence
    for offset, observation in enumerate(mine):
        assert observation.kind is ObservationKind.MESSAGE, f"its kind is {observation.kind}"
        assert observation.source == "source", f"its source is {observation.source!r}"
        assert observation.type_name == Number.__type_name__, f"type {observation.type_name}"
        assert observation.sequence == first + offset, "sequence numbers have gaps"
        assert observation.stamp_ns >= before - 10**9, "stamped long before it happened"
    stamps = [o.stamp_ns for o in mine]
    assert stamps == sorted(stamps), "stamps of one source go back"


def a_tap_receives_the_first_message_of_who_connects_later(network: Network) -> None:
    """At once, or where links are made channel by channel, as soon as the node knows of them."""
    listener = network.node("listener")
    received: list[Observation] = []
    on(network, listener, lambda: listener.tap([], received.append))
    source = network.node("source")
    topics = [Topic(f"/conformance/first{n}", Number.__type_name__, Number) for n in range(30)]
    publishers = [on(network, source, partial(source.publisher, topic)) for topic in topics]
    if isinstance(source, LinksByChannel):
        linked = threading.Event()
        source.when_observed("listener", (), linked.set)
        assert network.until(linked.is_set), "the node is not told that the tap receives it"
    for publisher in publishers:
        source.post(partial(publisher.publish, Number(7)))
    wanted = {topic.name for topic in topics}
    assert network.until(
        lambda: {o.channel for o in received if o.data == {"value": 7, "text": ""}} == wanted
    ), "the tap does not receive the first message of each topic"


def _tapped_service(network: Network) -> tuple[Connection, Connection, list[Observation]]:
    """A server of ``DOUBLE``, its client, and what a third node learns of them."""
    server, client, listener = (network.node(n) for n in ("server", "client", "listener"))
    received: list[Observation] = []
    on(network, server, lambda: server.serve(DOUBLE, lambda r: r.respond(Answer(2 * r.data.value))))
    on(network, listener, lambda: listener.tap([], received.append))
    ready(network, server, client, listener)
    return server, client, received


def _until_both_ends_report(
    network: Network, client: Connection, received: list[Observation]
) -> None:
    """Call ``DOUBLE`` until all four events of a call come: its ends learn of a tap by and by."""

    def is_received(value: int) -> bool:
        results = calls(network, client, range(value, value + 1))
        assert network.until(lambda: bool(results)), "the call does not end"
        network.caller(lambda: client.wait_for_nodes(["nobody"], 0.1))()
        return sum(o.data in ({"value": value}, {"value": 2 * value}) for o in received) == 4

    assert any(is_received(1000 + attempt) for attempt in range(20)), (
        "the ends do not report to the tap"
    )


def a_tap_receives_the_four_events_of_every_call(network: Network) -> None:
    """Both ends report theirs, in an order that respects cause and effect."""
    _, client, received = _tapped_service(network)
    _until_both_ends_report(network, client, received)
    received.clear()
    results = calls(network, client, range(1, 51))
    assert network.until(lambda: len(results) == 50), "the calls do not end"
    assert network.until(lambda: len(received) >= 200), (
        f"the tap received {len(received)} of 200 events"
    )
    assert len(received) == 200, f"the tap received {len(received)} events of 50 calls, not 200"
    by_call: dict[int, list[Observation]] = {}
    for observation in received:
        by_call.setdefault(observation.call, []).append(observation)
    assert len(by_call) == 50, f"50 calls have {len(by_call)} numbers"
    order = [
        ObservationKind.REQUEST_SENT,
        ObservationKind.REQUEST_RECEIVED,
        ObservationKind.RESPONSE_SENT,
        ObservationKind.RESPONSE_RECEIVED,
    ]
    sources = ["client", "server", "server", "client"]
    for number, events in by_call.items():
        events.sort(key=lambda o: o.stamp_ns)
        assert [o.kind for o in events] == order, f"call {number}: {[o.kind for o in events]}"
        assert [o.source for o in events] == sources, f"call {number}: {events}"
        assert {o.client for o in events} == {"client"}, f"call {number} has other clients"
        asked, answered = events[0].data["value"], events[2].data["value"]
        assert [o.data["value"] for o in events] == [asked, asked, answered, answered]
        assert answered == 2 * asked, f"call {number}: {asked} answered by {answered}"
        assert events[0].type_name == "conformance/srv/Double_Request"
        assert events[2].type_name == "conformance/srv/Double_Response"


def both_ends_of_a_call_name_the_same_life_of_its_client(network: Network) -> None:
    """It is the life in which the client reports; 0 everywhere where the transport cannot tell."""
    _, client, received = _tapped_service(network)
    _until_both_ends_report(network, client, received)
    lives = {o.client_life for o in received}
    assert len(lives) == 1, f"the events of one client's calls are of {len(lives)} of its lives"
    assert lives == {o.life for o in received if o.source == "client"}, "it reports in another life"


def calls_of_two_clients_of_a_node_have_different_numbers(network: Network) -> None:
    """Else a tap would take two calls for one."""
    _, client, received = _tapped_service(network)
    _until_both_ends_report(network, client, received)
    received.clear()
    results = [calls(network, client, range(first, first + 5)) for first in (1, 6)]
    assert network.until(lambda: sum(map(len, results)) == 10), "the calls do not end"
    assert network.until(lambda: len(received) >= 40), (
        f"the tap received {len(received)} of 40 events"
    )
    numbers = {(o.client_life, o.call) for o in received}
    assert len(numbers) == 10, f"10 calls have {len(numbers)} numbers"


def rounds_that_are_over_cost_a_tap_nothing(network: Network) -> None:
    """Whoever says that they are over, on whatever thread: all is received, once and in order."""
    server, client, received = _tapped_service(network)
    client.tick_complete()  # nothing was done yet

    def rounds(values: range) -> None:
        for value in values:
            results = calls(network, client, range(value, value + 1))
            assert network.until(partial(bool, results)), "the call does not end"
            client.tick_complete()
            on(network, server, server.tick_complete)

    _until_both_ends_report(network, client, received)
    received.clear()
    rounds(range(1, 21))
    assert network.until(lambda: len(received) >= 80), (
        f"the tap received {len(received)} of 80 events"
    )
    for source in ("client", "server"):
        stamps = [o.stamp_ns for o in received if o.source == source]
        assert len(stamps) == 40, f"of {source} the tap received {len(stamps)} of 40 events"
        assert stamps == sorted(stamps), f"what {source} reports of a service is not in order"


def a_tap_knows_in_what_order_a_source_did_things(network: Network) -> None:
    """Numbers over all channels of a source have no gap and rise with its stamps; or it gives none."""
    server, client, listener = (network.node(n) for n in ("server", "client", "listener"))
    received: list[Observation] = []
    publisher = on(network, server, lambda: server.publisher(NUMBERS))

    def answer(request: Any) -> None:
        publisher.publish(Number(request.data.value, "before"))
        request.respond(Answer(2 * request.data.value))
        publisher.publish(Number(request.data.value, "after"))

    on(network, server, lambda: server.serve(DOUBLE, answer))
    on(network, listener, lambda: listener.tap([], received.append))
    ready(network, server, client, listener)

    def mine() -> list[Observation]:
        return [o for o in received if o.source == "server"]

    for attempt in range(20):  # ends learn of a tap by and by
        received.clear()
        results = calls(network, client, range(attempt, attempt + 1))
        assert network.until(partial(bool, results)), "the call does not end"
        network.caller(lambda: client.wait_for_nodes(["nobody"], 0.1))()
        if len(mine()) == 4:
            break
    received.clear()
    results = calls(network, client, range(100, 150))
    assert network.until(lambda: len(results) == 50), "the calls do not end"
    assert network.until(lambda: len(mine()) >= 200), f"the tap received {len(mine())} of 200"
    did = sorted(mine(), key=lambda o: o.order)
    if all(o.order == -1 for o in did):
        return
    first = did[0].order
    assert [o.order for o in did] == list(range(first, first + 200)), "the order has gaps"
    stamps = [o.stamp_ns for o in did]
    assert stamps == sorted(stamps), "what came later in the order was stamped earlier"


def a_tap_receives_how_a_call_failed(network: Network) -> None:
    """A remote error is on both response events; a call that nobody answers ends with its reason."""
    server, client, listener = (network.node(n) for n in ("server", "client", "listener"))
    received: list[Observation] = []
    on(network, server, lambda: server.serve(DOUBLE, lambda r: r.fail("no")))
    on(network, listener, lambda: listener.tap([DOUBLE.name], received.append))
    ready(network, server, client, listener)

    def responses() -> list[Observation]:
        return [o for o in received if "response" in o.kind]

    for _ in range(20):
        results = calls(network, client, range(1))
        assert network.until(partial(len, results)), "the call does not end"
        network.caller(lambda: client.wait_for_nodes(["nobody"], 0.1))()
        if len({o.kind for o in responses()}) == 2:
            break
    assert responses(), "the tap receives no response event"
    wrong = [o for o in responses() if not o.error.startswith("remote_error: ") or o.data]
    assert not wrong, f"the error is not reported: {wrong}"


def a_call_that_nobody_serves_is_stamped_when_it_was_made(network: Network) -> None:
    """Before what its node did next, whether the middleware waits for a server or gives up at once."""
    client, publisher, received = _tapped_publisher(network)
    did = (ObservationKind.REQUEST_SENT, ObservationKind.MESSAGE)

    def received_of(value: int) -> list[Observation]:
        results: list[CallResult] = []

        def act() -> None:
            client.client(DOUBLE).call(Ask(value), results.append, 0.2)
            publisher.publish(Number(value))

        on(network, client, act)
        assert network.until(partial(bool, results)), "the call does not end"
        network.caller(lambda: client.wait_for_nodes(["nobody"], 0.1))()
        return [o for o in received if o.kind in did and o.data["value"] == value]

    complete = next((seen for seen in map(received_of, range(20)) if len(seen) == 2), None)
    assert complete, "the tap does not receive the call and the message behind it"
    complete.sort(key=lambda o: o.stamp_ns)
    assert [o.kind for o in complete] == list(did), f"the call is stamped too late: {complete}"


def a_tap_receives_only_what_its_globs_name(network: Network) -> None:
    """A glob names channels; naming an action names its parts."""
    source, listener = network.node("source"), network.node("listener")
    received: list[Observation] = []
    other = Topic("/other/numbers", Number.__type_name__, Number)
    publishers = [on(network, source, partial(source.publisher, t)) for t in (other, NUMBERS)]
    on(network, listener, lambda: listener.tap(["/conformance/*"], received.append))
    ready(network, source, listener)

    def is_received(value: int) -> bool:
        for publisher in publishers:
            on(network, source, partial(publisher.publish, Number(value)))
        network.caller(lambda: source.wait_for_nodes(["nobody"], 0.1))()
        return bool(received)

    assert any(map(is_received, range(100))), "the tap receives nothing"  # topics match by and by
    channels = {observation.channel for observation in received}
    assert channels == {NUMBERS.name}, f"the tap receives {channels}"


def a_tap_that_is_closed_receives_no_more(network: Network) -> None:
    """Closing it twice does nothing; its peers are named while it is open."""
    source, listener = network.node("source"), network.node("listener")
    received: list[Observation] = []
    later: list[Number] = []
    publisher = on(network, source, lambda: source.publisher(NUMBERS))
    tap = on(network, listener, lambda: listener.tap([], received.append))
    on(network, listener, lambda: listener.subscribe(NUMBERS, later.append))
    ready(network, source, listener)
    assert network.until(lambda: "source" in tap.peers()), f"its peers are {tap.peers()}"
    on(network, source, lambda: publisher.publish(Number(1)))
    assert network.until(lambda: bool(received)), "the tap receives nothing"
    on(network, listener, tap.close)
    on(network, listener, tap.close)
    count = len(received)
    on(network, source, lambda: publisher.publish(Number(2)))
    assert network.until(lambda: len(later) == 2), "the subscriber beside it receives nothing"
    assert len(received) == count, "a closed tap still receives"
