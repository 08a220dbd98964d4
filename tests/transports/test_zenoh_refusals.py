"""What is made of Zenoh's own log: a refusal is said, and what Zenoh itself keeps back is none."""

from __future__ import annotations

import pytest

from transports.zenoh_link import refusals

_LINE = (
    "2026-11-25T12:30:22.955788Z TRACE {}ThreadId(01) zenoh::net::routing::interceptor: "
    "Msg intercepted!"
)


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
