"""What is made of Zenoh's own log: a refusal is said, and what Zenoh itself keeps back is none."""

from __future__ import annotations

import os
import sys
import threading

import pytest

from transports.zenoh_link import refusals

_LINE = (
    "2026-11-25T12:30:22.955788Z TRACE {}ThreadId(01) zenoh::net::routing::interceptor: "
    "Msg intercepted!"
)


_LINK = "\x1b[2m2026-11-27T08:38:46.7Z\x1b[0m \x1b[33m WARN\x1b[0m rx-4 ThreadId(06) zenoh_link_tls::unicast: {}"


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> refusals.Refusals:
    monkeypatch.setenv("RUST_LOG", "")  # it is put back as it was
    refusals.ask_nodes_for_refusals()
    return refusals.Refusals()


def test_a_message_that_came_and_was_refused_is_said(read: refusals.Refusals) -> None:
    said = read.instead(_LINE.format("rx-2 "))
    assert said is not None
    assert said.startswith("refused a message that the sender's certificate does not allow")


def test_our_own_message_kept_from_a_new_peer_is_no_refusal(read: refusals.Refusals) -> None:
    assert read.instead(_LINE.format("")) is None
    said = read.instead(_LINE.format("rx-2 "))
    assert said is not None
    assert said.startswith("refused a message")


def test_a_stranger_that_tries_again_and_again_is_one_line_for_each_reason(
    read: refusals.Refusals, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = 5.0
    monkeypatch.setattr(refusals.time, "monotonic", lambda: now_s)
    said = []
    for second in range(121):
        now_s = 5.0 + second
        for text in (
            "received fatal alert: UnknownCA. Hint: increase the limit.",
            "no certificate",
        ):
            said.append((second, read.instead(_LINK.format(text))))
    who = "somebody without a valid certificate of this system"
    unknown, none = "received fatal alert: UnknownCA", "no certificate"
    assert [one for one in said if one[1] is not None] == [
        (0, f"refused a link to {who}: {unknown}"),
        (0, f"refused a link to {who}: {none}"),
        (60, f"refused 60 links to {who}: {unknown}"),
        (60, f"refused 60 links to {who}: {none}"),
        (120, f"refused 60 links to {who}: {unknown}"),
        (120, f"refused 60 links to {who}: {none}"),
    ]


def test_reasons_without_end_are_not_lines_without_end(read: refusals.Refusals) -> None:
    said = [read.instead(_LINK.format(f"reason {number}")) for number in range(1000)]
    assert 2 <= sum(line is not None for line in said) < 50


def test_what_the_launchers_own_zenoh_says_is_read_and_the_rest_is_shown(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("RUST_LOG", "")
    monkeypatch.delenv("RUST_LOG")
    assert refusals.ask_for_refusals()
    shown: list[str] = []
    all_shown = threading.Event()

    def show(text: str) -> None:
        shown.append(text)
        if len(shown) == 2:
            all_shown.set()

    with capfd.disabled():
        before = sys.stdout
        with refusals.own_refusals(show):
            os.write(
                1, f"{_LINK.format('no certificate')}\n{_LINK.format('no certificate')}\n".encode()
            )
            os.write(1, b"something else\n")
            assert all_shown.wait(10)
        assert sys.stdout is before
    assert shown == [
        "refused a link to somebody without a valid certificate of this system: no certificate",
        "something else",
    ]
