"""How often a monitor looks at the time: seldom while nothing happens, and never too late."""

from __future__ import annotations

from pathlib import Path

import pytest

from moon.monitor.turns import MACHINES_NS, Turns
from moon.oracle.bounds import Bounds
from tests.monitor.hand_driven import MS, HandDriven, S


class Counted(HandDriven):
    """Counts the turns, and notes when each was."""

    def __init__(self, folder: Path) -> None:
        self.turns: list[int] = []
        super().__init__(folder)

    def after(self, delay_s: float, handler):
        def turn() -> None:
            self.turns.append(self.now)
            handler()

        return super().after(delay_s, turn)


@pytest.fixture
def idle(tmp_path: Path) -> Counted:
    """A monitor that has found its machine, of which nothing is heard."""
    counted = Counted(tmp_path)
    counted.pass_time(100)
    counted.node("Level", True)
    counted.pass_time(6000)
    counted.turns.clear()
    return counted


def test_twenty_times_a_second_while_nothing_happens(idle: Counted) -> None:
    idle.pass_time(1000)
    assert len(idle.turns) == 20


def test_soon_after_something_was_heard(idle: Counted) -> None:
    heard_ns = idle.now + 1 * MS
    idle.pass_time(1)
    idle.message(70)
    idle.pass_time(30)
    # the message is received a moment after it was sent
    assert any(heard_ns < turn <= heard_ns + 21 * MS for turn in idle.turns)


def test_behind_the_moment_when_what_was_heard_is_settled(idle: Counted) -> None:
    """Its stamp and the latency bound, at which another tick may begin; not when the next turn happens to be."""
    idle.message(70)
    settled_ns = idle.now + Bounds().latency
    idle.pass_time(300)
    assert settled_ns not in idle.turns
    assert settled_ns + MACHINES_NS in idle.turns
    assert len(idle.turns) <= 8


def test_when_something_is_overdue(relay: HandDriven) -> None:
    """Of a machine that tells every level on, and once does not."""
    relay.node("Level", True, since=relay.now - S)
    relay.node("Battery", True, since=relay.now - S)
    relay.pass_time(6500)
    relay.message(70)
    # it may have come a latency bound late, and what it has to tell of it another
    overdue_ns = relay.now + Bounds().deadline + 2 * Bounds().latency
    while not unresponsive(relay) and relay.now < overdue_ns + S:
        relay.pass_time(1)
    assert overdue_ns <= relay.now <= overdue_ns + MACHINES_NS + MS


def unresponsive(hand: HandDriven) -> bool:
    """Whether a missing output is said."""
    return any("unresponsive" in verdict.reason for verdict in hand.verdicts)


def test_there_is_one_timer_also_when_the_clock_is_set_back_behind_it() -> None:
    class Clock:
        def __init__(self) -> None:
            self.now = 10 * S
            self.running: list[Clock.Started] = []

        class Started:
            def __init__(self, clock: Clock) -> None:
                self.clock = clock
                clock.running.append(self)

            def cancel(self) -> None:
                if self in self.clock.running:
                    self.clock.running.remove(self)

        def now_ns(self) -> int:
            return self.now

        def after(self, delay_s: float, handler) -> Clock.Started:
            return self.Started(self)

    clock = Clock()
    turns = Turns(clock, lambda: None, 200 * MS)
    turns.plan(0)
    clock.running.clear()  # its turn has come, and is about to be planned anew
    clock.now -= S
    turns.received(clock.now)
    turns.plan(0)
    assert len(clock.running) == 1


def test_not_too_late_for_a_bound_that_is_short() -> None:
    waits: list[float] = []

    class Clock:
        def now_ns(self) -> int:
            return 0

        def after(self, delay_s: float, handler):
            waits.append(delay_s)

    clock = Clock()
    for latency_ms in (15, 60, 150, 1000):
        Turns(clock, lambda: None, latency_ms * MS).plan(10 * S)
    assert waits == [0.01, 0.02, 0.05, 0.05]
