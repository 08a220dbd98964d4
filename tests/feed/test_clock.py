"""The clock by which a monitor judges."""

from __future__ import annotations

import pytest

from examples.bridge.sides import AllSides, Side
from moon.feed.clock import EventTimeClock, clock_nobody_sets, read_together
from moon.sources.live import Joining
from moon.sources.recorded import RecordedConnection
from transports.simulated import SimulatedTransport, SimulatedWorld

MS = 1_000_000
LATENCY = 200 * MS


def ticking(clock: EventTimeClock, start: int, milliseconds: int, step: int = 10) -> int:
    """Tick every ``step`` ms; the time of day at the end."""
    now = start
    for _ in range(milliseconds // step):
        now += step * MS
        clock.tick(now)
    return now


def test_while_all_is_heard_in_time_it_is_the_time_of_day() -> None:
    clock = EventTimeClock(0, LATENCY)
    now = 0
    for _ in range(300):
        clock.received(90 * MS)
        now = ticking(clock, now, 10)
        assert clock.clock_ns == now


def test_it_is_behind_by_what_comes_late_beyond_half_the_bound_and_catches_up() -> None:
    clock = EventTimeClock(0, LATENCY)
    now = ticking(clock, 0, 500)
    clock.received(300 * MS)
    now = ticking(clock, now, 500)
    assert now - clock.clock_ns == 200 * MS
    now = ticking(clock, now, 3000)
    assert clock.clock_ns == now


def test_it_never_goes_back() -> None:
    clock = EventTimeClock(0, LATENCY)
    now, last = 0, 0
    for round_ in range(200):
        clock.received((round_ * 37) % 500 * MS)
        now = ticking(clock, now, 30)
        assert clock.clock_ns >= last
        last = clock.clock_ns


def test_after_a_pause_it_lets_what_waits_be_heard_first() -> None:
    clock = EventTimeClock(0, LATENCY)
    now = ticking(clock, 0, 100)
    clock.tick(now + 400 * MS)
    assert clock.clock_ns <= now + 100 * MS
    now = ticking(clock, now + 400 * MS, 400)
    assert clock.clock_ns == now


def test_what_is_heard_between_two_ticks_takes_it_on_but_not_over_what_may_wait() -> None:
    """Nothing that is late by no more than half the bound, and was not there at the tick, is missed."""
    for latency, reach in ((200 * MS, 50 * MS), (100 * MS, 30 * MS), (30 * MS, 0)):
        clock = EventTimeClock(0, latency)
        clock.tick(10 * MS)
        assert clock.reach_ns(10 * MS) == 10 * MS
        assert clock.reach_ns(80 * MS) == 10 * MS + reach
        clock.received(latency)  # something is late: it waits for more of that
        assert clock.reach_ns(80 * MS) == 10 * MS


def test_a_monitor_that_always_ticks_late_is_lost() -> None:
    clock = EventTimeClock(0, LATENCY)
    ticking(clock, 0, 10_000, step=300)
    assert clock.is_lost
    clock.restart(20_000 * MS)
    assert not clock.is_lost
    assert clock.clock_ns == 20_000 * MS


def test_who_is_held_up_between_two_clocks_reads_them_again() -> None:
    now = 0
    held_up = iter((500 * MS, 0, 0))

    def monotonic() -> int:
        return now

    def time_of_day() -> int:
        nonlocal now
        read = 10**18 + now
        now += next(held_up)
        return read

    day, since = read_together(time_of_day, monotonic)
    assert day - 10**18 == since == 500 * MS


def test_of_clocks_that_are_never_read_together_the_nearest_readings_count() -> None:
    now = 0
    delays = iter((50 * MS, 20 * MS, 40 * MS, 90 * MS, 30 * MS))

    def time_of_day() -> int:
        nonlocal now
        now += next(delays)
        return now

    assert read_together(time_of_day, lambda: now) == (70 * MS, 50 * MS)


def test_after_being_held_up_what_still_waits_is_waited_for() -> None:
    clock = EventTimeClock(0, LATENCY)
    clock.restart(1_000 * MS, held_up=True)
    assert clock.tick(1_010 * MS) == 1_000 * MS
    behind = clock.limit_ns - LATENCY // 2
    for now in range(1_020, 1_990, 10):
        assert clock.tick(now * MS) <= max(1_000 * MS, now * MS - behind)
    for now in range(1_990, 5_000, 10):
        clock.tick(now * MS)
    assert clock.clock_ns == 4_990 * MS
    assert not clock.is_lost


def recorded(home: SimulatedTransport | Joining) -> RecordedConnection:
    return RecordedConnection(home, lambda entry: None, "simulated")


@pytest.mark.parametrize(
    "before",
    [
        lambda home: home,
        Joining,
        recorded,
        lambda home: recorded(Joining(home)),
        lambda home: Side(home, home),
        lambda home: AllSides([Side(home, home)], ()),
    ],
)
def test_whatever_stands_before_a_connection_has_its_two_clocks(before) -> None:
    world = SimulatedWorld(1)
    connection = before(SimulatedTransport(world, "monitor"))
    connection.tap([], lambda seen: None)
    steady_ns = clock_nobody_sets(connection)
    looked: list[int] = []
    for _ in range(3):
        connection.after(0.5, lambda: looked.append(connection.now_ns() - steady_ns()))
        world.run_for(1.0)
    assert len(set(looked)) == 1


class Delegating:
    """Hands on what it is asked for, as who adds to a connection may do."""

    def __init__(self, connection: object) -> None:
        self._connection = connection

    def __getattr__(self, name: str) -> object:
        return getattr(self._connection, name)


def test_virtual_time_is_found_behind_who_hands_it_on() -> None:
    world = SimulatedWorld(seed=1)
    clock = clock_nobody_sets(Delegating(world.connect("monitor")))
    before = clock()
    world.run_for(5.0)
    assert clock() - before == 5_000_000_000
