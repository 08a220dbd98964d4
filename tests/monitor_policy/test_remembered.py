"""Runs that are remembered do what runs of the tree itself do."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from random import Random

import pytest

from m2c.policy.program import Policy
from moon.policy import remembered
from moon.policy.remembered import RememberedTree
from moon.policy.run import BEGIN, Ask, AskKind, TreeRun, Trees
from moon.policy.shape import shape_of
from tests.monitor_policy.scripted import leaf, tree
from tests.monitor_policy.trees import random_tree

ANSWERS = {
    AskKind.TICK: ("SUCCESS", "SUCCESS", "FAILURE", "RUNNING"),
    AskKind.HALT: ("done",),
    AskKind.END: (BEGIN,),
}


@contextmanager
def runs_of(policy: Policy) -> Iterator[tuple[TreeRun, RememberedTree]]:
    """A run of the tree itself, and what is remembered of others."""
    trees = Trees(policy, frozenset(), records=False)
    itself, others = TreeRun(trees), RememberedTree(trees)
    try:
        yield itself, others
    finally:
        itself.close()
        others.close()


def plain_tree(seed: int) -> Policy:
    policy = tree(random_tree(Random(seed)))
    assert shape_of(policy).plain
    return policy


@pytest.mark.parametrize("most", [remembered.MAX_MOMENTS, 30])
@pytest.mark.parametrize("seed", range(25))
def test_the_tree_asks_the_same_whether_it_is_remembered_or_ticked(
    seed: int, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remembered, "MAX_MOMENTS", most)
    draw = Random(seed)
    with runs_of(plain_tree(seed)) as (itself, others):
        run = others.start()
        for _ in range(400):
            answer = draw.choice(ANSWERS[itself.ask.kind])
            asked, said = itself.step(answer), run.step(answer)
            if asked.kind is AskKind.END:  # how the whole tick ended is nobody's concern
                asked, said = Ask(asked.kind), Ask(said.kind)
            assert said == asked
            assert run.running == itself.running


def test_what_was_seen_once_is_not_ticked_again() -> None:
    with runs_of(plain_tree(3)) as (_, others):
        ticked = 0

        def go_through_it() -> None:
            nonlocal ticked
            run, draw = others.start(), Random(1)
            for _ in range(200):
                before = run.ask
                known = others._at
                run.step(draw.choice(ANSWERS[before.kind]))
                ticked += others._at is not known

        go_through_it()
        assert ticked
        ticked = 0
        go_through_it()
        assert not ticked


def test_a_leaf_that_is_halted_for_two_reasons_goes_on_as_each_of_them_does() -> None:
    """Halted by the fallback, the tick is over; halted by the sequence, the fallback goes on."""
    body = (
        f"<ReactiveFallback>{leaf('BatteryLevel')}<ReactiveSequence>{leaf('IsPoiDone1')}"
        f"{leaf('GoToPoi')}</ReactiveSequence>{leaf('Alarm')}</ReactiveFallback>"
    )
    begin = (BEGIN, "FAILURE", "SUCCESS", "RUNNING", BEGIN)
    with runs_of(tree(body)) as (_, others):
        one, other = others.start(), others.start()
        one.follow((*begin, "SUCCESS"))
        other.follow((*begin, "FAILURE", "FAILURE"))
        assert one.ask == other.ask
        assert one.ask.kind is AskKind.HALT
        assert one.key != other.key
        assert one.step("done").kind is AskKind.END
        asked = other.step("done")
        assert asked.leaf is not None
        assert asked.leaf.name == "Alarm"


def test_a_fork_goes_its_own_way() -> None:
    with runs_of(tree(f"<Sequence>{leaf('BatteryLevel')}{leaf('Alarm')}</Sequence>")) as (
        _,
        others,
    ):
        one = others.start()
        one.due_ns = 7
        one.step(BEGIN)
        other = one.fork()
        assert other.key == one.key
        assert other.due_ns == one.due_ns
        assert one.step("SUCCESS").kind is AskKind.TICK
        assert other.step("FAILURE").kind is AskKind.END


def test_no_thread_is_left_when_it_is_closed() -> None:
    before = threading.active_count()
    with runs_of(plain_tree(1)) as (_, others):
        others.start().step(BEGIN)
        assert threading.active_count() > before
    assert threading.active_count() == before
