"""Calls and goals are put together from their events, and each answer is given once."""

from __future__ import annotations

from typing import Any

from moon.replay.calls import Answers, CallBook, RecordedCall
from moon.replay.goals import GoalBook
from transports.interface import Observation, ObservationKind

SENT, RECEIVED = ObservationKind.REQUEST_SENT, ObservationKind.REQUEST_RECEIVED
ANSWERED, HEARD = ObservationKind.RESPONSE_SENT, ObservationKind.RESPONSE_RECEIVED


def seen(
    kind: ObservationKind,
    stamp_ns: int,
    data: Any,
    source: str = "",
    client: str = "c",
    call: int = 1,
    channel: str = "/s",
    error: str = "",
) -> Observation:
    return Observation(
        stamp_ns=stamp_ns,
        received_ns=stamp_ns,
        channel=channel,
        kind=kind,
        type_name="t/srv/S_Request",
        data=data,
        source=source,
        client=client,
        call=call,
        error=error,
    )


def book(*events: Observation) -> list[RecordedCall]:
    made = CallBook()
    for event in events:
        made.note(event)
    return made.calls["/s"]


def test_both_ends_of_a_call_are_one_call_with_the_servers_times():
    (call,) = book(
        seen(SENT, 10, {"a": 1}, "c"),
        seen(RECEIVED, 12, {"a": 1}, "server"),
        seen(HEARD, 30, {"b": 2}, "c"),
        seen(ANSWERED, 20, {"b": 2}, "server"),
    )
    assert (call.client, call.server, call.asked_ns, call.delay_ns) == ("c", "server", 12, 8)
    assert (call.request, call.response) == ({"a": 1}, {"b": 2})


def test_one_end_is_enough():
    (call,) = book(seen(SENT, 10, {"a": 1}, "c"), seen(HEARD, 30, {"b": 2}, "c"))
    assert (call.server, call.delay_ns, call.response) == ("", 20, {"b": 2})


def test_a_client_that_was_restarted_counts_anew():
    calls = book(
        seen(SENT, 1, 1), seen(HEARD, 2, 10), seen(SENT, 3, 2), seen(HEARD, 4, 20), seen(SENT, 5, 3)
    )
    assert [(call.request, call.response) for call in calls] == [(1, 10), (2, 20), (3, None)]


def test_calls_of_nobody_in_particular_are_answered_in_turn():
    calls = book(
        *(seen(RECEIVED, n, n, client="", call=0) for n in (1, 2)),
        *(seen(ANSWERED, n, n * 10, client="", call=0) for n in (3, 4)),
    )
    assert [(call.request, call.response) for call in calls] == [(1, 30), (2, 40)]


def test_an_answer_to_what_was_asked_before_the_recording_is_left_out():
    assert book(seen(HEARD, 1, 1)) == []


def test_an_equal_request_gets_its_next_answer_and_another_the_next_in_order():
    calls = [
        RecordedCall("/s", "c", {"a": request}, 0, "", 1, response)
        for request, response in ((1, "x"), (2, "y"), (1, "z"))
    ]
    answers = Answers(calls, lambda call: call.request, lambda call: call.is_answered)

    def to(request: Any) -> tuple[Any, bool]:
        found, is_equal = answers.to(request)
        return found and found.response, is_equal

    assert to({"a": 1}) == ("x", True)
    assert to({"a": 1}) == ("z", True)
    assert to({"a": 1}) == ("y", False)
    assert to({"a": 2}) == (None, False)


def test_what_nobody_answered_is_no_answer_and_an_error_is_one():
    calls = book(
        seen(SENT, 1, 1),
        seen(HEARD, 2, None, error="timeout: no response for 5 s"),
        seen(SENT, 3, 2, call=2),
        seen(HEARD, 4, None, call=2, error="remote_error: refused"),
    )
    assert [call.error for call in calls if call.is_answered] == ["remote_error: refused"]


def test_a_request_that_had_no_answer_has_none_again_and_another_gets_an_answer():
    calls = [
        RecordedCall("/s", "c", {"a": request}, 0, "s", 1 if response else 0, response)
        for request, response in ((1, "x"), (1, None), (1, "z"), (2, None), (3, "y"))
    ]
    answers = Answers(calls, lambda call: call.request, lambda call: call.is_answered)
    given = [answers.to({"a": request}) for request in (1, 1, 1, 4, 2, 2)]
    assert [(found and found.response, is_equal) for found, is_equal in given] == [
        ("x", True),
        (None, True),
        ("z", True),
        ("y", False),
        (None, True),
        (None, False),
    ]
    assert [found is None for found, _ in given] == [False] * 5 + [True]


def test_a_server_was_there_if_it_had_a_request_or_was_waited_for():
    def only(*events: Observation) -> RecordedCall:
        (call,) = book(*events)
        return call

    assert only(seen(RECEIVED, 1, 1, "s")).is_served
    assert only(seen(SENT, 1, 1), seen(HEARD, 2, None, error="timeout: 5 s")).is_served
    assert not only(seen(SENT, 1, 1), seen(HEARD, 2, None, error="unavailable: none")).is_served
    assert not only(seen(SENT, 1, 1)).is_served


def uuid(number: int) -> dict[str, list[int]]:
    return {"uuid": [number] * 16}


def test_a_goal_that_its_server_did_not_answer_is_one_and_one_that_nobody_served_is_none():
    calls = CallBook()
    send = "/a/_action/send_goal"
    for number, source in ((1, "nav"), (2, "")):
        asked = {"goal_id": uuid(number), "goal": {"poi": number}}
        calls.note(seen(SENT, number, asked, "c", call=number, channel=send))
        if source:
            calls.note(seen(RECEIVED, number, asked, source, call=number, channel=send))
    (goal,) = GoalBook().goals("/a", calls.calls)
    assert (goal.goal, goal.accepted, goal.call.is_answered) == ({"poi": 1}, False, False)


def test_a_goal_is_put_together_from_the_parts_of_its_action():
    calls, goals = CallBook(), GoalBook()
    send, result, cancel = (
        f"/a/_action/{part}" for part in ("send_goal", "get_result", "cancel_goal")
    )
    asked = {"goal_id": uuid(7), "goal": {"poi": 1}}
    for event in (
        seen(RECEIVED, 100, asked, "nav", channel=send),
        seen(ANSWERED, 110, {"accepted": True}, "nav", channel=send),
        seen(RECEIVED, 120, {"goal_id": uuid(7)}, "nav", channel=result),
        seen(RECEIVED, 150, {"goal_info": {"goal_id": uuid(7)}}, "nav", channel=cancel),
        seen(ANSWERED, 151, {"return_code": 0}, "nav", channel=cancel),
        seen(ANSWERED, 210, {"status": 5, "result": {"ok": False}}, "nav", channel=result),
    ):
        calls.note(event)
    feedback = seen(ObservationKind.MESSAGE, 130, {"goal_id": uuid(7), "feedback": {"left": 2}})
    goals.note_feedback(feedback)
    (goal,) = goals.goals("/a", calls.calls)
    assert (goal.goal, goal.accepted, goal.server) == ({"poi": 1}, True, "nav")
    assert goal.feedback == [(20, {"left": 2})]
    assert (goal.canceled_ns, goal.ended_ns, goal.status) == (40, 100, 5)
    assert goal.result == {"ok": False}


def test_a_call_is_over_when_all_its_four_events_were_heard():
    calls = [
        event
        for stamp in (10, 50)
        for event in (
            seen(SENT, stamp, {"a": stamp}, "c"),
            seen(RECEIVED, stamp + 1, {"a": stamp}, "server"),
            seen(ANSWERED, stamp + 2, {"b": stamp}, "server"),
            seen(HEARD, stamp + 3, {"b": stamp}, "c"),
        )
    ]
    made = CallBook()
    for event in calls:
        made.note(event)
        assert len(made._open["/s", "c", 1]) <= 1
    assert [call.request for call in made.calls["/s"]] == [{"a": 10}, {"a": 50}]
    assert not made._open["/s", "c", 1]
