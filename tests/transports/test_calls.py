"""What is said of calls that ended, the same on every transport."""

from __future__ import annotations

import pytest

from transports import calls
from transports.interface import CallOutcome, CallResult, TransportError

ENDS = [
    (calls.unserved("/s"), "unavailable: /s: no response: no node serves it, or its server ended"),
    (calls.abandoned("/s"), "unavailable: /s: the node that serves it ended"),
    (calls.closed("/s"), "unavailable: /s: this node was closed"),
    (calls.timed_out("/s"), "timeout: /s: no answer within the time limit"),
    (calls.refused("out of: paint"), "remote_error: out of: paint"),
    (calls.undecodable("/s", "no map"), "remote_error: /s: bad response: no map"),
]


@pytest.mark.parametrize(("result", "text"), ENDS)
def test_an_end_is_written_and_read_as_one_text(result: CallResult, text: str) -> None:
    assert calls.end_of(result) == text
    assert calls.reason_of(text) == result.error


def test_a_response_is_no_end_to_tell_of() -> None:
    assert calls.end_of(CallResult(CallOutcome.RESPONSE, response=1)) == ""


def test_what_another_reports_without_an_outcome_is_its_reason() -> None:
    assert calls.reason_of("no paint") == "no paint"


def test_a_second_answer_names_the_call() -> None:
    error = calls.answered_already(7, "", "/s")
    assert str(error) == "call 7 of an unnamed client to /s is answered already"
    assert "of painter to" in str(calls.answered_already(7, "painter", "/s"))


def test_a_handler_may_not_wait() -> None:
    with pytest.raises(TransportError, match="call_and_wait of /s on the executor's own thread"):
        calls.refuse_to_wait("/s")
