"""Tokens of presence, on a session of the test's own."""

from __future__ import annotations

import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
import zenoh

from transports.refusals import Refusals
from transports.zenoh import presence
from transports.zenoh.names import LINK_KEYS, NODE_KEYS
from transports.zenoh.presence import Announcements
from transports.zenoh_link.executor import Executor
from transports.zenoh_link.log import LOG

pytestmark = pytest.mark.zenoh

MOMENT_S = 0.05


class Token:
    """A token that is withdrawn at most once, as Zenoh has it."""

    def __init__(self, key: str) -> None:
        self.key = key
        self.withdrawn = 0

    def undeclare(self) -> None:
        self.withdrawn += 1
        if self.withdrawn > 1:
            raise zenoh.ZError(f"Undeclared {self.key}")


class Session:
    """Keeps the tokens that were declared; ``declared(key)`` is called for each."""

    def __init__(self) -> None:
        self.tokens: list[Token] = []
        self.declared: Callable[[str], None] = lambda key: None
        self.info = SimpleNamespace(zid=lambda: "here")

    def liveliness(self) -> Session:
        return self

    def declare_subscriber(self, key: str, *_: object, history: bool) -> Token:
        return self.declare_token(key)

    def declare_token(self, key: str) -> Token:
        self.tokens.append(Token(key))
        self.declared(key)
        return self.tokens[-1]


@pytest.fixture(autouse=True)
def _links_told_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(presence, "LINKS_PERIOD_S", 0.0)


def up(node: str) -> Any:
    return SimpleNamespace(key_expr=f"{NODE_KEYS}/{node}/{node}/1", kind=zenoh.SampleKind.PUT)


def announced() -> tuple[Session, Announcements]:
    session: Any = Session()
    announcement = Announcements(session, Executor(), Refusals(LOG))
    announcement.add("own", 1)
    announcement._receive(up("first"))
    return session, announcement


def test_a_node_that_closes_while_it_hears_of_another_withdraws_each_token_once() -> None:
    session, announcement = announced()
    closer = threading.Thread(target=announcement.undeclare)

    def close_meanwhile(key: str) -> None:
        if key.startswith(LINK_KEYS):
            closer.start()
            closer.join(MOMENT_S)

    session.declared = close_meanwhile
    announcement._receive(up("second"))
    closer.join()
    assert {token.key: token.withdrawn for token in session.tokens} == {
        token.key: 1 for token in session.tokens
    }
    assert len(session.tokens) == 4


def test_a_node_that_was_closed_declares_nothing_when_it_hears_of_another() -> None:
    session, announcement = announced()
    announcement.undeclare()
    announcement._receive(up("second"))
    assert [token.withdrawn for token in session.tokens] == [1, 1, 1]


def test_a_signal_may_close_a_node_while_it_hears_of_another() -> None:
    session, announcement = announced()

    def close_here(key: str) -> None:
        if key.startswith(LINK_KEYS):
            announcement.undeclare()

    session.declared = close_here
    announcement._receive(up("second"))  # ends, and says nothing
    assert [token.withdrawn >= 1 for token in session.tokens[:3]] == [True] * 3
