"""How calls end, and what clients and servers say of it, the same on every transport.

``Observation.error`` has the end of a call as text: its outcome, a colon and why. It is written and read
here.
"""

from __future__ import annotations

from typing import NoReturn

from transports.interface import CallOutcome, CallResult, Service, TransportError


def request_type(service: Service) -> str:
    """The type of a request of ``service``, as ROS 2 names it."""
    return f"{service.type_name}_Request"


def response_type(service: Service) -> str:
    """The type of a response of ``service``, as ROS 2 names it."""
    return f"{service.type_name}_Response"


def unserved(service: str) -> CallResult:
    """Nobody serves ``service``, or who served it is gone."""
    return CallResult(
        CallOutcome.UNAVAILABLE,
        error=f"{service}: no response: no node serves it, or its server ended",
    )


def abandoned(service: str) -> CallResult:
    """The node that served ``service`` ended before it answered."""
    return CallResult(CallOutcome.UNAVAILABLE, error=f"{service}: the node that serves it ended")


def closed(service: str) -> CallResult:
    """The node that calls ``service`` was closed before there was an answer."""
    return CallResult(CallOutcome.UNAVAILABLE, error=f"{service}: this node was closed")


def timed_out(service: str) -> CallResult:
    """There was no answer of ``service`` in time."""
    return CallResult(CallOutcome.TIMEOUT, error=f"{service}: no answer within the time limit")


def refused(error: str) -> CallResult:
    """The server has failed the call, and says why."""
    return CallResult(CallOutcome.REMOTE_ERROR, error=error)


def undecodable(service: str, why: object) -> CallResult:
    """What ``service`` has answered is no response of its type."""
    return refused(f"{service}: bad response: {why}")


def bad_request(why: object) -> str:
    """What a server fails a call with whose request it cannot decode."""
    return f"bad request: {why}"


def end_of(result: CallResult) -> str:
    """``Observation.error`` of a call that ended so; empty for a response."""
    if result.outcome is CallOutcome.RESPONSE:
        return ""
    return f"{result.outcome}: {result.error}"


def reason_of(end: str) -> str:
    """Why a call ended as ``Observation.error`` says: the text after its outcome; all of it without one."""
    return end.partition(": ")[2] or end


def refuse_to_wait(service: str) -> NoReturn:
    """TransportError: a handler may not wait for an answer.

    Raises:
        TransportError: always.
    """
    raise TransportError(
        f"call_and_wait of {service} on the executor's own thread: nothing else would run meanwhile; "
        "use call"
    )


def answered_already(call: int, client: str, service: str) -> TransportError:
    """The error of a second answer to one call; ``client`` may be empty."""
    return TransportError(
        f"call {call} of {client or 'an unnamed client'} to {service} is answered already"
    )
