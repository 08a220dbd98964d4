"""Every decoder of what comes from the wire, fed with anything: a value or a refusal, nothing else."""

from __future__ import annotations

import contextlib
import logging
import struct
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
import zenoh
from hypothesis import example, given
from hypothesis import strategies as st

from tests.transports.zenoh_network import peer
from transports import ros_forms
from transports.interface import CallOutcome, CallResult, Observation, ObservationKind, Topic
from transports.payloads import MOST_DEPTH, PayloadError, TypedCodec, decode_with, plain
from transports.refusals import MOST_PLACES, Refusals, shown
from transports.service_events import (
    EVENT_SUFFIX,
    MESSAGE_TAKEN,
    TAKEN_SUFFIX,
    ServiceEvent,
    ServiceEventInfo,
)
from transports.simulated import SimulatedWorld
from transports.simulated.routes import Sent
from transports.simulated.topics import Publisher
from transports.simulated.world import SimulatedTransport
from transports.zenoh import presence, services, tap, tokens, wire
from transports.zenoh.tokens import LinkToken, NodeToken, ServerToken, TokenError
from transports.zenoh_link.executor import Executor

LOG = logging.getLogger("tests.wire")

TEXT = st.text(st.characters(exclude_categories=("Cs",)))
CHUNK = st.one_of(
    TEXT,
    st.sampled_from(["", "-", "abc", "0", "a%62", "%", "%ff", "*", "$*", "ab,cd", "a" * 5000]),
    st.from_regex(r"[0-9]{1,40}", fullmatch=True),
    st.from_regex(r"[0-9a-f]{1,40}", fullmatch=True),
)
PREFIX = st.sampled_from(["@m2c/node", "@m2c/links", "@m2c/server", "@m2c", "x"])
KEY = st.one_of(
    TEXT, st.builds(lambda prefix, parts: "/".join([prefix, *parts]), PREFIX, st.lists(CHUNK))
)

PLAIN = st.recursive(
    st.one_of(
        st.none(),
        st.booleans(),
        st.integers(-(2**63), 2**64 - 1),
        st.floats(),
        TEXT,
        st.binary(),
        st.builds(
            msgspec.msgpack.Ext, st.integers(-128, 127).filter(lambda c: c != -1), st.binary()
        ),
        st.datetimes(),
    ),
    lambda inner: st.one_of(
        st.lists(inner), st.dictionaries(st.one_of(TEXT, st.integers(-9, 9), st.binary()), inner)
    ),
    max_leaves=20,
)
MESSAGE = st.one_of(
    st.binary(),
    PLAIN.map(msgspec.msgpack.encode),
    st.tuples(PLAIN.map(msgspec.msgpack.encode), st.integers(0, 40)).map(lambda p: p[0][: p[1]]),
    st.sampled_from(
        [
            b"",
            b"\xc1",
            b"\xdd\xff\xff\xff\xff",  # four thousand million elements, none of which is there
            b"\xdf\xff\xff\xff\xff",
            b"\x81\x80\x01",  # a key that is a map
            b"\xd7\xff" + b"\xff" * 8,  # a time that is none
            b"\x91" * 100_000,  # deeper than anything is read
            b"\x81\xa4data" * 100_000,
            b"\x81\xa4data\xcf" + b"\xff" * 8,
        ]
    ),
)

EVENT = st.one_of(
    MESSAGE,
    st.builds(
        lambda *fields: msgspec.msgpack.encode(
            {
                "info": dict(
                    zip(
                        ("event_type", "stamp_ns", "client", "sequence_number"),
                        fields[:4],
                        strict=True,
                    )
                ),
                "request": fields[4],
                "response": fields[4],
                "error": fields[5],
            }
        ),
        st.integers(-3, 9),
        st.integers(-(2**63), 2**64 - 1),
        st.one_of(TEXT, st.just("c" * 300)),
        st.integers(-(2**63), 2**64 - 1),
        PLAIN,
        TEXT,
    ),
)


@given(KEY)
@example("@m2c/node/evil")
@example("@m2c/node/ab/zzz/" + "9" * 5000)
@example("@m2c/node/ab/zzz/٣")
@example("@m2c/links/evil")
@example("@m2c/links/ab/" + "%2525," * 10_000)
@example("@m2c/server/evil")
def test_a_key_is_a_token_or_refused(key: str) -> None:
    for read, kind in (
        (tokens.read_node, NodeToken),
        (tokens.read_links, LinkToken),
        (tokens.read_server, ServerToken),
    ):
        try:
            token: Any = read(key)
        except TokenError:
            continue
        assert isinstance(token, kind)
        names = token.names if isinstance(token, LinkToken) else (token.name,)
        assert all(0 < len(name) <= tokens.MOST_NAME for name in names)
        if isinstance(token, NodeToken):
            assert 0 <= token.since_ns <= tokens.MOST_NS


@given(
    st.text(min_size=1, max_size=tokens.MOST_NAME),
    st.integers(0, tokens.MOST_NS),
    st.sampled_from(["", "0123456789abcdef" * 2]),
)
def test_what_a_node_says_of_itself_is_read_as_it_is(name: str, since_ns: int, host: str) -> None:
    try:
        key = tokens.node_key("ab12", name, since_ns, host)
    except UnicodeEncodeError:
        return  # no name of a node: it cannot be said
    assert tokens.read_node(key) == NodeToken("ab12", name, since_ns, host)
    assert tokens.read_server(tokens.server_key("ab12", name, "a/b")).service == "/a/b"
    assert tokens.read_links(tokens.links_key("ab12", [name, "x"])).names in ((name, "x"), ("-",))


def test_the_names_of_all_nodes_fit_in_what_zenoh_can_send() -> None:
    names = [f"{number:04}" + "ä" * 251 for number in range(5000)]
    key = tokens.links_key("ab12", names)
    assert len(key) < 32 * 1024
    assert tokens.read_links(key).names == tuple(names[: len(tokens.read_links(key).names)])


@given(st.binary(max_size=2000))
@example(struct.pack("<QQ", 2**64 - 1, 2**64 - 1) + b"node")
@example(bytes(16) + b"\xff")
@example(bytes(16) + b"a\x1b[31m")
@example(bytes(16) + b"n" * 5000)
def test_an_attachment_tells_who_sent_or_nothing(raw: bytes) -> None:
    sent = wire.sent_of(raw)
    assert sent == wire.UNKNOWN or 0 <= sent.number <= wire.MOST_NUMBER
    assert len(sent.node) <= 4 * tokens.MOST_NAME
    assert sent.node.isprintable()


@given(TEXT)
def test_an_encoding_names_a_type_or_none(text: str) -> None:
    assert len(wire.type_of(text)) <= wire.MOST_TYPE_NAME
    assert wire.type_of(f"{wire.MEDIA_TYPE};std_msgs/msg/Int32") == "std_msgs/msg/Int32"


@given(MESSAGE, st.one_of(st.none(), TEXT.map(lambda text: text.replace("\0", ""))))
def test_a_payload_is_a_message_or_refused(payload: bytes, encoding: str | None) -> None:
    codec = wire.Codec(peer.COUNT.type_name, peer.COUNT.message)
    try:
        message = codec.decode(payload, None if encoding is None else zenoh.Encoding(encoding))
    except PayloadError:
        return
    assert isinstance(message, peer.Number)


def arrived(
    payload: bytes, encoding: str = "", sent: wire.Sent = wire.UNKNOWN, suffix: str = ""
) -> Any:
    return tap.Arrived("/x", suffix, sent, encoding, payload, 1, 2)


def a_tap() -> Any:
    made: Any = object.__new__(tap.Tap)
    made._losses = tap.Losses()
    made._fields_read = lambda channel: frozenset({("a", "b")})
    return made


@given(MESSAGE, TEXT)
def test_what_a_tap_hears_is_an_observation_or_counted(payload: bytes, encoding: str) -> None:
    listener = a_tap()
    seen = listener._observe(arrived(payload, encoding))
    assert isinstance(seen, Observation) or "could not decode 1 message" in str(
        listener._losses.sentences()
    )


@given(EVENT, TEXT)
@example(msgspec.msgpack.encode(ServiceEvent(ServiceEventInfo(2, 2**64 - 1, "c", 1))), "x")
def test_an_event_of_a_service_fits_in_what_is_recorded_or_is_counted(
    payload: bytes, encoding: str
) -> None:
    listener = a_tap()
    seen = listener._observe(
        arrived(payload, encoding, wire.Sent(1, 1, "node"), suffix=EVENT_SUFFIX)
    )
    if seen is None:
        assert "could not decode 1 message" in str(listener._losses.sentences())
    else:
        assert 0 <= seen.stamp_ns < 2**63
        assert -1 <= seen.call < 2**63
        assert len(seen.client) <= 255


@given(EVENT, TEXT)
@example(msgspec.msgpack.encode(ServiceEvent(ServiceEventInfo(MESSAGE_TAKEN, 1, "c", 1))), "x")
@example(msgspec.msgpack.encode(ServiceEvent(ServiceEventInfo(MESSAGE_TAKEN, 1, "", 1))), "x")
@example(msgspec.msgpack.encode(ServiceEvent(ServiceEventInfo(MESSAGE_TAKEN, 1, "c", -1))), "x")
def test_a_message_taken_says_which_or_is_counted(payload: bytes, encoding: str) -> None:
    listener = a_tap()
    seen = listener._observe(
        arrived(payload, encoding, wire.Sent(1, 1, "node"), suffix=TAKEN_SUFFIX)
    )
    if seen is None:
        assert "could not decode 1 message" in str(listener._losses.sentences())
    else:
        assert seen.kind is ObservationKind.MESSAGE_TAKEN
        assert seen.data is None
        assert 0 <= seen.stamp_ns < 2**63
        assert 0 <= seen.call < 2**63
        assert 0 < len(seen.client) <= 255


class Query:
    """A request as Zenoh hands it over; keeps what it was answered."""

    def __init__(
        self, payload: bytes | None, encoding: str | None, attachment: bytes | None
    ) -> None:
        self.payload = None if payload is None else zenoh.ZBytes(payload)
        self.encoding = None if encoding is None else zenoh.Encoding(encoding)
        self.attachment = None if attachment is None else zenoh.ZBytes(attachment)
        self.answers: list[str] = []

    def reply(self, *_: object, **__: object) -> None:
        self.answers.append("reply")

    def reply_err(self, error: bytes, **_: object) -> None:
        self.answers.append(error.decode())

    def drop(self) -> None:
        pass


def a_server(executor: Executor, refusals: Refusals) -> services.Server:
    session: Any = SimpleNamespace(declare_queryable=lambda *_, **__: None)
    events: Any = SimpleNamespace(is_tapped=False, skip=lambda: None)
    return services.Server(
        session,
        executor,
        peer.ADD,
        events,
        lambda request: request.respond(peer.AddResponse(request.data.a)),
        refusals,
    )


@given(st.one_of(st.none(), MESSAGE), st.one_of(st.none(), st.binary(max_size=300)))
def test_a_query_is_answered_or_refused_with_the_reason(
    payload: bytes | None, attachment: bytes | None
) -> None:
    executor, refusals = Executor(), Refusals(LOG)
    server = a_server(executor, refusals)
    query: Any = Query(payload, None, attachment)
    server._arrive(query)
    executor.post(executor.close)
    executor.spin()
    assert len(query.answers) == 1
    assert (query.answers == ["reply"]) == (refusals.total == 0)


def test_queries_that_find_no_room_are_answered_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(services, "MOST_WAITING", 3)
    executor, refusals = Executor(), Refusals(LOG)
    server = a_server(executor, refusals)
    queries: list[Any] = [Query(None, None, None) for _ in range(5)]
    for query in queries:
        server._arrive(query)
    refused = "/adder/add: more requests wait than there is room for"
    assert [query.answers for query in queries] == [[], [], [], [refused], [refused]]
    executor.post(executor.close)
    executor.spin()
    assert [query.answers for query in queries[:3]] == [["reply"]] * 3
    assert refusals.count("/adder/add") == 2
    server._arrive(queries[0])  # there is room again
    assert refusals.total == 2


@given(MESSAGE, st.booleans())
def test_a_reply_is_a_result_whatever_it_holds(payload: bytes, is_error: bool) -> None:
    client: Any = object.__new__(services.Client)
    client._name, client._codec, client._refusals = "/x", services.codec_of(peer.ADD), Refusals(LOG)
    part = SimpleNamespace(payload=zenoh.ZBytes(payload), encoding=None)
    reply: Any = SimpleNamespace(ok=None if is_error else part, err=part if is_error else None)
    result, response = client.result_of(reply)
    assert isinstance(result, CallResult)
    assert (result.outcome is CallOutcome.RESPONSE) == (response is not None)
    assert len(result.error) < services.MOST_ERROR + 1000


def test_only_the_first_reply_is_taken() -> None:
    taken: list[Any] = []
    first = services._First(taken.append)
    for number in range(1000):
        first(number)  # type: ignore[arg-type]
    assert taken == [0]


@given(st.lists(st.tuples(st.sampled_from("abc"), st.sampled_from("abcdef"), st.booleans())))
def test_nodes_are_counted_right_whatever_tokens_come_and_go(
    steps: list[tuple[str, str, bool]],
) -> None:
    nodes = presence.Nodes()
    there: set[tuple[str, str]] = set()
    up: set[str] = set()
    for zid, name, is_up in steps:
        change = nodes.update(NodeToken(zid, name, 5), is_up)
        (there.add if is_up else there.discard)((zid, name))
        now_up = {name for _, name in there}
        assert change == next(
            ((name, name in now_up) for name in now_up.symmetric_difference(up)), None
        )
        up = now_up
        assert set(nodes.announced) == up
        assert nodes._count == len(there)
        for one in up:
            twice = sum(other == one for _, other in there) > 1
            assert not twice or nodes.contested.is_contested(one)
            assert nodes.known[one].since_ns in ((0,) if twice else (0, 5))


def test_more_tokens_than_are_remembered_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(presence, "MOST_TOKENS", 3)
    nodes = presence.Nodes()
    for number in range(3):
        nodes.update(NodeToken(f"{number}", "x"), True)
    with pytest.raises(TokenError, match="more than 3 nodes are up"):
        nodes.update(NodeToken("4", "x"), True)
    nodes.update(NodeToken("1", "x"), False)
    assert nodes.update(NodeToken("4", "y"), True) == ("y", True)


# --- the simulated world, and what ROS 2's messages carry ------------------------------------------


@given(MESSAGE, TEXT)
def test_a_simulated_node_and_tap_take_anything(payload: bytes, type_name: str) -> None:
    world = SimulatedWorld()
    node = SimulatedTransport(world, "node")
    heard: list[Observation] = []
    listener = SimulatedTransport(world, "tap").tap([], heard.append)
    got: list[Any] = []
    topic = Topic("/x", "std_msgs/msg/Int32", peer.Number)
    node.subscribe(topic, got.append)
    publisher = Publisher(SimulatedTransport(world, "evil"), topic)
    for subscription in node.topics.subscriptions("/x"):
        subscription.take(publisher, Sent("evil", 0, type_name, payload, 1))
        subscription.take(publisher, Sent("evil", 1, topic.type_name, payload, 1))
    node.routes.message(Sent("evil", 0, type_name, payload, 1), "/x")
    world.run_for(1.0)
    assert len(got) + node.refusals.total == 2
    taken = [seen for seen in heard if seen.kind is ObservationKind.MESSAGE_TAKEN]
    assert len(taken) == len(got)
    assert len(heard) - len(taken) + len(listener.problems()) == 1


@given(MESSAGE)
def test_bytes_are_decoded_or_refused(payload: bytes) -> None:
    codec = TypedCodec(peer.ADD.type_name, peer.AddRequest)
    for decode in (plain, codec.decode_bytes):
        with contextlib.suppress(PayloadError):
            decode(payload)


@pytest.mark.parametrize("begin", [b"\x91", b"\x81\xa1a", b"\x81\x91"])
def test_what_is_nested_too_deep_is_refused_before_anybody_writes_it_again(begin: bytes) -> None:
    def heard(depth: int) -> Observation | None:
        end = b"\x01\x01" if begin.endswith(b"\x91") and len(begin) > 1 else b"\x01"
        found: Observation | None = a_tap()._observe(arrived(begin * depth + end))
        return found

    for depth in (1, 40, MOST_DEPTH - 1):
        seen = heard(depth)
        assert seen is None or msgspec.msgpack.encode(seen)
    assert begin == b"\x81\x91" or heard(MOST_DEPTH - 1) is not None
    for depth in range(MOST_DEPTH + 1, 1000):
        assert heard(depth) is None
    assert (
        ros_forms.carried_message('{"m2c_type":"x","message":' + "[" * 200 + "]" * 200 + "}")
        is None
    )


JSON = st.one_of(
    TEXT,
    st.text(),
    st.recursive(
        st.one_of(st.none(), st.booleans(), st.integers(), st.floats(allow_nan=False), TEXT),
        lambda inner: st.one_of(st.lists(inner), st.dictionaries(TEXT, inner)),
        max_leaves=10,
    ).map(lambda value: msgspec.json.encode(value).decode()),
    st.sampled_from(["[" * 100_000, '{"m2c_type":"x","message":' + "[" * 100_000, "9" * 5000]),
)


@given(JSON)
@example('{"m2c_type":"x","message":' + "[" * 100_000)
@example('{"m2c_type":"\ud800","message":1}')
def test_a_text_of_ros_carries_a_message_or_none(text: str) -> None:
    carried = ros_forms.carried_message(text)
    assert carried is None or isinstance(carried, ros_forms.Carried)
    try:
        error = ros_forms.read_call_error(text)
    except PayloadError:
        return
    assert 0 <= error.stamp_ns < 2**63


@given(st.binary())
def test_decoding_raises_one_error_only(data: bytes) -> None:
    with contextlib.suppress(PayloadError):
        decode_with(msgspec.json.Decoder(ros_forms.CallError).decode, data)


# --- what is said of it ----------------------------------------------------------------------------


def test_what_is_refused_is_said_once_for_each_sender(caplog: pytest.LogCaptureFixture) -> None:
    refusals = Refusals(LOG)
    for _ in range(999):
        refusals.refuse("/x", "a", "bad")
    refusals.refuse("/x", "", "worse")
    assert [record.getMessage() for record in caplog.records] == [
        "/x: message from a dropped: bad",
        "/x: message from an unnamed node dropped: worse",
    ]
    refusals.refuse("/x", "a", "bad")
    assert caplog.records[-1].getMessage() == "/x: message from a dropped: bad (1,000 so far)"
    assert (refusals.count("/x", "a"), refusals.total) == (1000, 1001)


def test_a_million_senders_fill_neither_log_nor_memory(caplog: pytest.LogCaptureFixture) -> None:
    refusals = Refusals(LOG)
    for number in range(10_000):
        refusals.refuse("/x", f"evil{number}", "bad")
    assert len(caplog.records) == MOST_PLACES + 1
    assert len(refusals._counts) == MOST_PLACES + 1
    assert refusals.total == 10_000


def test_a_name_from_the_wire_commands_no_terminal() -> None:
    assert shown("a\x1b[31m\n\u202e") == r"a\x1b[31m\n\u202e"
    assert len(shown("x" * 10**6)) < 300


def test_an_event_needs_a_sender() -> None:
    listener = a_tap()
    event = msgspec.msgpack.encode(ServiceEvent(ServiceEventInfo(2, 1, "c", 1)))
    assert listener._observe(arrived(event, suffix=EVENT_SUFFIX)) is None
    assert "does not say which node it is from" in listener._losses.sentences()[0]
