"""Requests that others send to a machine: whether its node took them up, by what both ends tell."""

from __future__ import annotations

from typing import Any

import pytest

from moon.oracle.bounds import Bounds
from moon.oracle.oracle import Oracle
from moon.verdict import Outcome
from tests.oracle.machines import library, read
from tests.oracle.test_progress import ASKS, MS, START
from transports.interface import Observation, ObservationKind

SENT, RECEIVED = ObservationKind.REQUEST_SENT, ObservationKind.REQUEST_RECEIVED
ANSWERED, GOT = ObservationKind.RESPONSE_SENT, ObservationKind.RESPONSE_RECEIVED


class Called:
    """The oracle of a machine that is asked by somebody, each thing told when it happens."""

    def __init__(self) -> None:
        self.oracle = Oracle(read(ASKS.format(more="")), library(), bounds=Bounds())
        self.oracle.start(START, whole=True)
        self.now = START
        self.said: list[Outcome] = []

    def hear(self, kind: ObservationKind, call: int, error: str = "") -> None:
        self.now += MS
        is_own = kind in (RECEIVED, ANSWERED)
        data: Any = {"value": 1} if kind in (SENT, RECEIVED) else {"value": 2, "ok": False}
        seen = Observation(
            stamp_ns=self.now, received_ns=self.now, channel="/Probe/ask", kind=kind, type_name="",
            data=None if error else data, source="Probe" if is_own else "somebody", client="somebody",
            call=call, error=error,
        )  # fmt: skip
        self.said += [verdict.outcome for verdict in self.oracle.feed(seen)]

    def call(self, number: int) -> None:
        for kind in (SENT, RECEIVED, ANSWERED, GOT):
            self.hear(kind, number)

    def passed(self, ns: int) -> list[Outcome]:
        self.now += ns
        self.said += [verdict.outcome for verdict in self.oracle.advance(self.now)]
        return self.said


LONG = 3 * Bounds().deadline


def test_a_request_that_is_not_received_is_a_violation() -> None:
    called = Called()
    called.call(1)
    called.hear(SENT, 2)
    assert called.passed(LONG) == [Outcome.VIOLATED]


def test_a_request_that_was_answered_was_received_though_its_server_was_not_heard() -> None:
    """Its node did not know of the tap yet: who asked told, and who answered did not."""
    called = Called()
    called.hear(SENT, 1)
    called.hear(GOT, 1)
    called.call(2)
    assert called.passed(LONG) == []


@pytest.mark.parametrize("error", ["timeout: no answer", "unavailable: nobody answers"])
def test_a_call_that_failed_does_not_show_that_it_was_received(error: str) -> None:
    called = Called()
    called.call(1)
    called.hear(SENT, 2)
    called.hear(GOT, 2, error)
    assert called.passed(LONG) == [Outcome.VIOLATED]
