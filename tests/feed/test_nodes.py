"""How far several nodes are, by their numbers and their answers."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from moon.feed.nodes import KEPT_SOURCES, Nodes
from transports.interface import Answer, Observation, ObservationKind

MS = 1_000_000
LATENCY = 200 * MS
NOW = 10_000 * MS


def seen(source: str, order: int, stamp: int, life: int = 0) -> Observation:
    return Observation(
        stamp_ns=stamp,
        received_ns=stamp,
        channel="/c",
        kind=ObservationKind.MESSAGE,
        type_name="t",
        data={},
        source=source,
        order=order,
        life=life,
    )


@pytest.fixture
def both() -> Nodes:
    """Two nodes, one of which reported something later than the other."""
    sources = Nodes(LATENCY)
    for name, stamp in (("a", NOW - 5 * MS), ("b", NOW - 90 * MS)):
        sources.changed(name, True, NOW - 1000 * MS)
        assert sources.take(seen(name, 0, stamp), NOW) is None
    return sources


def test_all_is_known_up_to_what_the_slowest_reported_last(both) -> None:
    assert both.known_ns(["a", "b"], NOW) == NOW - 90 * MS
    assert both.known_ns(["a"], NOW) == NOW - 5 * MS
    assert both.behind(["a", "b"], NOW - 50 * MS, NOW) == ["b"]


def test_an_answer_moves_it_once_all_that_it_names_was_received(both) -> None:
    both.answered("b", 2, NOW - MS)
    assert both.known_ns(["b"], NOW) == NOW - 90 * MS
    both.take(seen("b", 1, NOW - 20 * MS), NOW)
    assert both.known_ns(["b"], NOW) == NOW - MS


def test_it_is_never_later_than_now(both) -> None:
    assert both.known_ns(["a"], NOW - 50 * MS) == NOW - 50 * MS


def test_who_does_not_number_its_reports_tells_nothing(both) -> None:
    both.take(seen("stranger", -1, NOW), NOW)
    assert both.known_ns(["a", "stranger"], NOW) == 0
    assert both.behind(["a", "b", "stranger"], NOW, NOW) == []


def test_who_was_never_there_is_not_waited_for_and_alone_tells_nothing(both) -> None:
    assert both.known_ns(["a", "nobody"], NOW) == NOW - 5 * MS
    assert both.known_ns(["nobody"], NOW) == 0


def test_who_has_gone_is_waited_for_as_long_as_the_latency_bound(both) -> None:
    both.changed("b", False, NOW)
    assert both.known_ns(["a", "b"], NOW + LATENCY) == NOW - 90 * MS
    assert both.known_ns(["a", "b"], NOW + LATENCY + 1) == NOW - 5 * MS


def test_what_is_missing_is_a_gap_once_the_latency_bound_is_over(both) -> None:
    assert both.take(seen("b", 3, NOW), NOW) is None
    assert list(both.advance(NOW + LATENCY - 1)) == []
    assert both.known_ns(["b"], NOW) == NOW - 90 * MS
    (gap,) = both.advance(NOW + LATENCY)
    assert (gap.source, gap.from_ns, gap.until_ns) == ("b", NOW - 90 * MS + 1, NOW + 1)
    assert both.known_ns(["b"], NOW + LATENCY) == NOW


def test_a_node_that_starts_again_numbers_anew(both) -> None:
    for number in (1, 2, 3):
        both.take(seen("b", number, NOW - 80 * MS), NOW)
    assert both.take(seen("b", 0, NOW), NOW) is None
    assert both.known_ns(["b"], NOW) == NOW
    both.changed("b", True, NOW + MS)
    assert both.known_ns(["b"], NOW + 2 * MS) == 0


def test_of_what_was_before_the_first_report_nothing_is_missing() -> None:
    sources = Nodes(LATENCY)
    assert sources.take(seen("late", 70, NOW), NOW) is None
    assert list(sources.advance(NOW + LATENCY)) == []
    assert sources.known_ns(["late"], NOW + LATENCY) == NOW


def test_only_so_many_names_are_remembered() -> None:
    sources = Nodes(LATENCY)
    for number in range(KEPT_SOURCES + 10):
        sources.take(seen(f"n{number}", 0, NOW), NOW)
    assert len(sources.known) == KEPT_SOURCES


def test_what_overtook_others_while_a_clock_was_ahead_is_no_new_beginning_of_its_life() -> None:
    """Stamps that were ahead tell no time, so the newest that is known is older than what comes late."""
    nodes = Nodes(LATENCY)
    nodes.listening_ns = NOW - 2000 * MS
    nodes.changed("far", True, NOW - 1000 * MS)

    def take(order: int, stamp: int, is_timed: bool = True):
        return nodes.take(replace(seen("far", order, stamp), life=7), NOW, is_timed)

    assert take(0, NOW - 400 * MS) is None
    assert take(1, NOW + 400 * MS, is_timed=False) is None
    assert take(3, NOW + 400 * MS, is_timed=False) is not None
    assert take(2, NOW - 390 * MS) is None
    assert nodes.known["far"].progress.next == 4


def test_what_happened_before_the_monitor_listened_is_of_the_same_life_as_what_follows() -> None:
    """Its stamp tells nothing to the monitor; on its own clock it is later than the node's start."""
    sources = Nodes(LATENCY)
    sources.take(replace(seen("a", 24, NOW - MS), life=7), NOW, is_timed=False)
    sources.changed("a", True, NOW - 500 * MS)
    sources.take(replace(seen("a", 25, NOW), life=7), NOW)
    list(sources.advance(NOW + 2 * LATENCY))
    assert sources.known_ns(["a"], NOW + 2 * LATENCY) == NOW


def test_what_is_missing_of_another_life_is_where_its_numbers_are() -> None:
    sources = Nodes(LATENCY)
    sources.changed("a", True, NOW - 5000 * MS)
    sources.take(seen("a", 0, NOW - 4000 * MS), NOW - 4000 * MS)
    sources.changed("a", False, NOW - 3500 * MS)
    began = NOW - 3000 * MS
    sources.changed("a", True, began)
    sources.take(seen("a", 0, NOW - 2000 * MS), NOW - 2000 * MS)
    sources.take(seen("a", 2, NOW - 1500 * MS), NOW - 1500 * MS)
    assert [gap.until_ns for gap in sources.advance(NOW)] == [NOW - 1500 * MS + 1]
    sources.take(seen("a", 3, NOW), NOW)
    hole = (NOW - 2000 * MS, NOW - 1500 * MS)
    assert sources.missing_between("a", began - 1, NOW) == [hole]
    assert sources.missing_between("a", began + 10 * MS, NOW) == [hole]
    # it may have sent something in its life before, after all that was received of that
    before = (NOW - 4000 * MS, began)
    assert sources.missing_between("a", before[0], NOW) == [before, hole]
    assert sources.missing_between("a", before[0], began) == [before]


@pytest.mark.parametrize("is_received", [True, False], ids=["received before", "never received"])
@pytest.mark.parametrize("names_life", [True, False])
def test_an_answer_of_a_life_that_is_over_tells_nothing_of_the_next(
    is_received: bool, names_life: bool
) -> None:
    first, second = (1, 2) if names_life else (0, 0)
    sources = Nodes(LATENCY)
    sources.changed("a", True, NOW - 1000 * MS)
    if is_received:
        sources.take(seen("a", 0, NOW - 900 * MS, first), NOW - 900 * MS)
    before = Answer(NOW - 500 * MS, 5, life=first)
    assert not sources.is_past("a", before)
    sources.changed("a", True, NOW - 100 * MS)
    assert sources.is_past("a", before)
    assert not sources.is_past("a", Answer(NOW - 99 * MS, 0, life=second))


def test_a_life_that_was_told_by_nothing_but_its_reports_is_another_all_the_same() -> None:
    sources = Nodes(LATENCY)
    sources.take(seen("a", 0, NOW - 900 * MS, 1), NOW - 900 * MS)
    sources.take(seen("a", 0, NOW - 100 * MS, 2), NOW - 100 * MS)
    assert sources.is_past("a", Answer(NOW, 1, life=1))  # its host's clock is ahead, or was
    assert not sources.is_past("a", Answer(NOW, 1, life=2))
