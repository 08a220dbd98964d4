"""A call is shown once, whichever of its ends is heard first, and nothing is kept for ever."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest
from msgspec.structs import replace

from moon.tap import stream
from moon.tap.stream import CallMatcher, Line
from transports.interface import Observation, ObservationKind

_spec = importlib.util.spec_from_file_location("observed", Path(__file__).with_name("observed.py"))
observed = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(observed)
seen, message = observed.seen, observed.message
SENT, RECEIVED, ANSWERED, RETURNED = (
    observed.SENT,
    observed.RECEIVED,
    observed.ANSWERED,
    observed.RETURNED,
)
SECOND = 1_000_000
"""In microseconds, as the stamps of these tests are."""


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


def test_the_first_response_of_a_service_waits_for_the_name_of_who_answered() -> None:
    matcher = CallMatcher()
    matcher.feed(seen(SENT, 0))
    assert matcher.feed(seen(RETURNED, 90)) is None
    response = matcher.feed(seen(RECEIVED, 30))
    assert (response.kind, response.source, response.client) == ("response", "server", "client")
    assert matcher.feed(seen(ANSWERED, 60)) is None


def test_the_answerer_is_remembered_from_the_calls_before() -> None:
    matcher = CallMatcher()
    for event in (seen(RECEIVED, 30), seen(ANSWERED, 60), seen(SENT, 0), seen(RETURNED, 90)):
        matcher.feed(event)
    matcher.feed(seen(SENT, 200, call=2))
    response = matcher.feed(seen(RETURNED, 290, call=2))
    assert response.source == "server"


def test_a_server_that_says_nothing_is_waited_for_once_and_left_unnamed() -> None:
    matcher = CallMatcher()
    matcher.feed(seen(SENT, 0))
    assert matcher.feed(seen(RETURNED, 90)) is None
    assert matcher.one_ended(400_000_000) == []
    (response,) = matcher.one_ended(2_000_000_000)
    assert (response.kind, response.source, response.round_trip_us) == ("response", "", 90)
    matcher.feed(seen(SENT, 200, call=2))
    assert matcher.feed(seen(RETURNED, 290, call=2)).source == ""


def test_a_call_that_nobody_answered_has_no_answerer() -> None:
    matcher = CallMatcher()
    for event in (seen(RECEIVED, 30), seen(ANSWERED, 60), seen(SENT, 0), seen(RETURNED, 90)):
        matcher.feed(event)
    for call, error, answerer in (
        (2, "timeout: /s: no answer within the time limit", ""),
        (3, "unavailable: /s: nobody answers", ""),
        (4, "remote_error: not today", "server"),
    ):
        matcher.feed(seen(SENT, 100, call))
        response = matcher.feed(seen(RETURNED, 200, call, error=error))
        assert (response.source, response.error) == (answerer, error)


def test_a_client_without_events_is_shown_from_the_servers_end() -> None:
    matcher = CallMatcher()
    matcher.feed(seen(RECEIVED, 30))
    assert matcher.feed(seen(ANSWERED, 70)) is None
    assert matcher.one_ended(100_000) == []
    (shown,) = matcher.one_ended(2_000_000_000)
    assert (shown.kind, shown.round_trip_us) == ("response", 40)
    assert matcher.open_calls == 0


def test_calls_of_a_tool_that_does_not_number_them_are_each_shown() -> None:
    events = [seen(kind, 10, call=-1, client="") for kind in (RECEIVED, ANSWERED) * 3]
    shown = lines(*events)
    assert [line.kind for line in shown] == ["request", "response"] * 3
    assert {(line.source, line.call) for line in shown if line.kind == "response"} == {
        ("server", 0)
    }


def test_a_response_whose_request_was_not_heard_is_shown_without_a_round_trip() -> None:
    matcher = CallMatcher()
    matcher.feed(seen(ANSWERED, 60))
    response = matcher.feed(seen(RETURNED, 90))
    assert (response.kind, response.source, response.round_trip_us) == ("response", "server", None)


def test_a_request_without_a_response_is_reported_once_and_a_late_response_is_shown() -> None:
    matcher = CallMatcher()
    matcher.feed(seen(RECEIVED, 1))
    matcher.feed(seen(SENT, 0))
    (late,) = matcher.unanswered(11_000_000_000, 10.0)
    assert (late.kind, late.source, late.error) == ("unanswered", "client", "no response for 10 s")
    assert matcher.unanswered(12_000_000_000, 10.0) == []
    assert matcher.feed(seen(RETURNED, 12 * SECOND)).round_trip_us == 12 * SECOND


def test_the_age_of_a_request_is_that_since_it_was_heard_whatever_its_nodes_clock_says() -> None:
    matcher = CallMatcher()
    now = 1_000 * SECOND
    matcher.feed(seen(SENT, 0, call=1, received_micros=now))  # a clock that is slow
    matcher.feed(seen(SENT, 5_000 * SECOND, call=2, received_micros=now - 11 * SECOND))  # fast
    assert [line.call for line in matcher.unanswered(now * 1000, 10.0)] == [2]


def test_the_result_of_a_goal_is_never_late() -> None:
    matcher = CallMatcher()
    matcher.feed(seen(SENT, 0, channel="/a/_action/get_result"))
    matcher.feed(seen(SENT, 0, channel="/a/_action/send_goal"))
    assert [line.part for line in matcher.unanswered(11_000_000_000, 10.0)] == ["goal"]


def test_calls_beyond_what_is_remembered_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "MAX_OPEN_CALLS", 3)
    matcher = CallMatcher()
    for call in range(10):
        matcher.feed(seen(SENT, call, call))
    assert (matcher.open_calls, matcher.forgotten) == (3, 7)


def test_a_call_reported_as_unanswered_is_not_counted_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(stream, "MAX_OPEN_CALLS", 3)
    matcher = CallMatcher()
    for call in range(3):
        matcher.feed(seen(SENT, call, call))
    assert len(matcher.unanswered(11_000_000_000, 10.0)) == 3
    matcher.feed(seen(SENT, 3, 3))
    assert (matcher.open_calls, matcher.forgotten) == (3, 0)


def test_a_response_that_waits_for_a_name_is_shown_even_if_its_call_is_dropped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(stream, "MAX_OPEN_CALLS", 1)
    matcher = CallMatcher()
    matcher.feed(seen(SENT, 0))
    matcher.feed(seen(RETURNED, 90))
    matcher.feed(seen(SENT, 100, call=2))
    assert [line.call for line in matcher.one_ended(0)] == [1]
    assert matcher.forgotten == 0


def test_what_is_remembered_of_ended_calls_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "MAX_OPEN_CALLS", 5)
    matcher = CallMatcher()
    for call in range(100):
        matcher.feed(seen(RECEIVED, call, call, channel=f"/s{call}"))
        matcher.feed(seen(ANSWERED, call, call, channel=f"/s{call}"))
        matcher.one_ended(10**18)
        matcher.feed(seen(SENT, call, call + 1000))
        matcher.unanswered(10**18, 10.0)
    assert len(matcher._open) <= 5
    assert len(matcher._closed) <= 5
    assert len(matcher._servers) <= 5


@pytest.mark.parametrize(
    ("channel", "kind", "part"),
    [
        ("send_goal", SENT, "goal"),
        ("send_goal", RETURNED, "goal response"),
        ("get_result", SENT, "result request"),
        ("get_result", RETURNED, "result"),
        ("cancel_goal", SENT, "cancel"),
        ("cancel_goal", RETURNED, "cancel response"),
    ],
)
def test_calls_of_an_action_are_its_parts(channel, kind, part) -> None:
    matcher = CallMatcher()
    matcher.feed(seen(RECEIVED, 0, call=7, channel=f"/x/go/_action/{channel}"))
    events = [SENT] if kind is SENT else [SENT, RETURNED]
    shown = [matcher.feed(seen(event, 0, channel=f"/x/go/_action/{channel}")) for event in events]
    assert (shown[-1].action, shown[-1].part) == ("/x/go", part)


@pytest.mark.parametrize("part", ["feedback", "status"])
def test_topics_of_an_action_are_its_parts(part) -> None:
    (line,) = lines(message(f"/go/_action/{part}", {}))
    assert (line.kind, line.action, line.part) == ("message", "/go", part)


def test_a_channel_that_only_looks_like_an_action_is_none() -> None:
    (line,) = lines(message("/go/_action/other", {}))
    assert (line.action, line.part) == ("", "")


def test_what_open_calls_hold_is_bounded_in_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream, "MAX_OPEN_BYTES", 10_000)
    matcher = CallMatcher()
    for call in range(50):
        matcher.feed(seen(SENT, call, call, data={"text": "x" * 1000}))
    assert (matcher.open_calls, matcher.forgotten) == (9, 41)
    matcher.feed(
        seen(SENT, 50, 50, data={"text": "x" * 50_000})
    )  # the last one is kept, whatever it holds
    assert matcher.open_calls == 1
    for kind in (RECEIVED, ANSWERED, RETURNED):
        matcher.feed(seen(kind, 60, 50))
    assert (matcher.open_calls, matcher._bytes) == (0, 0)


def test_a_message_taken_says_by_whom_whose_and_which() -> None:
    taken = replace(
        message("/a", None, 5), kind=ObservationKind.MESSAGE_TAKEN, client="sensor", call=7
    )
    (line,) = lines(taken)
    assert (line.kind, line.source, line.client, line.call) == ("taken", "node", "sensor", 7)
    assert line.data is None


def test_a_client_that_has_started_again_counts_its_calls_anew() -> None:
    former = [seen(SENT, 0), seen(RECEIVED, 30), seen(ANSWERED, 60), seen(RETURNED, 90)]
    later = [replace(event, stamp_ns=event.stamp_ns + SECOND) for event in former]
    shown = lines(
        *(replace(event, client_life=3) for event in former),
        *(replace(event, client_life=7) for event in later),
    )
    assert [line.kind for line in shown] == ["request", "response"] * 2
