"""The conformance suite: what every transport must do, as checks that any of them can be put to.

A check is a function of a :class:`~transports.networks.Network` that raises AssertionError, saying
what is wrong. With pytest::

    @pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
    def test_my_transport(check):
        network = ThreadedNetwork(lambda name, others: connect(name, {...}))
        try:
            check(network)
        finally:
            network.close()
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from typing import Any

import msgspec

from transports.interface import (
    Action,
    CallOutcome,
    CallResult,
    GoalEvents,
    GoalHandle,
    GoalStatus,
    Observation,
    ObservationKind,
    Service,
    Timer,
    Topic,
    Transport,
    TransportError,
)
from transports.networks import PATIENCE_S, Network

Check = Callable[[Network], None]
CHECKS: list[Check] = []
"""Every check, in the order of this file."""

COUNT = 200


class Number(msgspec.Struct, forbid_unknown_fields=True):
    """A message with a number and a text."""

    __type_name__ = "conformance/msg/Number"
    value: int = 0
    text: str = ""


class Text(msgspec.Struct, forbid_unknown_fields=True):
    """A message of another type."""

    __type_name__ = "conformance/msg/Text"
    text: str = ""


class Ask(msgspec.Struct, forbid_unknown_fields=True):
    """A request."""

    __type_name__ = "conformance/srv/Double_Request"
    value: int = 0


class Answer(msgspec.Struct, forbid_unknown_fields=True):
    """A response."""

    __type_name__ = "conformance/srv/Double_Response"
    value: int = 0


NUMBERS = Topic("/conformance/numbers", Number.__type_name__, Number)
LATCHED = Topic("/conformance/latched", Number.__type_name__, Number, latched=True)
DOUBLE = Service("/conformance/double", "conformance/srv/Double", Ask, Answer)
COUNTING = Action("/conformance/count", "conformance/action/Count", Number, Text, Number)


def _check(function: Check) -> Check:
    CHECKS.append(function)
    return function


def on(network: Network, node: Transport, work: Callable[[], Any]) -> Any:
    """``work()`` on the executor of ``node``; its value, or the TransportError it raises."""
    done: list[tuple[Any, TransportError | None]] = []

    def run() -> None:
        try:
            done.append((work(), None))
        except TransportError as error:
            done.append((None, error))

    node.post(run)
    assert network.until(lambda: bool(done)), f"{node.node}: posted work did not run"
    value, error = done[0]
    if error is not None:
        raise error
    return value


def ready(network: Network, *nodes: Transport) -> None:
    """Announce ``nodes`` and wait until each has seen all."""
    names = [node.node for node in nodes]
    for node in nodes:
        on(network, node, node.announce)
    for node in nodes:
        missing = network.caller(partial(node.wait_for_nodes, names, PATIENCE_S))()
        assert not missing, f"{node.node} does not see {missing} although they are announced"


def refused(network: Network, node: Transport, work: Callable[[], Any], what: str) -> str:
    """The text of the TransportError that ``work`` must raise."""
    try:
        on(network, node, work)
    except TransportError as error:
        return str(error)
    raise AssertionError(f"{what} is not refused")


def calls(
    network: Network, node: Transport, values: range, timeout_s: float = PATIENCE_S
) -> list[tuple[int, CallResult]]:
    """Results as they come of one call for each of ``values``."""
    results: list[tuple[int, CallResult]] = []

    def ended(value: int, result: CallResult) -> None:
        results.append((value, result))

    def send() -> None:
        client = node.client(DOUBLE)
        for value in values:
            client.call(Ask(value), partial(ended, value), timeout_s)

    on(network, node, send)
    return results


# --- topics ---------------------------------------------------------------------------------------


@_check
def messages_of_one_source_arrive_in_order(network: Network) -> None:
    """Two publishers, two subscribers: each hears all of each, in order."""
    sources = [network.node("source_a"), network.node("source_b")]
    sinks = [network.node("sink_a"), network.node("sink_b")]
    heard: list[list[Number]] = [[], []]
    for sink, inbox in zip(sinks, heard, strict=True):
        on(network, sink, partial(sink.subscribe, NUMBERS, inbox.append))
    publishers = [on(network, source, partial(source.publisher, NUMBERS)) for source in sources]
    ready(network, *sources, *sinks)
    for value in range(COUNT):
        for source, publisher in zip(sources, publishers, strict=True):
            message = Number(value, source.node)
            source.post(partial(publisher.publish, message))
    assert network.until(lambda: all(len(inbox) >= 2 * COUNT for inbox in heard)), (
        f"of {2 * COUNT} messages the subscribers heard {[len(inbox) for inbox in heard]}"
    )
    for inbox in heard:
        for source in sources:
            values = [message.value for message in inbox if message.text == source.node]
            assert values == list(range(COUNT)), f"from {source.node} came {values}"


@_check
def a_latched_topic_gives_the_last_message_to_who_comes_late(network: Network) -> None:
    """Who subscribes after the publication still gets the last message, once."""
    source, late = network.node("source"), network.node("late")
    publisher = on(network, source, lambda: source.publisher(LATCHED))
    on(network, source, lambda: publisher.publish(Number(1)))
    on(network, source, lambda: publisher.publish(Number(2)))
    ready(network, source, late)
    heard: list[int] = []
    on(network, late, lambda: late.subscribe(LATCHED, lambda m: heard.append(m.value)))
    assert network.until(lambda: bool(heard)), "a late subscriber hears nothing"
    on(network, source, lambda: publisher.publish(Number(3)))
    assert network.until(lambda: 3 in heard), "a late subscriber does not hear what comes after"
    assert heard == [2, 3], f"a late subscriber should hear 2, then 3, and heard {heard}"


@_check
def a_message_of_another_type_is_refused_by_its_publisher(network: Network) -> None:
    """The text names the expected type."""
    node = network.node("source")
    publisher = on(network, node, lambda: node.publisher(NUMBERS))
    text = refused(network, node, lambda: publisher.publish(Text("x")), "a Text as a Number")
    assert Number.__type_name__ in text, f"the refusal does not name the type: {text}"


@_check
def a_message_that_is_not_of_the_topics_type_is_dropped_and_the_node_lives(
    network: Network,
) -> None:
    """A subscriber that expects another type than the publisher's hears nothing, and goes on.

    It is in a node of its own: a middleware may allow one type per topic in a node.
    """
    source, sink, misled = (network.node(n) for n in ("source", "sink", "misled"))
    wrong: list[Any] = []
    right: list[Number] = []
    after: list[Number] = []
    other = Topic(NUMBERS.name, Text.__type_name__, Text)
    more = Topic("/conformance/more", Number.__type_name__, Number)
    on(network, misled, lambda: misled.subscribe(other, wrong.append))
    on(network, misled, lambda: misled.subscribe(more, after.append))
    on(network, sink, lambda: sink.subscribe(NUMBERS, right.append))
    publishers = [on(network, source, partial(source.publisher, t)) for t in (NUMBERS, more)]
    ready(network, source, sink, misled)
    for publisher in publishers:
        on(network, source, partial(publisher.publish, Number(1)))
    assert network.until(lambda: bool(right)), "the subscriber of the right type hears nothing"
    assert network.until(lambda: bool(after)), "the node of the wrong type hears nothing else"
    assert not wrong, f"a subscriber of another type is given {wrong}"


# --- services -------------------------------------------------------------------------------------


@_check
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


@_check
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


@_check
def a_remote_error_carries_its_text(network: Network) -> None:
    """``Request.fail`` ends the call with REMOTE_ERROR and the reason."""
    server, client = network.node("server"), network.node("client")
    on(network, server, lambda: server.serve(DOUBLE, lambda r: r.fail("no arms, no doubling")))
    ready(network, server, client)
    results = calls(network, client, range(1))
    assert network.until(lambda: bool(results)), "the call does not end"
    assert results[0][1].outcome is CallOutcome.REMOTE_ERROR, f"it ended: {results[0][1]}"
    assert "no arms, no doubling" in results[0][1].error, f"its error: {results[0][1].error}"


@_check
def a_call_without_an_answer_times_out_once(network: Network) -> None:
    """The answer that comes too late changes nothing."""
    server, client = network.node("server"), network.node("client")
    kept: list[Any] = []
    on(network, server, lambda: server.serve(DOUBLE, kept.append))
    ready(network, server, client)
    results = calls(network, client, range(1), timeout_s=0.2)
    assert network.until(lambda: bool(results)), "the call does not end"
    assert results[0][1].outcome is CallOutcome.TIMEOUT, f"it ended: {results[0][1]}"
    on(network, server, lambda: kept[0].respond(Answer(1)))
    again = calls(network, client, range(1, 2))
    assert network.until(lambda: len(kept) == 2), "the next call does not arrive"
    on(network, server, lambda: kept[1].respond(Answer(2)))
    assert network.until(lambda: bool(again)), "the next call does not end"
    assert again[0][1].response.value == 2, "the next call got an answer that is not its own"
    assert len(results) == 1, f"the first call ended {len(results)} times"


@_check
def a_call_that_nobody_serves_is_unavailable_or_times_out(network: Network) -> None:
    """UNAVAILABLE where the middleware can tell, TIMEOUT where it cannot; never a hang."""
    client = network.node("client")
    ready(network, client)
    results = calls(network, client, range(1), timeout_s=0.5)
    assert network.until(lambda: bool(results)), "the call does not end"
    outcome = results[0][1].outcome
    assert outcome in (CallOutcome.UNAVAILABLE, CallOutcome.TIMEOUT), f"it ended: {outcome}"
    assert results[0][1].error, "and does not say why"


@_check
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


@_check
def a_service_is_served_once_in_a_node(network: Network) -> None:
    """A second server in the same node is a TransportError that names the service."""
    server = network.node("server")
    on(network, server, lambda: server.serve(DOUBLE, lambda request: None))
    again = refused(network, server, lambda: server.serve(DOUBLE, lambda r: None), "it twice")
    assert DOUBLE.name in again, f"the refusal does not name the service: {again}"


# --- actions --------------------------------------------------------------------------------------


class _Goal:
    """What one goal's client heard, in order."""

    def __init__(self) -> None:
        self.heard: list[tuple[Any, ...]] = []
        self.id = ""

    def events(self) -> GoalEvents:
        put = self.heard.append
        return GoalEvents(
            accepted=lambda _: put(("accepted",)),
            rejected=lambda _: put(("rejected",)),
            feedback=lambda _, message: put(("feedback", message.value)),
            result=lambda _, status, message: put((status, message.text)),
            failed=lambda _, result: put(("failed", result)),
        )


def _send_goal(network: Network, node: Transport, value: int) -> tuple[_Goal, Any]:
    goal = _Goal()
    client = on(network, node, lambda: node.action_client(COUNTING))
    goal.id = on(network, node, lambda: client.send_goal(Number(value), goal.events(), PATIENCE_S))
    return goal, client


@_check
def a_goal_runs_from_acceptance_by_feedback_to_its_result(network: Network) -> None:
    """Accepted comes first, feedback in order, the result once."""
    server, client = network.node("server"), network.node("client")

    def serve(handle: GoalHandle) -> None:
        handle.accept()
        for value in range(handle.goal.value):
            handle.publish_feedback(Number(value))
        server.after(0.1, lambda: handle.succeed(Text("done")))

    on(network, server, lambda: server.serve_action(COUNTING, serve, lambda handle: None))
    ready(network, server, client)
    goal, _ = _send_goal(network, client, 3)
    assert network.until(lambda: bool(goal.heard) and goal.heard[-1][0] is GoalStatus.SUCCEEDED), (
        f"the goal does not succeed: {goal.heard}"
    )
    expected = [("accepted",), *(("feedback", n) for n in range(3)), ("succeeded", "done")]
    assert goal.heard == expected, f"the client heard {goal.heard}, not {expected}"


@_check
def a_goal_can_be_rejected_or_aborted(network: Network) -> None:
    """A rejected goal hears nothing more; an aborted one gets its result."""
    server, client = network.node("server"), network.node("client")

    def serve(handle: GoalHandle) -> None:
        if handle.goal.value == 0:
            handle.reject()
        else:
            handle.accept()
            handle.abort(Text("tired"))

    on(network, server, lambda: server.serve_action(COUNTING, serve, lambda handle: None))
    ready(network, server, client)
    rejected, _ = _send_goal(network, client, 0)
    aborted, _ = _send_goal(network, client, 1)
    assert network.until(lambda: len(aborted.heard) >= 2 and bool(rejected.heard)), (
        f"the goals do not end: {rejected.heard}, {aborted.heard}"
    )
    assert rejected.heard == [("rejected",)], f"a rejected goal heard {rejected.heard}"
    expected = [("accepted",), (GoalStatus.ABORTED, "tired")]
    assert aborted.heard == expected, f"an aborted goal heard {aborted.heard}"


@_check
def a_cancel_request_reaches_the_goal_it_names(network: Network) -> None:
    """Of two goals the one that is cancelled ends as canceled; the other goes on."""
    server, client = network.node("server"), network.node("client")
    handles: list[GoalHandle] = []

    def serve(handle: GoalHandle) -> None:
        handles.append(handle)
        handle.accept()

    def cancel(handle: GoalHandle) -> None:
        handle.canceled(Text(f"stopped {handle.goal.value}"))

    on(network, server, lambda: server.serve_action(COUNTING, serve, cancel))
    ready(network, server, client)
    first, caller = _send_goal(network, client, 1)
    second, _ = _send_goal(network, client, 2)
    assert network.until(lambda: bool(first.heard) and bool(second.heard)), "no goal is accepted"
    refused(network, server, lambda: handles[0].canceled(Text()), "a cancel nobody asked for")
    on(network, client, lambda: caller.cancel(first.id))
    assert network.until(lambda: len(first.heard) == 2), f"it is not cancelled: {first.heard}"
    assert first.heard[1] == (GoalStatus.CANCELED, "stopped 1"), f"it heard {first.heard}"
    on(network, server, lambda: handles[1].succeed(Text("went on")))
    assert network.until(lambda: len(second.heard) == 2), "the other goal does not go on"
    assert second.heard[1] == (GoalStatus.SUCCEEDED, "went on"), f"it heard {second.heard}"


# --- time, threads, presence ----------------------------------------------------------------------


@_check
def timers_fire_no_earlier_than_asked_and_stop_when_cancelled(network: Network) -> None:
    """``every`` repeats, ``after`` fires once, a cancelled timer not at all."""
    node = network.node("node")
    stamps: list[int] = []
    fired: list[str] = []
    timers: list[Timer] = []
    began = node.now_ns()

    def start() -> None:
        node.after(0.02, lambda: fired.append("cancelled")).cancel()
        node.after(0.05, lambda: fired.append("once"))
        timers.append(node.every(0.02, tick))

    def tick() -> None:
        stamps.append(node.now_ns() - began)
        if len(stamps) == 10:
            timers[0].cancel()
            node.after(0.05, lambda: fired.append("end"))

    on(network, node, start)
    assert network.until(lambda: "end" in fired), f"the timers fired {len(stamps)} times, {fired}"
    assert fired == ["once", "end"], f"fired: {fired}"
    assert len(stamps) == 10, f"a cancelled periodic timer fired {len(stamps)} times"
    early = [n for n, stamp in enumerate(stamps, 1) if stamp < n * 20e6 - 2e6]
    assert not early, f"firings {early} came too early: {stamps}"


@_check
def callbacks_run_one_at_a_time(network: Network) -> None:
    """Messages, requests, timers and posted work share one executor."""
    node, other = network.node("node"), network.node("other")
    busy = threading.Lock()
    seen: set[str] = set()
    overlaps: list[str] = []
    threads: set[int] = set()

    def work(kind: str) -> None:
        if not busy.acquire(blocking=False):
            overlaps.append(kind)
            return
        threads.add(threading.get_ident())
        sum(range(2000))
        seen.add(kind)
        busy.release()

    def serve(request: Any) -> None:
        work("request")
        request.respond(Answer(0))

    on(network, node, lambda: node.subscribe(NUMBERS, lambda _: work("message")))
    on(network, node, lambda: node.serve(DOUBLE, serve))
    publisher = on(network, other, lambda: other.publisher(NUMBERS))
    ready(network, node, other)
    timer = on(network, node, lambda: node.every(0.001, lambda: work("timer")))
    for value in range(50):
        other.post(partial(publisher.publish, Number(value)))
        node.post(lambda: work("posted"))
    results = calls(network, other, range(50))
    assert network.until(lambda: len(results) == 50 and len(seen) == 4), f"only {seen} ran"
    on(network, node, timer.cancel)
    assert not overlaps, f"{overlaps} ran while something else did"
    assert len(threads) == 1, f"callbacks ran on {len(threads)} threads"


@_check
def a_node_is_up_once_it_is_announced_and_down_once_it_is_closed(network: Network) -> None:
    """``wait_for_nodes`` and ``watch_nodes`` agree."""
    watcher, node = network.node("watcher"), network.node("node")
    changes: list[tuple[str, bool]] = []
    on(network, watcher, lambda: watcher.watch_nodes(lambda *change: changes.append(change)))
    missing = network.caller(lambda: watcher.wait_for_nodes(["node"], 0.05))()
    assert list(missing) == ["node"], "a node that is not announced counts as up"
    ready(network, watcher, node)
    assert network.until(lambda: ("node", True) in changes), "nobody hears that it is up"
    node.close()
    assert network.until(lambda: ("node", False) in changes), "nobody hears that it is gone"


@_check
def closing_while_busy_ends_everything(network: Network) -> None:
    """A waiting caller returns, timers stop, and closing again does nothing."""
    server, client = network.node("server"), network.node("client")
    kept: list[Any] = []
    on(network, server, lambda: server.serve(DOUBLE, kept.append))
    ready(network, server, client)
    on(network, client, lambda: client.every(0.001, lambda: None))
    caller = on(network, client, lambda: client.client(DOUBLE))
    value = network.caller(lambda: caller.call_and_wait(Ask(1), 10 * PATIENCE_S))
    assert network.until(lambda: bool(kept)), "the request does not arrive"
    client.close()
    result = value()
    assert result.outcome is not CallOutcome.RESPONSE, f"the call ended: {result}"
    client.close()


# --- observation ----------------------------------------------------------------------------------


@_check
def a_tap_hears_every_message_once_and_in_order(network: Network) -> None:
    """With its source, its type, its data as plain values, and gapless numbers."""
    source, listener = network.node("source"), network.node("listener")
    heard: list[Observation] = []
    publisher = on(network, source, lambda: source.publisher(NUMBERS))
    on(network, listener, lambda: listener.tap([], heard.append))
    ready(network, source, listener)
    before = source.now_ns()
    for value in range(COUNT):
        source.post(partial(publisher.publish, Number(value, "x")))
    wanted = [("value", COUNT - 1)]
    assert network.until(
        lambda: any(o.channel == NUMBERS.name and o.data["value"] == wanted[0][1] for o in heard)
    ), "the tap does not hear the last message"
    mine = [o for o in heard if o.channel == NUMBERS.name]
    assert [o.data for o in mine] == [{"value": v, "text": "x"} for v in range(COUNT)], (
        f"the tap heard {len(mine)} of {COUNT} messages, or not in order"
    )
    first = mine[0].sequence
    for offset, observation in enumerate(mine):
        assert observation.kind is ObservationKind.MESSAGE, f"its kind is {observation.kind}"
        assert observation.source == "source", f"its source is {observation.source!r}"
        assert observation.type_name == Number.__type_name__, f"type {observation.type_name}"
        assert observation.sequence == first + offset, "sequence numbers have gaps"
        assert observation.stamp_ns >= before - 10**9, "stamped long before it happened"
    stamps = [o.stamp_ns for o in mine]
    assert stamps == sorted(stamps), "stamps of one source go back"


@_check
def a_tap_hears_the_four_events_of_every_call(network: Network) -> None:
    """Both ends tell theirs, in an order that respects cause and effect."""
    server, client, listener = (network.node(n) for n in ("server", "client", "listener"))
    heard: list[Observation] = []
    on(network, server, lambda: server.serve(DOUBLE, lambda r: r.respond(Answer(2 * r.data.value))))
    on(network, listener, lambda: listener.tap([], heard.append))
    ready(network, server, client, listener)

    def four(value: int) -> bool:
        """Call and see whether all four events of it come (ends learn of a tap by and by)."""
        results = calls(network, client, range(value, value + 1))
        assert network.until(lambda: bool(results)), "the call does not end"
        network.caller(lambda: client.wait_for_nodes(["nobody"], 0.1))()
        return sum(o.data in ({"value": value}, {"value": 2 * value}) for o in heard) == 4

    assert any(four(1000 + attempt) for attempt in range(20)), "the ends do not tell the tap"
    heard.clear()
    results = calls(network, client, range(1, 51))
    assert network.until(lambda: len(results) == 50), "the calls do not end"
    assert network.until(lambda: len(heard) >= 200), f"the tap heard {len(heard)} of 200 events"
    assert len(heard) == 200, f"the tap heard {len(heard)} events of 50 calls, not 200"
    by_call: dict[int, list[Observation]] = {}
    for observation in heard:
        by_call.setdefault(observation.call, []).append(observation)
    assert len(by_call) == 50, f"50 calls have {len(by_call)} numbers"
    order = [
        ObservationKind.REQUEST_SENT,
        ObservationKind.REQUEST_RECEIVED,
        ObservationKind.RESPONSE_SENT,
        ObservationKind.RESPONSE_RECEIVED,
    ]
    sources = ["client", "server", "server", "client"]
    for number, events in by_call.items():
        events.sort(key=lambda o: o.stamp_ns)
        assert [o.kind for o in events] == order, f"call {number}: {[o.kind for o in events]}"
        assert [o.source for o in events] == sources, f"call {number}: {events}"
        assert {o.client for o in events} == {"client"}, f"call {number} has other clients"
        asked, answered = events[0].data["value"], events[2].data["value"]
        assert [o.data["value"] for o in events] == [asked, asked, answered, answered]
        assert answered == 2 * asked, f"call {number}: {asked} answered by {answered}"
        assert events[0].type_name == "conformance/srv/Double_Request"
        assert events[2].type_name == "conformance/srv/Double_Response"


@_check
def a_tap_hears_how_a_call_failed(network: Network) -> None:
    """A remote error is on both response events; a call that nobody answers ends with its reason."""
    server, client, listener = (network.node(n) for n in ("server", "client", "listener"))
    heard: list[Observation] = []
    on(network, server, lambda: server.serve(DOUBLE, lambda r: r.fail("no")))
    on(network, listener, lambda: listener.tap([DOUBLE.name], heard.append))
    ready(network, server, client, listener)

    def responses() -> list[Observation]:
        return [o for o in heard if "response" in o.kind]

    for _ in range(20):
        results = calls(network, client, range(1))
        assert network.until(partial(len, results)), "the call does not end"
        network.caller(lambda: client.wait_for_nodes(["nobody"], 0.1))()
        if len({o.kind for o in responses()}) == 2:
            break
    assert responses(), "the tap hears no response event"
    wrong = [o for o in responses() if not o.error.startswith("remote_error: ") or o.data]
    assert not wrong, f"the error is not told: {wrong}"


@_check
def a_tap_hears_only_what_its_globs_name(network: Network) -> None:
    """A glob names channels; naming an action names its parts."""
    source, listener = network.node("source"), network.node("listener")
    heard: list[Observation] = []
    other = Topic("/other/numbers", Number.__type_name__, Number)
    publishers = [on(network, source, partial(source.publisher, t)) for t in (other, NUMBERS)]
    on(network, listener, lambda: listener.tap(["/conformance/*"], heard.append))
    ready(network, source, listener)
    for publisher in publishers:
        on(network, source, partial(publisher.publish, Number(1)))
    assert network.until(lambda: bool(heard)), "the tap hears nothing"
    channels = {observation.channel for observation in heard}
    assert channels == {NUMBERS.name}, f"the tap hears {channels}"


@_check
def a_tap_that_is_closed_hears_no_more(network: Network) -> None:
    """Closing it twice does nothing; its peers are named while it is open."""
    source, listener = network.node("source"), network.node("listener")
    heard: list[Observation] = []
    later: list[Number] = []
    publisher = on(network, source, lambda: source.publisher(NUMBERS))
    tap = on(network, listener, lambda: listener.tap([], heard.append))
    on(network, listener, lambda: listener.subscribe(NUMBERS, later.append))
    ready(network, source, listener)
    assert network.until(lambda: "source" in tap.peers()), f"its peers are {tap.peers()}"
    on(network, source, lambda: publisher.publish(Number(1)))
    assert network.until(lambda: bool(heard)), "the tap hears nothing"
    on(network, listener, tap.close)
    on(network, listener, tap.close)
    count = len(heard)
    on(network, source, lambda: publisher.publish(Number(2)))
    assert network.until(lambda: len(later) == 2), "the subscriber beside it hears nothing"
    assert len(heard) == count, "a closed tap still hears"
