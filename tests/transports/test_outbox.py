"""When a node tells its taps what it did: on a clock of the test's own."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable

from moon.oracle.bounds import Bounds
from transports.outbox import (
    AT_MOST_S,
    CALLER_S,
    DELAY_S,
    GROWTH,
    NEAR_S,
    QUIET_S,
    ROUNDS_S,
    SELDOM_S,
    Outbox,
)
from transports.timers import Timer


class Time:
    """An executor on a clock that goes on when the test says so."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.looks = 0
        self._due: list[tuple[float, int, Timer]] = []
        self._count = itertools.count()

    def after(self, delay_s: float, handler: Callable[[], None]) -> Timer:
        timer = Timer(0, 0, handler)
        heapq.heappush(self._due, (self.now_s + delay_s, next(self._count), timer))
        return timer

    def pass_until(self, end_s: float) -> None:
        while self._due and self._due[0][0] <= end_s:
            self.now_s, _, timer = heapq.heappop(self._due)
            if timer.handler is not None:
                self.looks += 1
                timer.handler()
        self.now_s = end_s


class Node:
    """A node that tells numbers, and when each of them left."""

    def __init__(self) -> None:
        self.time = Time()
        self.left: list[tuple[float, int]] = []
        self.outbox: Outbox[int] = Outbox(
            self.time,
            lambda item: self.left.append((self.time.now_s, item)),
            lambda: self.time.now_s,
        )
        self._count = itertools.count()

    def tell(self, at_s: float) -> None:
        self.time.pass_until(at_s)
        self.outbox.add(next(self._count))
        self.outbox.flush_later()

    def tick_complete(self, at_s: float) -> bool:
        self.time.pass_until(at_s)
        told = self.outbox.note_round()
        if told:
            self.outbox.tick_complete()
        return told


def test_what_a_tick_tells_leaves_in_one_burst_after_the_delay():
    node = Node()
    for at_s in (0.0, 0.0001, 0.0002, 0.0004):
        node.tell(at_s)
    node.time.pass_until(1.0)
    assert node.left == [(DELAY_S, number) for number in range(4)]
    assert node.time.looks == 1


def test_nothing_leaves_while_the_node_is_at_work():
    node = Node()
    for at_s in (0.0, 0.001, 0.002, 0.0035):
        node.tell(at_s)
    node.time.pass_until(1.0)
    assert node.left == [(0.0035 + QUIET_S, number) for number in range(4)]


def at_work_all_the_time(node: Node, from_s: float = 0.0) -> list[float]:
    """What was told when within half a second."""
    told = [from_s + number * 0.001 for number in range(500)]
    for at_s in told:
        node.tell(at_s)
    node.time.pass_until(told[-1] + 0.5)
    return told


def test_a_node_that_is_never_quiet_tells_each_event_in_time():
    node = Node()
    told = at_work_all_the_time(node)
    waits_s = [left_s - told[number] for left_s, number in node.left]
    assert [number for _, number in node.left] == list(range(500))
    assert max(waits_s) <= SELDOM_S + 1e-9
    assert len({left_s for left_s, _ in node.left}) < 18  # bursts


def test_its_bursts_get_rare_step_by_step():
    node = Node()
    told = at_work_all_the_time(node)
    at_first = [left_s for left_s, _ in node.left if left_s < 0.04]
    lags_s = [left_s - told[number] for left_s, number in node.left]
    assert max(lags_s[: len(at_first)]) <= AT_MOST_S + 1e-9
    longest_s = AT_MOST_S
    for lag_s in lags_s:
        assert lag_s <= GROWTH * longest_s + 0.001
        longest_s = max(longest_s, lag_s)


def test_after_a_pause_they_are_as_before():
    node = Node()
    at_work_all_the_time(node)
    node.left.clear()
    node.tell(2.0)
    node.time.pass_until(3.0)
    assert [left_s for left_s, _ in node.left] == [2.0 + DELAY_S]


def test_who_is_at_work_now_and_then_after_that_does_not_wait_as_long():
    node = Node()
    at_work_all_the_time(node)
    node.left.clear()
    calls = [2.0 + 0.03 * number for number in range(20)]
    for at_s in calls:
        node.tell(at_s)
    node.time.pass_until(4.0)
    assert (
        max(left_s - at_s for (left_s, _), at_s in zip(node.left, calls, strict=True)) <= AT_MOST_S
    )


def test_a_long_tick_makes_them_no_rarer():
    node = Node()
    for tick in range(5):
        for part in range(4):
            node.tell(tick * 0.1 + part * 0.01)
    node.time.pass_until(1.0)
    assert max(
        left_s - (number // 4 * 0.1 + number % 4 * 0.01) for left_s, number in node.left
    ) <= (AT_MOST_S + 1e-9)


def test_an_event_waits_for_less_than_a_monitor_allows_for():
    assert DELAY_S + QUIET_S <= AT_MOST_S
    assert Bounds().latency / 1e9 >= 4 * SELDOM_S


def test_a_call_that_takes_its_time_is_told_at_once_and_what_follows_later():
    node = Node()
    node.tell(0.0)
    node.time.pass_until(0.001)
    node.outbox.flush()
    assert node.left == [(0.001, 0)]
    node.tell(0.1)
    node.time.pass_until(1.0)
    assert node.left[1:] == [(0.1 + DELAY_S, 1)]


def test_a_node_that_closes_tells_what_is_left_and_nothing_after_it():
    node = Node()
    node.tell(0.0)
    node.outbox.close()
    node.tell(0.001)
    node.time.pass_until(1.0)
    node.outbox.close()
    assert node.left == [(0.0, 0)]


def test_who_calls_one_service_after_the_other_is_not_looked_at_before_its_tick_is_over():
    node = Node()
    for number in range(5):
        node.time.pass_until(number / 1000)
        node.outbox.add(number)
        node.outbox.flush_later(CALLER_S)
    node.time.pass_until(1.0)
    assert node.left == [(CALLER_S, number) for number in range(5)]
    assert node.time.looks == 1


def test_what_is_kept_leaves_when_the_round_is_over_and_nobody_looks_again():
    node = Node()
    node.tell(0.0)
    assert node.tick_complete(0.001)
    node.time.pass_until(1.0)
    assert node.left == [(0.001, 0)]
    assert node.time.looks == 0


def node_near_the_end_of_rounds() -> Node:
    node = Node()
    node.tell(0.0)
    node.tick_complete(NEAR_S)
    assert node.left == [(DELAY_S, 0)]
    return node


def test_who_worked_near_the_end_of_a_round_waits_for_the_end_of_the_next():
    node = node_near_the_end_of_rounds()
    node.tell(1.0)
    node.tell(1.0 + AT_MOST_S / 2)
    assert node.tick_complete(1.0 + AT_MOST_S * 0.9)
    assert node.left[1:] == [(1.0 + AT_MOST_S * 0.9, 1), (1.0 + AT_MOST_S * 0.9, 2)]


def test_who_worked_long_before_its_end_does_not():
    node = node_near_the_end_of_rounds()
    node.tell(0.2)
    node.tick_complete(0.201 + NEAR_S)
    node.tell(0.4)
    node.time.pass_until(1.0)
    assert node.left[1:] == [(0.201 + NEAR_S, 1), (0.4 + DELAY_S, 2)]


def test_where_rounds_are_rare_their_end_may_be_further_away():
    for period_s, waits in ((0.2, False), (0.4, True), (4.0, True)):
        node = Node()
        for number in range(4):
            node.tell(number * period_s)
            node.tick_complete(number * period_s + 0.009)
        node.tell(4 * period_s)
        assert node.tick_complete(4 * period_s + 0.009) is waits, period_s


def test_no_round_is_so_rare_that_a_node_waits_longer_than_it_may():
    node = Node()
    for second in (0.0, 4.0, 8.0):
        node.tell(second)
        node.tick_complete(second + 1.1 * AT_MOST_S)
    node.tell(12.0)
    node.time.pass_until(13.0)
    assert node.left[3:] == [(12.0 + DELAY_S, 3)]


def test_who_worked_twice_in_a_round_began_with_the_first():
    node = Node()
    for beginning in (0.0, 0.2, 0.4):
        node.tell(beginning)
        node.tell(beginning + 4 * NEAR_S)
        node.tick_complete(beginning + 4 * NEAR_S + DELAY_S / 2)
    node.tell(0.6)
    node.time.pass_until(0.6 + 1.1 * DELAY_S)
    assert node.left[-1] == (0.6 + DELAY_S, 6)


def test_one_round_that_is_longer_than_the_others_changes_nothing():
    node = Node()
    for number, before_s in enumerate((0.6 * NEAR_S, 0.6 * NEAR_S, 1.5 * NEAR_S)):
        node.tell(number / 5)
        node.tick_complete(number / 5 + before_s)
    node.tell(3 / 5)
    assert node.tick_complete(3 / 5 + AT_MOST_S * 0.9)


def test_a_round_without_its_work_teaches_a_node_nothing():
    node = node_near_the_end_of_rounds()
    node.tick_complete(1.0)
    node.tell(2.0)
    assert node.tick_complete(2.0 + AT_MOST_S * 0.9)


def test_nothing_waits_longer_for_a_round_that_does_not_end():
    node = node_near_the_end_of_rounds()
    node.tell(1.0)
    node.time.pass_until(2.0)
    assert node.left[1:] == [(1.0 + AT_MOST_S, 1)]


def test_rounds_that_end_no_more_are_not_waited_for():
    node = node_near_the_end_of_rounds()
    node.tell(NEAR_S + ROUNDS_S)
    node.time.pass_until(ROUNDS_S + 1)
    assert node.left[1:] == [(NEAR_S + ROUNDS_S + DELAY_S, 1)]


def test_rounds_in_quick_succession_share_a_burst():
    node = Node()
    node.tell(0.0)
    assert node.tick_complete(0.001)
    node.tell(0.002)
    assert not node.tick_complete(0.003)
    node.tell(0.004)
    node.time.pass_until(1.0)
    assert node.left == [(0.001, 0), (0.002 + AT_MOST_S, 1), (0.002 + AT_MOST_S, 2)]


def test_a_round_without_anything_to_tell_is_not_worth_a_word():
    node = Node()
    assert not node.tick_complete(0.0)
    node.outbox.tick_complete()
    assert node.left == []
