"""What every transport must do with calls of services.

Every public function is a check.
"""

from __future__ import annotations

from typing import Any

from transports.conformance.stage import (
    DOUBLE,
    Answer,
    Ask,
    calls,
    on,
    ready,
    refused,
)
from transports.interface import (
    CallOutcome,
)
from transports.networks import PATIENCE_S, Network


def a_call_gets_its_own_answer_even_when_answers_are_deferred(network: Network) -> None:
    """Requests are kept and answered later, in reverse: each result belongs to its call."""
    server, client = network.node("server"), network.node("client")
    kept: list[Any] = []

    def handle(request: Any) -> None:
        kept.append(request)
        if len(kept) == 10:
            server.after(0.01, answer_all)

    def answer_all() -> None:
        for request in reversed(kept):
            request.respond(Answer(2 * request.data.value))

    on(network, server, lambda: server.serve(DOUBLE, handle))
    ready(network, server, client)
    results = calls(network, client, range(10))
    assert network.until(lambda: len(results) >= 10), f"only {len(results)} of 10 calls ended"
    for value, result in results:
        assert result.outcome is CallOutcome.RESPONSE, f"call {value} ended: {result}"
        assert result.response.value == 2 * value, f"call {value} got {result.response.value}"
    clients = {request.client for request in kept}
    assert clients == {"client"}, f"requests name their client as {clients}"


def a_caller_may_wait_on_a_thread_of_its_own(network: Network) -> None:
    """``call_and_wait`` returns the response; on the executor it is refused."""
    server, client = network.node("server"), network.node("client")
    on(network, server, lambda: server.serve(DOUBLE, lambda r: r.respond(Answer(2 * r.data.value))))
    ready(network, server, client)
    caller = on(network, client, lambda: client.client(DOUBLE))
    result = network.caller(lambda: caller.call_and_wait(Ask(21), PATIENCE_S))()
    assert result.outcome is CallOutcome.RESPONSE, f"the call ended: {result}"
    assert result.response.value == 42, f"the answer is {result.response.value}, not 42"
    refused(network, client, lambda: caller.call_and_wait(Ask(1)), "waiting on the executor")


def a_remote_error_carries_its_text(network: Network) -> None:
    """``Request.fail`` ends the call with REMOTE_ERROR and the reason."""
    server, client = network.node("server"), network.node("client")
    on(network, server, lambda: server.serve(DOUBLE, lambda r: r.fail("no arms, no doubling")))
    ready(network, server, client)
    results = calls(network, client, range(1))
    assert network.until(lambda: bool(results)), "the call does not end"
    assert results[0][1].outcome is CallOutcome.REMOTE_ERROR, f"it ended: {results[0][1]}"
    assert "no arms, no doubling" in results[0][1].error, f"its error: {results[0][1].error}"


def a_call_without_an_answer_times_out_once(network: Network) -> None:
    """The answer that comes too late changes nothing."""
    server, client = network.node("server"), network.node("client")
    kept: list[Any] = []
    on(network, server, lambda: server.serve(DOUBLE, kept.append))
    ready(network, server, client)
    before = calls(network, client, range(1))  # the way to the server may have to be found
    assert network.until(lambda: bool(kept)), "a call does not arrive"
    on(network, server, lambda: kept[0].respond(Answer(0)))
    assert network.until(lambda: bool(before)), "a call that is answered does not end"
    results = calls(network, client, range(1, 2), timeout_s=0.2)
    assert network.until(lambda: bool(results)), "the call does not end"
    assert results[0][1].outcome is CallOutcome.TIMEOUT, f"it ended: {results[0][1]}"
    assert network.until(lambda: len(kept) == 2), "the call does not arrive"
    on(network, server, lambda: kept[1].respond(Answer(1)))
    again = calls(network, client, range(2, 3))
    assert network.until(lambda: len(kept) == 3), "the next call does not arrive"
    on(network, server, lambda: kept[2].respond(Answer(2)))
    assert network.until(lambda: bool(again)), "the next call does not end"
    assert again[0][1].response.value == 2, "the next call got an answer that is not its own"
    assert len(results) == 1, f"the call without an answer ended {len(results)} times"


def a_call_that_nobody_serves_is_unavailable_or_times_out(network: Network) -> None:
    """UNAVAILABLE where the middleware can know, TIMEOUT where it cannot; never a hang."""
    client = network.node("client")
    ready(network, client)
    results = calls(network, client, range(1), timeout_s=0.5)
    assert network.until(lambda: bool(results)), "the call does not end"
    outcome = results[0][1].outcome
    assert outcome in (CallOutcome.UNAVAILABLE, CallOutcome.TIMEOUT), f"it ended: {outcome}"
    assert results[0][1].error, "and does not say why"


def a_request_is_answered_once(network: Network) -> None:
    """A second answer is a TransportError."""
    server, client = network.node("server"), network.node("client")
    kept: list[Any] = []
    on(network, server, lambda: server.serve(DOUBLE, kept.append))
    ready(network, server, client)
    results = calls(network, client, range(1))
    assert network.until(lambda: bool(kept)), "the request does not arrive"
    on(network, server, lambda: kept[0].respond(Answer(1)))
    refused(network, server, lambda: kept[0].respond(Answer(2)), "a second answer")
    refused(network, server, lambda: kept[0].fail("no"), "an error after the answer")
    assert network.until(lambda: bool(results)), "the call does not end"


def a_service_is_served_once_in_a_node(network: Network) -> None:
    """A second server in the same node is a TransportError that names the service."""
    server = network.node("server")
    on(network, server, lambda: server.serve(DOUBLE, lambda request: None))
    again = refused(network, server, lambda: server.serve(DOUBLE, lambda r: None), "it twice")
    assert DOUBLE.name in again, f"the refusal does not name the service: {again}"
