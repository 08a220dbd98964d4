"""Faults of a model: each place is reported once, and the machine goes on."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from m2c.runtime.binding import Binding, GoalHandlers, NodeSettings
from transports.interface import Action, Service, Topic, Transport, TransportError


class Text(msgspec.Struct):
    data: str = ""


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
