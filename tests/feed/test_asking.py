"""Nodes are asked how far they have reported: an answer is held against when its question was put."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, cast

import pytest

from moon.feed.asking import Asking
from transports.interface import Answer, Tap

MS = 1_000_000
ANSWER = Answer(1, 0)


class Asked:
    """A tap whose node answers when the test says so, and the monitor's clock."""

    def __init__(self) -> None:
        self.now = 1000 * MS
        self.open: list[Callable[[Answer | None], None]] = []
        self.seen: list[int] = []
        self.asking = Asking(self.answered, lambda: self.now)

    def answered(self, node: str, answer: Answer, asked_ns: int) -> None:
        self.seen.append(asked_ns // MS)

    def ask(self, node: str, answered: Callable[[Answer | None], None]) -> None:
        self.open.append(answered)

    def at(self, ms: int, does: Callable[..., Any], *arguments: object) -> None:
        self.now = ms * MS
        does(*arguments)

    def answer(self, place: int = 0, answer: Answer | None = ANSWER) -> None:
        self.open.pop(place)(answer)


@pytest.fixture
def asked() -> Asked:
    return Asked()


def test_an_answer_is_held_against_its_own_question_where_several_are_under_way(
    asked: Asked,
) -> None:
    ask = functools.partial(asked.asking.ask, cast("Tap", asked), "A")
    asked.at(1000, ask)
    asked.at(1010, ask)
    asked.at(1020, asked.answer)
    asked.at(1030, ask)
    asked.at(1400, asked.answer, 1)
    asked.at(1410, asked.answer)
    assert asked.seen == [1000, 1030, 1010]


def test_where_an_answer_says_when_it_was_asked_that_counts(asked: Asked) -> None:
    """In a recording the last question gets all answers."""
    asked.at(1000, asked.asking.ask, cast("Tap", asked), "A")
    asked.at(1020, asked.answer, 0, Answer(1, 0, asked_ns=990 * MS))
    assert asked.seen == [990]


@pytest.mark.parametrize("step_ms", [-3_600_000, -50, 50, 3_600_000])
def test_nothing_is_compared_across_a_clock_that_was_set(asked: Asked, step_ms: int) -> None:
    ask = functools.partial(asked.asking.ask, cast("Tap", asked), "A")
    asked.at(4_000_000, ask)
    asked.at(4_000_010 + step_ms, asked.asking.clock_set)
    asked.at(4_000_020 + step_ms, asked.answer)
    asked.at(4_000_030 + step_ms, ask)
    asked.at(4_000_040 + step_ms, asked.answer)
    assert asked.seen == [0, 4_000_030 + step_ms]
