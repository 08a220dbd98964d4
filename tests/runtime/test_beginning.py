"""When the nodes of a process begin: each is linked to those who observe the run, or does not wait for it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection
from typing import Any

import pytest

from m2c.runtime import beginning
from m2c.runtime.beginning import Observers


class _Linking:
    """A connection whose links are made when the test says so; those ``at_once`` as they are waited for."""

    def __init__(self, node: str, at_once: Collection[str] = ()) -> None:
        self.node = node
        self.known: Collection[str] = ()
        self.waiting: dict[str, Callable[[], None]] = {}
        self._at_once = at_once

    def when_observed(self, by: str, nodes: Collection[str], handler: Callable[[], None]) -> None:
        self.known = nodes
        self.waiting[by] = handler
        if by in self._at_once:
            handler()


class _Linked:
    """One of a middleware on which whoever listens is linked to all who connect."""

    node = "n"


def waiting(observers: Observers, *connections: Any) -> threading.Thread:
    thread = threading.Thread(target=observers.wait, args=[connections])
    thread.start()
    return thread


def test_nobody_waits_whom_nobody_observes_or_who_is_linked_as_it_connects() -> None:
    nodes: list[Any] = [_Linking("a"), _Linked()]
    Observers([]).wait(nodes)
    Observers(["monitor"]).wait(nodes[1:])


def test_the_nodes_of_a_process_begin_once_all_are_linked_to_all_observers() -> None:
    both = ("monitor", "recorder")
    one, other = _Linking("a", both), _Linking("b", both[:1])
    thread = waiting(Observers(both), one, other)
    thread.join(0.05)
    assert thread.is_alive()
    other.waiting["recorder"]()
    thread.join()


def test_the_observers_are_to_know_of_the_nodes_that_a_policy_waits_for() -> None:
    policy: Any = _Linking("policy", ("monitor",))
    Observers(["monitor"]).wait([policy], ("a", "b"))
    assert policy.known == ("a", "b")


def test_who_is_told_to_end_does_not_wait() -> None:
    observers = Observers(["monitor"])
    thread = waiting(observers, _Linking("a"))
    observers.give_up()
    thread.join()
    asked_before = Observers(["monitor"])
    asked_before.give_up()
    waiting(asked_before, _Linking("a")).join()


def test_who_is_not_linked_in_time_is_named_and_does_not_keep_the_others(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(beginning, "LINKED_S", 0.01)
    nodes: list[Any] = [_Linking("b"), _Linking("c", ("monitor",)), _Linking("a")]
    Observers(["monitor"]).wait(nodes)
    assert [record.getMessage() for record in caplog.records] == [
        "monitor does not receive all that a, b sends after 0.01 s: what it does first may be missed"
    ]
