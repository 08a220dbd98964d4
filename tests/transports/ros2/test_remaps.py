"""Channels that a launcher gives other names: ``--ros-args -r from:=to``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
import pytest

from transports.conformance.stage import (
    COUNTING,
    DOUBLE,
    NUMBERS,
    Answer,
    Ask,
    Goal,
    Number,
    Text,
    on,
    ready,
)
from transports.interface import (
    CallOutcome,
    CallResult,
    GoalHandle,
    GoalStatus,
    Observation,
    ObservationKind,
    Request,
    TransportError,
)
from transports.networks import ThreadedNetwork, spinning

pytestmark = pytest.mark.ros2

RULES = f"-r {NUMBERS.name}:=/others -r {DOUBLE.name}:=/twice -r {COUNTING.name}:=/tally"
OTHERS = msgspec.structs.replace(NUMBERS, name="/others")
TWICE = msgspec.structs.replace(DOUBLE, name="/twice")
TALLY = msgspec.structs.replace(COUNTING, name="/tally")


@contextmanager
def remapped(rules: str) -> Iterator[Any]:
    from transports.ros2 import connect

    node = connect("remapped", {"args": rules})
    with spinning(node):
        yield node


def test_topics_services_and_actions_have_the_launchers_names(network: ThreadedNetwork) -> None:
    heard: list[Observation] = []
    other = network.node("other")
    numbers: list[Any] = []
    results: list[CallResult] = []

    def answer(request: Request) -> None:
        request.respond(Answer(2 * request.data.value))

    def count(goal: GoalHandle) -> None:
        goal.accept()
        goal.succeed(Text("done"))

    with remapped(RULES) as node:
        on(network, other, lambda: other.subscribe(OTHERS, numbers.append))
        tap = on(network, other, lambda: other.tap([], heard.append))
        publisher = on(network, node, lambda: node.publisher(NUMBERS))
        on(network, node, lambda: node.serve(DOUBLE, answer))
        on(network, node, lambda: node.serve_action(COUNTING, count, lambda goal: None))
        ready(network, node, other)
        assert network.until(lambda: tap.is_complete)

        def said() -> bool:
            on(network, node, lambda: publisher.publish(Number(1)))
            return bool(numbers)

        assert network.until(said)
        client = on(network, other, lambda: other.client(TWICE))
        on(network, other, lambda: client.call(Ask(4), results.append, 5.0))
        assert network.until(lambda: results)
        assert results[0].outcome is CallOutcome.RESPONSE
        assert results[0].response.value == 8
        goals = on(network, other, lambda: other.action_client(TALLY))
        goal = Goal()
        on(network, other, lambda: goals.send_goal(Number(1), goal.events()))
        assert network.until(lambda: (GoalStatus.SUCCEEDED, "done") in goal.received)

        def is_told() -> bool:
            found = {(seen.channel, seen.kind, seen.source) for seen in heard}
            return found >= {
                ("/others", ObservationKind.MESSAGE, "remapped"),
                ("/twice", ObservationKind.RESPONSE_SENT, "remapped"),
                ("/tally/_action/get_result", ObservationKind.RESPONSE_SENT, "remapped"),
            }

        assert network.until(is_told), {(seen.channel, seen.kind, seen.source) for seen in heard}
    assert not [seen for seen in heard if seen.channel.startswith("/conformance")]


def test_rules_that_follow_each_other_are_refused() -> None:
    with (
        remapped(f"-r {NUMBERS.name}:=/others -r /others:={NUMBERS.name}") as node,
        pytest.raises(
            TransportError, match=r"/conformance/numbers is remapped to /others, and that to"
        ),
    ):
        node.publisher(NUMBERS)


def test_a_name_that_cannot_be_is_refused() -> None:
    with (
        remapped(f"-r {NUMBERS.name}:=/{'x' * 250}") as node,
        pytest.raises(TransportError, match="does not take a name"),
    ):
        node.publisher(NUMBERS)
