"""A call is shown once, whichever of its ends is heard first."""

from __future__ import annotations

from moon.tap.command import matches
from moon.tap.statistics import Statistics, table
from moon.tap.stream import CallMatcher, Line
from transports.interface import Observation, ObservationKind

SENT, RECEIVED = ObservationKind.REQUEST_SENT, ObservationKind.REQUEST_RECEIVED
ANSWERED, RETURNED = ObservationKind.RESPONSE_SENT, ObservationKind.RESPONSE_RECEIVED


def seen(kind: ObservationKind, micros: int, call: int = 1) -> Observation:
    source = "server" if kind in (RECEIVED, ANSWERED) else "client"
    return Observation(
        stamp_ns=micros * 1000,
        received_ns=micros * 1000,
        channel="/s",
        kind=kind,
        type_name="p/srv/S",
        data={},
        source=source,
        client="client",
        call=call,
    )


def lines(*events: Observation) -> list[Line]:
    matcher = CallMatcher()
    return [line for event in events if (line := matcher.feed(event)) is not None]


def test_the_client_end_heard_first_is_shown_once() -> None:
    shown = lines(seen(SENT, 0), seen(RETURNED, 90), seen(RECEIVED, 30), seen(ANSWERED, 60))
    assert [line.kind for line in shown] == ["request", "response"]
    assert shown[1].round_trip_us == 90


def test_the_server_end_heard_first_is_shown_once_with_the_clients_round_trip() -> None:
    shown = lines(seen(RECEIVED, 30), seen(ANSWERED, 60), seen(SENT, 0), seen(RETURNED, 90))
    assert [line.kind for line in shown] == ["request", "response"]
    assert shown[1].round_trip_us == 90
    assert shown[1].source == "server"


def test_a_client_without_events_is_shown_from_the_servers_end() -> None:
    matcher = CallMatcher()
    matcher.feed(seen(RECEIVED, 30))
    assert matcher.feed(seen(ANSWERED, 70)) is None
    assert matcher.answered_unheard(100_000) == []
    (shown,) = matcher.answered_unheard(2_000_000_000)
    assert (shown.kind, shown.round_trip_us) == ("response", 40)
    assert matcher.open_calls == 0


def test_a_request_without_a_response_is_reported_once() -> None:
    matcher = CallMatcher()
    matcher.feed(seen(SENT, 0))
    (late,) = matcher.unanswered(11_000_000_000, 10.0)
    assert (late.kind, late.error) == ("unanswered", "no response for 10 s")
    assert matcher.unanswered(12_000_000_000, 10.0) == []
    assert matcher.feed(seen(RETURNED, 99)) is None


def test_statistics_count_requests_and_round_trips() -> None:
    statistics = Statistics()
    for call in range(3):
        start = call * 1_000_000
        for line in lines(seen(SENT, start, call), seen(RETURNED, start + 200 + call, call)):
            statistics.add(line)
    assert statistics.rows() == [("/s", "3", "1.0", "201", "202", "")]
    assert table(statistics)[0].startswith("channel")


def test_a_glob_stays_within_one_part_unless_doubled() -> None:
    assert matches("/a/b", "/a/*")
    assert not matches("/a/b/c", "/a/*")
    assert matches("/a/b/c", "/a/**")
    assert not matches("/ab", "/a")
