"""Faults of a model: each place is reported once, and the machine goes on."""

from __future__ import annotations

import gc
import weakref
from typing import Any

import msgspec
import pytest

from m2c.runtime.binding import Binding, GoalHandlers, NodeSettings
from transports.interface import Action, Service, Topic, Transport, TransportError


class Text(msgspec.Struct):
    data: str = ""


class Rings:
    """A transport whose timers ring when the test says so; it does not keep them after that."""

    def __init__(self) -> None:
        self.set: list[Ringing] = []
        self.made: weakref.WeakSet[Ringing] = weakref.WeakSet()

    def after(self, _: float, handler: Any) -> Any:
        timer = Ringing(handler)
        self.set.append(timer)
        self.made.add(timer)
        return timer

    def ring(self) -> None:
        """Let those ring that are set."""
        due, self.set = self.set, []
        for timer in due:
            timer.handler()


class Ringing:
    def __init__(self, handler: Any) -> None:
        self.handler = handler

    def cancel(self) -> None:
        self.handler = lambda: None


class Refusing:
    """A transport that carries nothing."""

    def publisher(self, _: Topic) -> Any:
        return self

    def client(self, _: Service) -> Any:
        return self

    def action_client(self, _: Action) -> Any:
        return self

    def serve(self, _: Service, handler: Any) -> None:
        self.handler = handler

    def refuse(self, *_: Any) -> None:
        raise TransportError(".data: a string of length 9; at most 5 fits")

    publish = call = send_goal = respond = refuse
    data = Text()


def binding(transport: Any) -> Binding:
    typed: Transport = transport
    return Binding(typed, "node", NodeSettings(), lambda: "idle")


def test_a_fault_is_reported_once_for_each_place(caplog: pytest.LogCaptureFixture) -> None:
    made = binding(Refusing())
    for _ in range(3):
        made.fault("Model.scxml:18:5", "undefined where int32 is declared")
        made.fault("Model.scxml:20:5", "NaN where int32 is declared")
    assert [(record.levelname, record.message) for record in caplog.records] == [
        ("ERROR", f"{place}: {what} where int32 is declared (reported once; the machine goes on)")
        for place, what in (("Model.scxml:18:5", "undefined"), ("Model.scxml:20:5", "NaN"))
    ]


def test_two_nodes_report_their_faults_each(caplog: pytest.LogCaptureFixture) -> None:
    for _ in range(2):
        binding(Refusing()).fault("Model.scxml:18:5", "undefined")
    assert len(caplog.records) == 2


def test_what_a_transport_cannot_carry_is_reported_once_and_the_node_lives(
    caplog: pytest.LogCaptureFixture,
) -> None:
    transport = Refusing()
    made = binding(transport)
    service, action = Service("/ask", "t/Ask", Text, Text), Action("/go", "t/Go", Text, Text, Text)
    publisher = made.publisher(Topic("/out", "t/Text", Text))
    client = made.client(service, None, None)
    goals = made.action_client(action, GoalHandlers())
    server = made.server(service, lambda _: bool(server.respond(Text())) or True)
    for _ in range(2):
        publisher.publish(Text())
        client.call(Text())
        goals.send_goal(Text())
        transport.handler(transport)
    assert [record.message.partition(":")[0] for record in caplog.records] == [
        *("/out", "/ask", "/go")
    ]
    assert "a string of length 9; at most 5 fits" in caplog.text


@pytest.mark.parametrize("send_id", ["", "t"])
@pytest.mark.parametrize("together", [1, 3])
def test_what_has_rung_is_forgotten(send_id: str, together: int) -> None:
    transport = Rings()
    made, taken = binding(transport), []

    def take(event: str, data: Any) -> None:
        taken.append((event, data))

    for number in range(20):
        for _ in range(together):
            made.send_self("beat", number, 1.0, send_id, take)
        made.start_delay("s#0", 1.0, taken.append)
        transport.ring()
    gc.collect()
    assert len(taken) == 20 * (together + 1)
    assert len(transport.made) == 0


def test_what_rings_may_be_sent_and_cancelled_again() -> None:
    transport, taken = Rings(), []
    made = binding(transport)

    def take(event: str, data: Any) -> None:
        taken.append(data)
        if data < 3:
            made.send_self(event, data + 1, 1.0, "t", take)
            made.send_self(event, 9, 1.0, "other", take)
            made.cancel_send("other", take)

    made.send_self("beat", 0, 1.0, "t", take)
    for _ in range(6):
        transport.ring()
    assert taken == [0, 1, 2, 3]
    made.send_self("beat", 7, 1.0, "t", take)
    made.cancel_send("t", take)
    transport.ring()
    assert taken == [0, 1, 2, 3]
