"""When judging begins."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from m2c.diagnostics import DiagnosticLog
from m2c.model.interfaces import InterfaceLibrary
from moon.feed.counts import Counts
from moon.feed.intake import Feed
from moon.feed.reception import Reception
from moon.judge import Missing
from moon.oracle.bounds import Bounds
from transports.interface import (
    BlindSpot,
    BlindSpotKind,
    Observation,
    ObservationKind,
)

MS = 1_000_000
LATENCY_NS = 200 * MS


class Clocks:
    """Two that go on together, and what is found to be missing."""

    repair_s = 0.0

    def __init__(self) -> None:
        self.passed_ns = 0
        self.set_ns = 0
        self.anew: list[str] = []
        self.missed: list[str] = []

    def now_ns(self) -> int:
        return 10**18 + self.passed_ns + self.set_ns

    def steady_ns(self) -> int:
        return self.passed_ns

    def turn(self, feed: Feed) -> None:
        gaps = [feed.look_at_clock(*feed.read_clocks())]
        gaps += feed.tick(self.now_ns(), self.steady_ns())[1]
        for gap in gaps:
            if gap is not None and gap.cause in (Missing.ANEW, Missing.OWN_CLOCK_SET):
                self.anew.append(gap.why)
            elif gap is not None:
                self.missed.append(gap.channel)


class Tap:
    def take_dropped(self) -> tuple[()]:
        return ()

    def blind_spots(self) -> dict[BlindSpot, str]:
        return {}

    def is_contested(self, name: str) -> bool:
        return False


def made(clocks: Clocks) -> Feed:
    counts = Counts()
    library = InterfaceLibrary.load([], DiagnosticLog())
    reception = Reception((), library, LATENCY_NS, counts)
    source: Any = clocks
    return Feed(source, Bounds(latency=LATENCY_NS), reception, counts)


@pytest.mark.parametrize("later_ms", [1, 80, 150, 5000])
def test_judging_that_begins_later_than_it_was_made_sees_no_clock_that_was_set(
    later_ms: int,
) -> None:
    clocks = Clocks()
    feed = made(clocks)
    clocks.passed_ns += later_ms * MS
    listener: Any = Tap()
    assert feed.start(listener) == clocks.now_ns()
    for _ in range(20):
        clocks.passed_ns += 20 * MS
        clocks.turn(feed)
    assert clocks.anew == clocks.missed == []


def test_what_was_received_before_judging_begins_counts_if_all_was() -> None:
    clocks = Clocks()
    feed = made(clocks)
    since_ns = clocks.now_ns()
    clocks.passed_ns += 5000 * MS
    listener: Any = Tap()
    assert feed.start(listener, since_ns) == feed.since_ns == since_ns


class Running:
    """Judging goes on; ``Node`` sends a message now and then."""

    def __init__(self) -> None:
        self.clocks = Clocks()
        self.feed = made(self.clocks)
        listener: Any = Tap()
        self.feed.start(listener)
        self.number = -1
        self.turn(20)

    def turn(self, milliseconds: int) -> None:
        self.clocks.passed_ns += milliseconds * MS
        self.clocks.turn(self.feed)

    def hear(self, stamp_ns: int) -> bool:
        """Whether a message of ``stamp_ns`` that comes now is judged."""
        self.number += 1
        seen = Observation(
            stamp_ns=stamp_ns,
            received_ns=self.clocks.now_ns(),
            channel="/topic",
            kind=ObservationKind.MESSAGE,
            type_name="",
            data={},
            source="Node",
            sequence=self.number,
            order=self.number,
        )
        intake = self.feed.take(seen, self.clocks.now_ns())
        self.gaps = intake.gaps
        return intake.judged is not None


@pytest.mark.parametrize("step_ms", [-3_600_000, -5000, -400, -150, -20, -1, 1, 20, 150, 3_600_000])
@pytest.mark.parametrize("passed_ms", [20, 300])
def test_a_clock_that_is_set_is_noticed_however_little(step_ms: int, passed_ms: int) -> None:
    running = Running()
    running.clocks.set_ns += step_ms * MS
    running.turn(passed_ms)
    (why,) = running.clocks.anew
    assert f"set {'back' if step_ms < 0 else 'forward'}" in why


def test_a_clock_that_is_set_back_while_the_monitor_stands_still_is_noticed() -> None:
    running = Running()
    running.clocks.set_ns -= 150 * MS
    running.turn(600)
    assert running.clocks.anew == ["the clock was set back by 0.1 s"]


@pytest.mark.parametrize("step_ms", [-3_600_000, -5000, -150, -20, 20, 150, 5000])
def test_what_was_stamped_before_the_clock_was_set_is_not_judged(step_ms: int) -> None:
    running = Running()
    assert running.hear(running.clocks.now_ns())
    before_ns = running.clocks.now_ns() + 18 * MS
    running.clocks.set_ns += step_ms * MS
    running.turn(20)
    assert not running.hear(before_ns)
    assert running.feed.sources.known["Node"].progress.reported_ns < running.feed.since_ns
    passed_ms = (
        -step_ms + 1 if -500 < step_ms < 0 else 0
    )  # so long a stamp may be of before or of after
    running.turn(passed_ms + 10)
    after_ns = running.clocks.now_ns()
    assert running.hear(after_ns)
    assert not running.gaps  # none of its numbers is missing
    assert running.feed.sources.known["Node"].progress.reported_ns == after_ns


@pytest.mark.parametrize("number", [-1, 3])
def test_an_end_of_a_call_that_is_received_twice_happens_once(number: int) -> None:
    """Where an end has no number, who it was, in which call and when tell it from others."""
    clocks = Clocks()
    feed = made(clocks)
    tap: Any = Tap()
    feed.start(tap)
    clocks.passed_ns += 10 * MS
    stamp = clocks.now_ns()
    first = Observation(
        stamp_ns=stamp,
        received_ns=stamp,
        channel="/ask",
        kind=ObservationKind.RESPONSE_RECEIVED,
        type_name="probe_interfaces/srv/Ask",
        data=None,
        source="Probe",
        sequence=number,
        client="Probe",
        call=4,
        error="no response",
    )
    following = number + 1 if number >= 0 else -1
    later = msgspec.structs.replace(first, stamp_ns=stamp + 1, call=5, sequence=following)
    judged = [feed.take(seen, stamp + MS).judged for seen in (first, first, later, first, later)]
    assert [one is not None for one in judged] == [True, False, True, False, False]


def test_what_comes_in_a_name_that_several_claim_is_not_missing_before_the_next() -> None:
    running = Running()
    assert running.hear(running.clocks.now_ns())
    for is_contested in (True, True, False):
        running.turn(20)
        listener: Any = Tap()
        listener.is_contested = lambda name, told=is_contested: told
        running.feed.listener = listener
        assert running.hear(running.clocks.now_ns()) != is_contested
        whys = [gap.why for gap in running.gaps]
        assert whys == ["several sessions claim to be Node"] * is_contested


class KnowsLess(Tap):
    """It learns late that it does not know some things."""

    def __init__(self) -> None:
        self.unknown: dict[BlindSpot, str] = {}

    def blind_spots(self) -> dict[BlindSpot, str]:
        return self.unknown


@pytest.mark.parametrize("kind", BlindSpotKind)
def test_what_a_tap_does_not_know_may_have_been_so_before_it_says_so(kind: BlindSpotKind) -> None:
    clocks, tap = Clocks(), KnowsLess()
    feed = made(clocks)
    listener: Any = tap
    since_ns = feed.start(listener)

    def begins(turns: int) -> set[int]:
        """When what is missing begins, after the listening did (ms), after so many turns of 20 ms."""
        for _ in range(turns):
            clocks.passed_ns += 20 * MS
            gaps = feed.tick(clocks.now_ns(), clocks.steady_ns())[1]
        return {(gap.from_ns - since_ns) // MS for gap in gaps}

    assert begins(50) == set()
    tap.unknown[BlindSpot(kind, "", "node")] = "nobody tells"
    assert begins(1) == {0}
    assert begins(1) == {1040 - LATENCY_NS // MS}
    tap.unknown = {}
    assert begins(50) == set()
    tap.unknown = {BlindSpot(kind, "", "node"): "nobody tells"}
    assert begins(1) == {0}
