"""What checks are made of: messages, channels, and acting on nodes."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import msgspec

from transports.interface import (
    Action,
    CallResult,
    Connection,
    GoalEvents,
    Service,
    Topic,
    TransportError,
)
from transports.networks import PATIENCE_S, Network

Check = Callable[[Network], None]
"""Raises AssertionError, with what is wrong, unless the network's transport does what it should."""

COUNT = 200
"""Messages of a check that sends many."""


class Number(msgspec.Struct, forbid_unknown_fields=True):
    """A message with a number and a text."""

    __type_name__ = "conformance/msg/Number"
    value: int = 0
    text: str = ""


class Text(msgspec.Struct, forbid_unknown_fields=True):
    """A message of another type."""

    __type_name__ = "conformance/msg/Text"
    text: str = ""


class Ask(msgspec.Struct, forbid_unknown_fields=True):
    """A request."""

    __type_name__ = "conformance/srv/Double_Request"
    value: int = 0


class Answer(msgspec.Struct, forbid_unknown_fields=True):
    """A response."""

    __type_name__ = "conformance/srv/Double_Response"
    value: int = 0


NUMBERS = Topic("/conformance/numbers", Number.__type_name__, Number)
TRANSIENT_LOCAL = Topic(
    "/conformance/transient_local", Number.__type_name__, Number, transient_local=True
)
DOUBLE = Service("/conformance/double", "conformance/srv/Double", Ask, Answer)
COUNTING = Action("/conformance/count", "conformance/action/Count", Number, Text, Number)


def on(network: Network, node: Connection, work: Callable[[], Any]) -> Any:
    """``work()`` on the executor of ``node``; its value, or the TransportError it raises."""
    done: list[tuple[Any, TransportError | None]] = []

    def run() -> None:
        try:
            done.append((work(), None))
        except TransportError as error:
            done.append((None, error))

    node.post(run)
    assert network.until(lambda: bool(done)), f"{node.node}: posted work did not run"
    value, error = done[0]
    if error is not None:
        raise error
    return value


def ready(network: Network, *nodes: Connection) -> None:
    """Announce ``nodes`` and wait until each has seen all."""
    names = [node.node for node in nodes]
    for node in nodes:
        on(network, node, node.announce)
    for node in nodes:
        missing = network.caller(partial(node.wait_for_nodes, names, PATIENCE_S))()
        assert not missing, f"{node.node} does not see {missing} although they are announced"


def refused(network: Network, node: Connection, work: Callable[[], Any], what: str) -> str:
    """The text of the TransportError that ``work`` must raise."""
    try:
        on(network, node, work)
    except TransportError as error:
        return str(error)
    raise AssertionError(f"{what} is not refused")


def calls(
    network: Network, node: Connection, values: range, timeout_s: float = PATIENCE_S
) -> list[tuple[int, CallResult]]:
    """Results as they come of one call for each of ``values``."""
    results: list[tuple[int, CallResult]] = []

    def ended(value: int, result: CallResult) -> None:
        results.append((value, result))

    def send() -> None:
        client = node.client(DOUBLE)
        for value in values:
            client.call(Ask(value), partial(ended, value), timeout_s)

    on(network, node, send)
    return results


class Goal:
    """What one goal's client received, in order."""

    def __init__(self) -> None:
        self.received: list[tuple[Any, ...]] = []
        self.id = ""

    def events(self) -> GoalEvents:
        """What puts all of it into ``received``."""
        put = self.received.append
        return GoalEvents(
            accepted=lambda _: put(("accepted",)),
            rejected=lambda _: put(("rejected",)),
            feedback=lambda _, message: put(("feedback", message.value)),
            result=lambda _, status, message: put((status, message.text)),
            failed=lambda _, result: put(("failed", result)),
        )


def send_goal(network: Network, node: Connection, value: int) -> tuple[Goal, Any]:
    """A goal that ``node`` sends, and the client that it is sent by."""
    goal = Goal()
    client = on(network, node, lambda: node.action_client(COUNTING))
    goal.id = on(network, node, lambda: client.send_goal(Number(value), goal.events(), PATIENCE_S))
    return goal, client
