"""What comes without a pause is gathered, and nothing else."""

from __future__ import annotations

import pytest

from transports.gathering import GATHER_S, OFTEN, OFTEN_S, Gathering


class Heard:
    """Something is heard every so often."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.gathering = Gathering(lambda: self.now_s)

    def times(self, count: int, every_s: float) -> list[float]:
        """How long it was left to lie each time."""
        waits = []
        for _ in range(count):
            self.now_s += every_s
            waits.append(self.gathering.wait_s())
            self.now_s += waits[-1]
        return waits


@pytest.fixture
def heard() -> Heard:
    return Heard()


def test_what_comes_now_and_then_is_taken_at_once(heard: Heard) -> None:
    assert not any(heard.times(100, OFTEN_S / 10))


def test_a_burst_is_taken_at_once(heard: Heard) -> None:
    for _ in range(20):
        assert not any(heard.times(OFTEN // 2, 0.0001))
        heard.now_s += OFTEN_S


def test_what_goes_on_and_on_is_gathered_for_as_long_as_it_does(heard: Heard) -> None:
    waits = heard.times(1000, 0.0005)
    assert not any(waits[:OFTEN])
    assert set(waits[OFTEN:]) == {GATHER_S}
    heard.now_s += OFTEN_S
    assert not any(heard.times(OFTEN // 2, 0.001))
