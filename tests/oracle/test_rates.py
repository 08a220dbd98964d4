"""Topics at high rates and floods: judged, or given up with the channel's name; never without a bound."""

from __future__ import annotations

import msgspec
import pytest

from benchmarks import rates  # whose machines and traces these are
from moon.oracle import resynchronisation
from moon.oracle.bounds import Bounds
from moon.oracle.oracle import Oracle
from moon.verdict import Outcome, Verdict
from transports.interface import Observation, ObservationKind

pytestmark = pytest.mark.slow

NAMES = list(rates.MACHINES)


class Judged:
    """The oracle of one machine and what it said; time passes as observations come."""

    def __init__(self, name: str) -> None:
        system = rates.read(name)
        self.oracle = Oracle(system.nodes[0], system.library)
        self.oracle.start(rates.START, whole=True)
        self.said: list[Verdict] = []
        self.most = 0

    def hear(self, observations: list[Observation]) -> Judged:
        turn = observations[0].received_ns
        for seen in observations:
            while turn < seen.received_ns:
                self.said += self.oracle.advance(turn)
                turn += rates.TURN_NS
            self.said += self.oracle.feed(seen)
            self.most = max(self.most, len(self.oracle.judge.hypotheses or ()))
        self.said += self.oracle.advance(turn + Bounds().latency)
        return self

    @property
    def violations(self) -> list[Verdict]:
        return [verdict for verdict in self.said if verdict.outcome is Outcome.VIOLATED]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("rate", "sources"), [(100, 1), (1000, 1)])
def test_a_machine_that_takes_a_topic_at_a_high_rate_is_judged(name: str, rate: int, sources: int):
    judged = Judged(name).hear(list(rates.trace(name, rate, sources, 1.5)))
    assert not judged.said
    assert judged.oracle.is_synchronised
    assert judged.most <= Bounds().hypotheses


@pytest.mark.parametrize("name", NAMES)
def test_a_wrong_answer_is_found_at_such_a_rate(name: str):
    heard = list(rates.trace(name, 1000, 1, 1.5))
    answers = [i for i, seen in enumerate(heard) if seen.kind is ObservationKind.RESPONSE_SENT]
    place = answers[7]
    heard[place] = msgspec.structs.replace(heard[place], data={"status": 12345})
    judged = Judged(name).hear(heard)
    assert judged.violations
    assert judged.violations[0].stamp_ns == heard[place].stamp_ns


@pytest.mark.parametrize("name", NAMES)
def test_a_strangers_flood_on_a_topic_is_followed_or_given_up_and_its_channel_named(name: str):
    own = list(rates.trace(name, 2, 1, 3.0))
    flood = [
        Observation(
            stamp_ns=rates.START + rates.S + number * rates.S // 3000,
            received_ns=rates.START + rates.S + number * rates.S // 3000 + 1000,
            channel="/level",
            kind=ObservationKind.MESSAGE,
            type_name="",
            data={"data": number % 90},
            source="stranger",
            sequence=number,
        )
        for number in range(3000)
    ]
    heard = sorted([*own, *flood], key=lambda seen: seen.received_ns)
    judged = Judged(name).hear(heard)
    assert judged.most <= Bounds().hypotheses
    reasons = [v.reason for v in judged.said if v.outcome is Outcome.INCONCLUSIVE]
    assert any("/level from stranger" in reason for reason in reasons)
    assert len(judged.oracle.judge.resynchronisation.recent) <= resynchronisation.KEPT_EVENTS


def test_endless_requests_that_are_not_taken_up_are_not_kept_for_ever():
    name = NAMES[0]
    judged = Judged(name)
    asked = [
        Observation(
            stamp_ns=rates.START + number * 10_000,
            received_ns=rates.START + number * 10_000,
            channel="/Probe/tick",
            kind=ObservationKind.REQUEST_SENT,
            type_name="",
            data={},
            source=f"stranger{number % 7}",
            client=f"stranger{number % 7}",
            call=number,
        )
        for number in range(5000)
    ]
    judged.hear(asked)
    assert len(judged.oracle._requests.expected.events) <= 1024
