"""What a peer that nobody knows can do to nodes and taps on Zenoh: nothing but be refused, and be said."""

from __future__ import annotations

import logging
import os
from typing import Any

import msgspec
import pytest
import zenoh

from tests.transports.zenoh_network import Inbox, Network, eventually, linked, peer
from transports import host
from transports.interface import HERE, CallOutcome
from transports.service_events import ServiceEvent, ServiceEventInfo
from transports.zenoh import tap as tap_module
from transports.zenoh import waiting as waiting_module
from transports.zenoh import wire
from transports.zenoh.tokens import node_key

pytestmark = pytest.mark.zenoh

EVIL_TOKENS = [
    "@m2c/node/evil",
    "@m2c/node/ab/zzz/" + "9" * 5000,
    "@m2c/node/ab/zzz/1/2/3",
    "@m2c/node/ab/a%ff%fe%00%1b[31m/1",
    "@m2c/node/ab/" + "n" * 40_000 + "/1",
    "@m2c/links/evil",
    "@m2c/links/ab/" + "%41," * 10_000,
    "@m2c/server/evil",
    "@m2c/server/evil/x",
    "@m2c/server/evil/evil/adder/add",
    "@m2c/node",
    "@m2c",
]


def lives(node: Any) -> None:
    """``node``'s executor still runs what is posted."""
    ran = Inbox()
    node.post(lambda: ran("ran"))
    ran.wait()


def test_nobody_dies_of_a_token(network: Network, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING)
    node = network.node("adder")
    node.serve(peer.ADD, lambda request: request.respond(peer.AddResponse(1)))
    changes = Inbox()
    node.watch_nodes(changes)
    node.announce()
    tapper = network.node("tap")
    listener = tapper.tap([], lambda seen: None)
    stranger = network.bare()
    declared = [stranger.liveliness().declare_token(key) for key in EVIL_TOKENS]
    late = network.node("late")  # who comes now is told of all of them at once
    late.announce()
    assert late.wait_for_nodes(["adder"], 20) == []
    eventually(lambda: node._refusals.count("@m2c/node") >= 5)
    eventually(lambda: listener.peers() == ["adder", "late"])
    for each in (node, tapper, late):
        lives(each)
    for token in declared:
        token.undeclare()
    eventually(lambda: ("late", True) in changes)
    assert {name for name, _ in changes} == {"adder", "late"}
    dropped = "@m2c/node: message from an unnamed node dropped"
    eventually(lambda: caplog.text.count(dropped) == 3)  # one a node
    assert listener.problems() == []


def test_more_names_than_fit_in_a_token_of_zenohs_end_no_session(network: Network) -> None:
    """Each node tells which others it hears, in a key: Zenoh panics at one of more than 64 KB."""
    node = network.node("adder")
    node.announce()
    stranger = network.bare()
    names = [f"{number:03}" + "n" * 240 for number in range(400)]
    declared = [
        stranger.liveliness().declare_token(f"@m2c/node/{stranger.info.zid()}/{name}/1")
        for name in names
    ]
    eventually(lambda: len(node._shared.announcements._nodes.announced) == 401)
    lives(node)
    late = network.node("late")
    late.announce()
    assert late.wait_for_nodes(["adder", names[-1]], 20) == []
    assert len(declared) == 400


def test_who_says_on_which_host_it_is_stamps_by_the_clock_of_that(network: Network) -> None:
    tapper, stranger = network.node("tap"), network.bare()
    tapper.watch_nodes(lambda name, up: None)
    zid, elsewhere = stranger.info.zid(), "0123456789abcdef" * 2
    hosts = {"here": host.ID, "there": elsewhere, "too": elsewhere, "somewhere": ""}
    kept = [
        stranger.liveliness().declare_token(node_key(str(zid), name, 1, of))
        for name, of in hosts.items()
    ]
    eventually(lambda: all(tapper.up_since(name) for name in hosts))
    assert [tapper.clock_of(name) for name in hosts] == [HERE, elsewhere, elsewhere, ""]
    assert len(kept) == 4


def test_a_node_that_is_claimed_again_is_contested_and_not_taken_for_restarted(
    network: Network,
) -> None:
    node = network.node("adder")
    node.announce()
    tapper = network.node("tap")
    tapper.watch_nodes(lambda name, up: None)
    listener = tapper.tap([], lambda seen: None)
    eventually(lambda: tapper.up_since("adder"))
    assert tapper.clock_of("adder") == HERE
    assert not listener.is_contested("adder")
    stranger = network.bare()
    zid = str(node._session.info.zid())
    for key in (f"@m2c/node/{stranger.info.zid()}/adder/{2**62}", f"@m2c/node/{zid}/adder/{2**62}"):
        token = stranger.liveliness().declare_token(key)
        eventually(listener.problems)
        eventually(lambda: tapper.up_since("adder") == 0)
        assert listener.is_contested("adder")
        assert listener.problems() == [
            "several sessions claim to be adder: which of them is the node is not known"
        ]
        token.undeclare()
        eventually(lambda: listener.problems() == [])
        assert listener.peers() == ["adder"]
        assert tapper.up_since("adder") == 0  # what it did meanwhile is not known
        assert tapper.clock_of("adder") == ""
        assert listener.is_contested("adder")  # what the other sent may still be on its way


def test_who_sends_in_another_nodes_name_is_found_out(network: Network) -> None:
    node = network.node("adder")
    count = node.publisher(peer.COUNT)
    node.announce()
    heard = Inbox()
    tapper = network.node("tap")
    listener = tapper.tap(["/adder/*"], heard)
    eventually(lambda: count.declared.matching_status.matching)
    eventually(lambda: listener.peers() == ["adder"])
    stranger = network.bare()
    forged = linked(stranger, "adder/count")
    forged.put(msgspec.msgpack.encode({"data": 1}), attachment=wire.attachment(0, 0, b"adder"))
    count.publish(peer.Number(2))
    heard.wait(2)
    assert sorted((seen.source, seen.sequence, seen.data["data"]) for seen in heard) == [
        ("", -1, 1),
        ("adder", 0, 2),
    ]
    event = ServiceEvent(ServiceEventInfo(2, 1, "caller", 1))
    telling = linked(stranger, "adder/add/_service_event")
    telling.put(msgspec.msgpack.encode(event), attachment=wire.attachment(0, 0, b"adder"))
    eventually(lambda: len(listener.problems()) == 2)
    zid = stranger.info.zid()
    assert listener.problems() == [
        "could not decode 1 message on /adder/add from unknown: it does not say which node it is "
        "from, or says so wrongly",
        f"2 messages in the name of adder, but sent by another session, {zid}: treated as unnamed",
    ]
    assert not listener.is_contested("adder")  # what is its own is known, and judged


def test_a_node_whose_stamps_are_made_elsewhere_is_itself(network: Network, tmp_path: Any) -> None:
    unstamped = tmp_path / "zenoh.json5"
    unstamped.write_text("{timestamping: {enabled: false}}", encoding="utf-8")
    heard = Inbox()
    listener = network.node("tap").tap([], heard)
    node = network.node("adder", config=str(unstamped))
    count = node.publisher(peer.COUNT)
    node.announce()
    eventually(lambda: count.declared.matching_status.matching)
    eventually(lambda: listener.peers() == ["adder"])
    for number in range(3):
        count.publish(peer.Number(number))
    heard.wait(3)
    assert [seen.source for seen in heard] == ["adder"] * 3
    assert listener.problems() == []


def test_evil_attachments_and_payloads_on_every_kind_of_key_end_nobody(network: Network) -> None:
    node = network.node("adder")
    node.serve(peer.ADD, lambda request: request.respond(peer.AddResponse(request.data.a)))
    got, heard = Inbox(), Inbox()
    node.subscribe(peer.COUNT, got)
    node.announce()
    tapper = network.node("tap")
    listener = tapper.tap([], heard)
    stranger = network.bare()
    payloads = [
        b"",
        b"\xc1",
        b"\x91" * 50_000,
        b"\x81\x90\x01",
        b"\xd4\x05\x00",
        b"\xdd\xff\xff\xff\xff",
    ]
    attachments = [None, b"", b"\xff" * 16, b"\0" * 16 + b"\xff", b"\0" * 16 + b"a" * 5000]
    encodings = ["", "x" * 200, "application/msgpack;std_msgs/msg/Int32", "zenoh/string;\x1b[31m"]
    for key in ("adder/count", "adder/add", "adder/add/_service_event", "@m2c/round", "other"):
        linked(stranger, "adder/count")
        linked(stranger, "other")  # the tap
        for payload in payloads:
            for attachment in attachments:
                for encoding in encodings:
                    stranger.put(
                        key,
                        payload,
                        encoding=encoding,
                        attachment=attachment,
                        congestion_control=zenoh.CongestionControl.BLOCK,  # none is lost on the way
                    )
    for payload in payloads:
        list(stranger.get("adder/add", payload=payload, attachment=b"\xff" * 20, timeout=10))
    stranger.put(
        "adder/count", b"\x81\xa4data\x07", encoding="application/msgpack;std_msgs/msg/Int32"
    )
    assert got.wait()[-1] == peer.Number(7)
    lives(node)
    lives(tapper)
    eventually(lambda: any(seen.data == {"data": 7} for seen in heard))
    assert node._refusals.total >= 100
    assert any("could not decode" in problem for problem in listener.problems())


def test_a_flood_of_requests_and_of_replies_is_bounded(
    network: Network, monkeypatch: pytest.MonkeyPatch
) -> None:
    caller = network.node("caller")
    stranger = network.bare()
    total = 5000

    def answer(query: zenoh.Query) -> None:
        for _ in range(total):
            query.reply("adder/add", b"\xc1" * 100)
        query.drop()

    served = stranger.declare_queryable("adder/add", answer, complete=True)
    results = Inbox()
    client = caller.client(peer.ADD)
    eventually(
        lambda: client.call_and_wait(peer.AddRequest()).outcome is not CallOutcome.UNAVAILABLE
    )
    client.call(peer.AddRequest(), results)
    assert results.wait()[0].outcome is CallOutcome.REMOTE_ERROR
    assert caller._refusals.count("/adder/add", "its server") <= 3  # and not each of its replies
    assert len(results) == 1
    served.undeclare()


def test_what_waits_for_a_slow_tap_is_bounded_in_bytes_and_what_is_dropped_is_said(
    network: Network, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(waiting_module, "MOST_WAITING_BYTES", 8 * 1024 * 1024)
    waits, gate, heard = Inbox(), Inbox(), Inbox()

    def slow(seen: Any) -> None:
        waits("here")
        gate.wait()
        heard(seen)

    tapper = network.node("tap")
    listener = tapper.tap(["/flood*"], slow)
    stranger = network.bare()
    flood = linked(stranger, "flood")
    large = msgspec.msgpack.encode(os.urandom(1_100_000))
    flood.put(large)
    waits.wait()
    total = 60
    for _ in range(total):
        flood.put(large)
    eventually(
        lambda: listener._waiting._dropped["/flood"] + len(listener._waiting._batches) == total
    )
    assert len(listener._waiting._batches) == 3  # 4 MB, half of what there is room for
    assert listener._waiting._total <= 4 * 1024 * 1024
    stranger.put("flood/not", b"\x01")
    eventually(lambda: len(listener._waiting._batches) == 4)
    assert listener.take_dropped() == {("/flood", "")}
    assert listener.take_dropped() == ()
    gate("open")
    heard.wait(5)
    assert [seen.channel for seen in heard] == ["/flood"] * 4 + ["/flood/not"]
    assert listener.problems() == [
        "dropped 57 messages (62.7 MB): they come faster than they are handled, 57 of them on /flood"
    ]


def test_a_tap_hears_no_more_channels_than_it_can_remember(
    network: Network, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tap_module, "MOST_CHANNELS", 5)
    heard = Inbox()
    tapper = network.node("tap")
    tapper.tap([], heard)
    stranger = network.bare()
    linked(stranger, "channel/0")
    for number in range(20):
        stranger.put(f"channel/{number}", b"\x01")
    stranger.put("channel/0", b"\x02")
    eventually(lambda: heard and heard[-1].data == 2)
    assert len(heard) == 6
    assert tapper._refusals.total == 15


def test_a_channel_with_a_name_of_60_kb_is_refused_and_not_remembered(network: Network) -> None:
    heard = Inbox()
    tapper = network.node("tap")
    listener = tapper.tap([], heard)
    stranger = network.bare()
    linked(stranger, "short")
    for number in range(20):
        block = zenoh.CongestionControl.BLOCK  # none is lost on the way
        stranger.put(f"{number}/" + "x" * 60_000, b"\x01", congestion_control=block)
    stranger.put("short", b"\x02")
    eventually(lambda: heard and heard[-1].data == 2)
    assert [seen.channel for seen in heard] == ["/short"]
    assert tapper._refusals.total == 20
    assert sum(map(len, listener._channels)) < 100
    assert sum(len(channel) for channel, _ in tapper._refusals._counts) < 10_000
