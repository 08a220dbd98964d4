"""What every transport must do with topics.

Every public function is a check.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from transports.conformance.stage import (
    COUNT,
    NUMBERS,
    TRANSIENT_LOCAL,
    Number,
    Text,
    on,
    ready,
    refused,
)
from transports.interface import (
    Topic,
)
from transports.networks import Network


def messages_of_one_source_arrive_in_order(network: Network) -> None:
    """Two publishers, two subscribers: each receives all of each, in order."""
    sources = [network.node("source_a"), network.node("source_b")]
    sinks = [network.node("sink_a"), network.node("sink_b")]
    received: list[list[Number]] = [[], []]
    for sink, inbox in zip(sinks, received, strict=True):
        on(network, sink, partial(sink.subscribe, NUMBERS, inbox.append))
    publishers = [on(network, source, partial(source.publisher, NUMBERS)) for source in sources]
    ready(network, *sources, *sinks)
    for value in range(COUNT):
        for source, publisher in zip(sources, publishers, strict=True):
            message = Number(value, source.node)
            source.post(partial(publisher.publish, message))
    assert network.until(lambda: all(len(inbox) >= 2 * COUNT for inbox in received)), (
        f"of {2 * COUNT} messages the subscribers received {[len(inbox) for inbox in received]}"
    )
    for inbox in received:
        for source in sources:
            values = [message.value for message in inbox if message.text == source.node]
            assert values == list(range(COUNT)), f"from {source.node} came {values}"


def a_transient_local_topic_gives_the_last_message_to_who_comes_late(network: Network) -> None:
    """Who subscribes after the publication still gets the last message, once."""
    source, late = network.node("source"), network.node("late")
    publisher = on(network, source, lambda: source.publisher(TRANSIENT_LOCAL))
    on(network, source, lambda: publisher.publish(Number(1)))
    on(network, source, lambda: publisher.publish(Number(2)))
    ready(network, source, late)
    received: list[int] = []
    on(network, late, lambda: late.subscribe(TRANSIENT_LOCAL, lambda m: received.append(m.value)))
    assert network.until(lambda: bool(received)), "a late subscriber receives nothing"
    on(network, source, lambda: publisher.publish(Number(3)))
    assert network.until(lambda: 3 in received), (
        "a late subscriber does not receive what comes after"
    )
    assert received == [2, 3], (
        f"a late subscriber should receive 2, then 3, and received {received}"
    )


def a_message_of_another_type_is_refused_by_its_publisher(network: Network) -> None:
    """The text names the expected type."""
    node = network.node("source")
    publisher = on(network, node, lambda: node.publisher(NUMBERS))
    text = refused(network, node, lambda: publisher.publish(Text("x")), "a Text as a Number")
    assert Number.__type_name__ in text, f"the refusal does not name the type: {text}"


def a_message_that_is_not_of_the_topics_type_is_dropped_and_the_node_lives(
    network: Network,
) -> None:
    """A subscriber that expects another type than the publisher's receives nothing, and goes on.

    It is in a node of its own: a middleware may allow one type per topic in a node.
    """
    source, sink, misled = (network.node(n) for n in ("source", "sink", "misled"))
    wrong: list[Any] = []
    right: list[Number] = []
    after: list[Number] = []
    other = Topic(NUMBERS.name, Text.__type_name__, Text)
    more = Topic("/conformance/more", Number.__type_name__, Number)
    on(network, misled, lambda: misled.subscribe(other, wrong.append))
    on(network, misled, lambda: misled.subscribe(more, after.append))
    on(network, sink, lambda: sink.subscribe(NUMBERS, right.append))
    publishers = [on(network, source, partial(source.publisher, t)) for t in (NUMBERS, more)]
    ready(network, source, sink, misled)
    for publisher in publishers:
        on(network, source, partial(publisher.publish, Number(1)))
    assert network.until(lambda: bool(right)), "the subscriber of the right type receives nothing"
    assert network.until(lambda: bool(after)), "the node of the wrong type receives nothing else"
    assert not wrong, f"a subscriber of another type is given {wrong}"
