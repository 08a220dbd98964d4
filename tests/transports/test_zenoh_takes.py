"""Which messages a node takes, and how far it has reported, as a tap on Zenoh hears of it."""

import threading

import msgspec
import pytest
import zenoh

from tests.transports.zenoh_network import WAIT_S, Inbox, eventually, linked, peer
from transports.interface import Answer, ObservationKind
from transports.service_events import REQUEST_RECEIVED
from transports.zenoh import tokens
from transports.zenoh.names import ANSWER_KEYS
from transports.zenoh.orders import Orders
from transports.zenoh.wire import attachment

pytestmark = pytest.mark.zenoh


def takes(heard):
    return [o for o in heard if o.kind is ObservationKind.MESSAGE_TAKEN]


def test_a_node_whose_executor_is_busy_says_how_far_it_has_reported(network):
    publishing, taking, tapper = (network.node(name) for name in ("publishing", "taking", "tap"))
    publisher = publishing.publisher(peer.COUNT)
    is_busy, is_free = threading.Event(), threading.Event()

    def take(number):
        if number.data:
            is_busy.set()
            is_free.wait(WAIT_S)

    taking.subscribe(peer.COUNT, take)
    heard, answers = Inbox(), Inbox()
    listener = tapper.tap([], heard)
    for node in (publishing, taking):
        node.announce()
    eventually(lambda: {"publishing", "taking"} <= set(listener.peers()))

    def is_reported():
        publisher.publish(peer.Number(0))
        return bool(takes(heard))

    eventually(is_reported)
    publisher.publish(peer.Number(1))
    try:
        assert is_busy.wait(WAIT_S)
        listener.ask("taking", answers)
        (answer,) = answers.wait()
    finally:
        is_free.set()
    # though it is still at work, and would not have told of that by itself
    last = max(takes(heard), key=lambda o: o.order)
    assert last.order == answer.next_order - 1
    assert last.stamp_ns <= answer.stamp_ns
    numbers = {o.sequence: o.data["data"] for o in heard if o.kind is ObservationKind.MESSAGE}
    assert numbers[last.call] == 1


def test_what_is_under_way_holds_back_how_far_a_node_has_reported():
    stamps = iter(range(100))
    orders = Orders(lambda: next(stamps))
    (stamp, order), (_, later) = orders.begin(), orders.begin()
    orders.end(later)
    assert orders.reported() == (stamp, order)
    orders.end(order)
    assert orders.reported() == (2, later + 1)


def test_only_messages_with_a_number_are_reported_as_taken(network):
    taking, tapper, stranger = network.node("taking"), network.node("tap"), network.bare()
    got, heard = Inbox(), Inbox()
    taking.subscribe(peer.COUNT, got)
    publisher = taking.publisher(peer.COUNT)
    tapper.tap([], heard)
    linked(stranger, "other")

    def is_reported():
        publisher.publish(peer.Number(7))
        return bool(takes(heard))

    eventually(is_reported)
    stranger.put(peer.COUNT.name[1:], msgspec.msgpack.encode(peer.Number(8)))
    eventually(lambda: got and got[-1].data == 8)
    publisher.publish(peer.Number(9))

    def last_take():
        return takes(heard)[-1]

    eventually(lambda: last_take().call == sum(number.data != 8 for number in got) - 1)
    taken = takes(heard)
    assert {o.client for o in taken} == {"taking"}
    assert [o.sequence for o in taken] == list(range(len(taken)))
    assert len({o.call for o in taken}) == len(taken)


def a_stranger_as(network, zid, attached):
    """A session that says it has the node ``ghost`` (of session ``zid``: its own if empty), and answers for it."""
    stranger = network.bare()
    zid = zid or str(stranger.info.zid())

    def reply(query):
        stamp = stranger.new_timestamp()
        query.reply(query.key_expr, b"", attachment=attached, timestamp=stamp)
        query.drop()

    stranger.declare_queryable(tokens.answer_key(zid, "ghost"), reply)
    return stranger.liveliness().declare_token(tokens.node_key(zid, "ghost", 1))


@pytest.mark.parametrize(
    ("zid", "attached", "is_answer"),
    [
        pytest.param("", attachment(0, 7, b"ghost"), True, id="right"),
        pytest.param("", None, False, id="nothing"),
        pytest.param("", b"\xff" * 40, False, id="no attachment of ours"),
        pytest.param("", attachment(0, 7, b"another"), False, id="another's name"),
        pytest.param("abc123", attachment(0, 7, b"ghost"), False, id="another's session"),
    ],
)
def test_an_answer_that_is_none_of_the_nodes_is_refused(network, zid, attached, is_answer):
    tapper = network.node("tap")
    listener = tapper.tap([], Inbox())
    token = a_stranger_as(network, zid, attached)
    eventually(lambda: "ghost" in listener._nodes.announced)
    answers = Inbox()
    listener.ask("ghost", answers, WAIT_S)
    (answer,) = answers.wait()
    if is_answer:
        assert isinstance(answer, Answer)
        assert answer.next_order == 7
    else:
        assert answer is None
    assert tapper._refusals.count(ANSWER_KEYS, "ghost") == (not is_answer)
    token.undeclare()


def test_who_does_not_answer_in_time_has_not(network):
    tapper, silent = network.node("tap"), network.bare()
    listener = tapper.tap([], Inbox())
    zid = str(silent.info.zid())
    asked = Inbox()
    silent.declare_queryable(
        tokens.answer_key(zid, "ghost"), zenoh.handlers.Callback(asked, indirect=False)
    )
    token = silent.liveliness().declare_token(tokens.node_key(zid, "ghost", 1))
    eventually(lambda: "ghost" in listener._nodes.announced)
    answers = Inbox()
    listener.ask("ghost", answers, 0.05)
    assert answers.wait() == [None]
    asked.wait()
    token.undeclare()


def test_taps_with_several_globs_hear_all_before_the_answer(network):
    publishing, tapper = network.node("publishing"), network.node("tap")
    names = ("/one/numbers", "/two/numbers", "/three/numbers")
    publishers = [publishing.publisher(msgspec.structs.replace(peer.COUNT, name=n)) for n in names]
    heard, answers = Inbox(), Inbox()
    listener = tapper.tap(["/one/*", "/two/*", "/three/*"], heard)
    tapper.tap([], Inbox())  # beside it, in the same session
    publishing.announce()
    eventually(lambda: "publishing" in listener.peers())

    def are_linked():
        for publisher in publishers:
            publisher.publish(peer.Number(0))
        return len({o.channel for o in heard}) == 3

    eventually(are_linked)
    for round_ in range(20):
        for publisher in publishers:
            publisher.publish(peer.Number(round_))
        listener.ask("publishing", lambda answer: answers((answer, len({o.order for o in heard}))))
        answer, count = answers.wait(round_ + 1)[-1]
        assert max(o.order for o in heard[:count]) == answer.next_order - 1
    assert not listener.problems()


def test_what_a_node_that_has_ended_kept_does_not_hold_up_those_beside_it(network):
    owner, tapper = network.node("owner"), network.node("tap")
    server = owner.beside("server")
    server.serve(peer.ADD, lambda request: None)
    heard = Inbox()
    tapper.tap([], heard)
    events = server._events[peer.ADD.name]
    eventually(lambda: events.is_tapped)
    moment = events.moment()
    server.close()
    events.record(REQUEST_RECEIVED, moment, ("late", 1, 0), None)
    owner._shared.outbox.flush()
    owner.close()
