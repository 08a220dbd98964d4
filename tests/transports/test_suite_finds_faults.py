"""The conformance suite fails where a transport breaks its promises."""

from __future__ import annotations

from typing import Any

import pytest

from tests.transports.networks import SimulatedNetwork
from transports import conformance
from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld
from transports.simulated.network import Link

FAR = Conditions(delay_s=(0.0, 0.02), tap_delay_s=(0.0, 0.02))


class LosesMessages(SimulatedWorld):
    def send(self, link: Any, *what: Any, **how: Any) -> None:
        if self.random.random() < 0.99:
            super().send(link, *what, **how)


class KeepsNoOrder(SimulatedWorld):
    def send(self, link: Any, *what: Any, **how: Any) -> None:
        super().send(Link(link.source, link.channel, link.node), *what, **how)


class DoublesMessages(SimulatedWorld):
    def send(self, link: Any, *what: Any, **how: Any) -> None:
        for _ in range(1 + (self.random.random() < 0.1)):
            super().send(link, *what, **how)


class HidesObservations(SimulatedWorld):
    def send_to_tap(self, link: Any, event: Any, argument: Any) -> None:
        if self.random.random() < 0.99:
            super().send_to_tap(link, event, argument)


class StampsAtRandom(SimulatedWorld):
    def stamp(self) -> int:
        return self.now_ns + self.random.randrange(10**9)


CASES = [
    (LosesMessages, conformance.messages_of_one_source_arrive_in_order),
    (KeepsNoOrder, conformance.messages_of_one_source_arrive_in_order),
    (DoublesMessages, conformance.messages_of_one_source_arrive_in_order),
    (HidesObservations, conformance.a_tap_receives_every_message_once_and_in_order),
    (HidesObservations, conformance.a_tap_receives_the_four_events_of_every_call),
    (StampsAtRandom, conformance.a_tap_receives_the_four_events_of_every_call),
]


@pytest.mark.parametrize(("world", "check"), CASES)
def test_a_world_with_a_fault_does_not_pass(world: type[SimulatedWorld], check: Any) -> None:
    network = SimulatedNetwork()
    network.world = world(1, FAR)
    try:
        with pytest.raises(AssertionError):
            check(network)
    finally:
        network.close()


def late(self: SimulatedTransport, delay_s: float, handler: Any) -> Any:
    return SimulatedTransport.every(self, delay_s, handler)


def test_a_single_timer_that_repeats_does_not_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SimulatedTransport, "after", late)
    network = SimulatedNetwork()
    with pytest.raises(AssertionError):
        conformance.timers_fire_no_earlier_than_asked_and_stop_when_cancelled(network)
    network.close()


def test_an_executor_that_drops_work_does_not_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SimulatedTransport, "post", lambda self, handler: None)
    network = SimulatedNetwork()
    with pytest.raises(AssertionError):
        conformance.callbacks_run_one_at_a_time(network)
    network.close()
