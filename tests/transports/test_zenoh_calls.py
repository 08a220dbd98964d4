"""Calls and goals on Zenoh: among processes, with bad input and lost peers."""

import signal
import threading

import msgspec
import pytest

from tests.transports.zenoh_network import WAIT_S, Inbox, close_and, eventually, peer
from transports.interface import (
    Action,
    CallOutcome,
    GoalEvents,
    GoalStatus,
    ObservationKind,
    Service,
    TransportError,
)
from transports.zenoh import connect

pytestmark = pytest.mark.zenoh


def test_topics_and_services_reach_another_process(network):
    caller = network.node("caller")
    counts = Inbox()
    caller.subscribe(peer.COUNT, counts)
    network.process("adder")
    assert caller.wait_for_nodes(["adder"], WAIT_S) == []
    client = caller.client(peer.ADD)
    assert client.call_and_wait(peer.AddRequest(2, 3)).response == peer.AddResponse(5)
    results = Inbox()
    client.call(peer.AddRequest(4, 5), results)
    assert results.wait()[0].response == peer.AddResponse(9)
    assert counts.wait(2) == [peer.Number(2), peer.Number(4)]


def test_a_server_killed_in_the_middle_of_a_call_is_reconnected_to(network):
    caller = network.node("caller")
    changes, counts, results = Inbox(), Inbox(), Inbox()
    caller.watch_nodes(changes)
    caller.subscribe(peer.COUNT, counts)
    stuck = network.process("stuck")
    assert changes.wait(1) == [("adder", True)]
    client = caller.client(peer.ADD)
    client.call(peer.AddRequest(1, 1), results, timeout_s=60)
    counts.wait()  # the server has the request, and keeps it
    stuck.send_signal(signal.SIGKILL)
    assert results.wait()[0].outcome is CallOutcome.UNAVAILABLE
    assert changes.wait(2)[1] == ("adder", False)
    network.process("adder")
    assert changes.wait(3)[2] == ("adder", True)
    assert client.call_and_wait(peer.AddRequest(1, 1)).response == peer.AddResponse(2)
    assert len(results) == 1


def test_a_callee_that_never_answers_ends_in_a_timeout(network):
    caller = network.node("caller")
    network.process("stuck")
    caller.wait_for_nodes(["adder"], WAIT_S)
    client = caller.client(peer.ADD)
    results = Inbox()
    client.call(peer.AddRequest(), results, timeout_s=0.2)
    assert results.wait()[0].outcome is CallOutcome.TIMEOUT
    result = client.call_and_wait(peer.AddRequest(), timeout_s=0.2)
    assert result.outcome is CallOutcome.TIMEOUT
    assert result.error == "/adder/add: no answer within the time limit"
    assert len(results) == 1


def test_a_call_that_nobody_serves_ends_at_once_as_unavailable(network):
    result = network.node("caller").client(peer.ADD).call_and_wait(peer.AddRequest(), 60)
    assert result.outcome is CallOutcome.UNAVAILABLE
    assert result.error == "/adder/add: no response: no node serves it, or its server ended"


def test_a_bad_request_is_answered_with_the_reason(network, caplog):
    network.node("adder").serve(peer.ADD, lambda request: request.respond(peer.AddResponse(1)))
    replies = list(network.bare().get("adder/add", payload=msgspec.msgpack.encode({"a": []})))
    assert [reply.err.payload.to_string() for reply in replies] == [
        "bad request: Expected `int`, got `array` - at `$.a`"
    ]
    assert "/adder/add: message from an unnamed node dropped" in caplog.messages[0]


def test_a_bad_response_is_a_remote_error(network, caplog):
    caller = network.node("caller")
    bare = network.bare()
    bare.declare_queryable(
        "adder/add",
        lambda query: query.reply("adder/add", msgspec.msgpack.encode({"total": "x"})),
        complete=True,
    )
    client = caller.client(peer.ADD)
    eventually(lambda: client.call_and_wait(peer.AddRequest()).outcome != CallOutcome.UNAVAILABLE)
    result = client.call_and_wait(peer.AddRequest())
    assert result.outcome is CallOutcome.REMOTE_ERROR
    assert result.error == ("/adder/add: bad response: Expected `int`, got `str` - at `$.total`")


def test_any_zenoh_tool_can_call_a_service(network):
    network.node("adder").serve(
        peer.ADD, lambda r: r.respond(peer.AddResponse(r.data.a + r.data.b))
    )
    payload = msgspec.msgpack.encode({"a": 1, "b": 2})
    [reply] = network.bare().get("adder/add", payload=payload)
    assert msgspec.msgpack.decode(reply.ok.payload.to_bytes()) == {"total": 3}
    assert str(reply.ok.encoding) == "application/msgpack;test_interfaces/srv/Add_Response"


def test_two_servers_of_one_service_are_reported_by_name(network, caplog):
    for name in ("one", "other"):
        network.node(name).serve(peer.ADD, lambda request: None)
    eventually(lambda: len(caplog.messages) == 2)
    assert sorted(caplog.messages) == [
        "two nodes serve /adder/add: one and other; a call reaches only one of them",
        "two nodes serve /adder/add: other and one; a call reaches only one of them",
    ]


def test_serving_a_service_twice_in_one_node_is_refused(network):
    node = network.node("adder")
    node.serve(peer.ADD, lambda request: None)
    with pytest.raises(TransportError, match="/adder/add is served by adder already"):
        node.serve(peer.ADD, lambda request: None)


def test_an_action_runs_to_its_canceled_end_and_a_tap_hears_its_parts(network):
    action = Action("/go", "test_interfaces/action/Go", peer.Number, peer.Number, peer.Number)
    server, caller, tapper = (network.node(name) for name in ("server", "caller", "tap"))
    heard, accepted, feedback, results = Inbox(), Inbox(), Inbox(), Inbox()

    def start(goal):
        goal.accept()
        goal.publish_feedback(peer.Number(goal.goal.data + 1))

    server.serve_action(action, start, lambda goal: goal.canceled(peer.Number(9)))
    server.announce()
    tapper.tap(["/go"], heard)
    caller.wait_for_nodes(["server"], WAIT_S)
    client = caller.action_client(action)
    events = GoalEvents(accepted, Inbox(), feedback, results, Inbox())
    eventually(
        lambda: all(e.is_tapped for e in (*server._events.values(), *caller._events.values()))
    )
    goal_id = client.send_goal(peer.Number(1), events)
    assert accepted.wait() == [goal_id]
    assert feedback.wait() == [(goal_id, peer.Number(2))]
    client.cancel(goal_id)
    assert results.wait() == [(goal_id, GoalStatus.CANCELED, peer.Number(9))]
    eventually(lambda: sum(o.kind is ObservationKind.RESPONSE_RECEIVED for o in list(heard)) == 3)
    assert {observation.channel for observation in heard} == {
        f"/go/_action/{part}"
        for part in ("send_goal", "cancel_goal", "get_result", "feedback", "status")
    }


def test_closing_ends_a_call_that_waits(network):
    adder, caller = network.node("adder"), network.node("caller")
    arrived = Inbox()
    adder.serve(peer.ADD, arrived)
    adder.announce()
    caller.wait_for_nodes(["adder"], WAIT_S)
    client, results = caller.client(peer.ADD), Inbox()
    waiter = threading.Thread(target=lambda: results(client.call_and_wait(peer.AddRequest(), 600)))
    waiter.start()
    arrived.wait()
    caller.close()
    caller.close()
    assert results.wait()[0].outcome is CallOutcome.UNAVAILABLE
    waiter.join()


def test_timers_of_answered_calls_are_not_kept(network):
    node = network.node("node")
    node.serve(peer.ADD, lambda request: request.respond(peer.AddResponse(1)))
    client, results = node.client(peer.ADD), Inbox()
    for number in range(1, 501):
        client.call(peer.AddRequest(), results, timeout_s=600)
        results.wait(number)
    assert len(node._executor._timers._heap) <= 64


def test_answering_twice_is_refused(network):
    caller = network.node("caller")
    errors = Inbox()

    def serve(request):
        request.respond(peer.AddResponse(1))
        with pytest.raises(TransportError) as caught:
            request.fail("again")
        errors(str(caught.value))

    caller.serve(peer.ADD, serve)
    caller.client(peer.ADD).call_and_wait(peer.AddRequest())
    assert errors.wait() == ["call 1 of caller to /adder/add is answered already"]


def test_a_service_of_another_type_is_told_apart(network):
    network.node("adder").serve(peer.ADD, lambda request: request.respond(peer.AddResponse(1)))
    caller = network.node("caller")
    other = Service("/adder/add", "other/srv/Add", peer.AddRequest, peer.AddResponse)
    client = caller.client(other)
    eventually(lambda: client.call_and_wait(peer.AddRequest()).outcome != CallOutcome.UNAVAILABLE)
    assert client.call_and_wait(peer.AddRequest()).error == (
        "bad request: expected type test_interfaces/srv/Add_Request, got other/srv/Add_Request"
    )


def test_a_handler_at_work_as_its_node_closes_ends_quietly(network):
    caller = connect("caller", {"listen": network.endpoint})
    client = caller.client(peer.ADD)
    refused = Inbox()

    request = peer.AddRequest(1, 1)
    caller.post(lambda: close_and(caller, lambda: client.call(request, refused), refused))
    caller.spin()
    assert refused.wait() == ["cannot call /adder/add: session closed"]


def test_an_answer_as_its_node_closes_is_left_out_quietly(network):
    """Who closes drops the request on a thread of its own: the library bears one of the two at a time."""
    caller = network.node("caller")
    adder = connect("adder", {"endpoint": network.endpoint})
    refused = Inbox()

    answer = peer.AddResponse(2)
    adder.serve(
        peer.ADD,
        lambda request: close_and(adder, lambda: request.respond(answer), refused),
    )
    client, results = caller.client(peer.ADD), Inbox()
    adder.announce()
    assert caller.wait_for_nodes(["adder"], WAIT_S) == []
    client.call(peer.AddRequest(1, 1), results)
    adder.spin()
    assert refused.wait() == ["cannot answer /adder/add: this node serves it no more"]
    assert results.wait()[0].outcome is CallOutcome.UNAVAILABLE


def test_a_request_that_is_taken_up_as_its_node_closes_is_left_out_quietly(network):
    """Its turn has come, and before it is read the node closes on a thread of its own, which drops it."""
    caller = network.node("caller")
    adder = connect("adder", {"endpoint": network.endpoint})
    put, turns, served, results = adder._executor.put, Inbox(), Inbox(), Inbox()
    adder._executor.put = turns
    adder.serve(peer.ADD, served)
    adder._executor.put = put
    before = len(turns)
    adder.announce()
    assert caller.wait_for_nodes(["adder"], WAIT_S) == []
    caller.client(peer.ADD).call(peer.AddRequest(1, 1), results)
    receive, arrived = turns.wait(before + 1)[before]
    adder.close()
    receive(arrived)
    assert results.wait()[0].outcome is CallOutcome.UNAVAILABLE
    assert not served


def test_both_ends_of_a_call_tell_the_lives_of_its_client_apart(network):
    """It is started again under its name, and numbers its calls from 1 once more."""
    received = Inbox()
    listener = network.node("listener")
    tap = listener.tap([], received)
    network.process("adder")
    assert listener.wait_for_nodes(["adder"], WAIT_S) == []

    wanted = {
        ("adder", ObservationKind.RESPONSE_SENT),
        ("caller", ObservationKind.RESPONSE_RECEIVED),
    }

    def live() -> set[int]:
        """One life of the client, until both ends have reported its last call; its lives as they have them."""
        before = len(received)
        client = network.node("caller")
        adding = client.client(peer.ADD)
        asked = 0

        def seen_of(call: int) -> set[tuple[str, ObservationKind]]:
            return {(s.source, s.kind) for s in received[before:] if s.call == call}

        def both_have_reported() -> bool:
            nonlocal asked
            adding.call_and_wait(peer.AddRequest(1, 2))
            asked += 1
            return any(wanted <= seen_of(call) for call in range(1, asked + 1))

        eventually(both_have_reported)
        # what is reported later would be taken for the next life's
        eventually(lambda: wanted <= seen_of(asked))
        client.close()
        eventually(lambda: "caller" not in tap.peers())
        lives = {seen.client_life for seen in received[before:] if seen.client == "caller"}
        own = {seen.life for seen in received[before:] if seen.source == "caller"}
        assert lives == own
        return lives

    (first,), (second,) = live(), live()
    assert 0 not in (first, second)
    assert first != second
