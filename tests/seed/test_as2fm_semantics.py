"""AS2FM's systems, run with its meaning: its own expected results, and why ours differ where they do."""

from __future__ import annotations

from collections.abc import Collection

import pytest

from tests.seed.as2fm import HEADER, SEED, Row, cases, table
from tests.seed.halting import use_trees

pytestmark = [
    pytest.mark.seed,
    pytest.mark.skipif(not SEED.is_dir(), reason="AS2FM's systems are not beside the checkout"),
]

_COUNTS = "it counts how often leaves are halted, those that have ended or never started as well"
SEEDS = 5
HALTING = {
    "systems/bt_test_models/main_test_reactive_sequence.xml": _COUNTS,
    "systems/bt_test_models/main_test_reactive_fallback.xml": _COUNTS,
    "systems/bt_test_models/main_test_sequence.xml": _COUNTS,
    "systems/bt_test_models/main_test_fallback.xml": _COUNTS,
    "systems/bt_test_models/main_test_repeat.xml": _COUNTS,
    "systems/uc1_docking/main.xml": (
        "its leaf that waits begins anew only when it is halted after it has ended: where it is not, the robot "
        "looks too early whether it is charged, and drives away"
    ),
}
"""What differs because BehaviorTree.CPP, which robots run, halts running nodes only."""
ENDS = "systems/robot_navigation_with_bt/main.xml"
OTHERS = {
    "systems/string_msg_comparison/main.xml": "m2c check refuses it: the two ends of a topic disagree about its type",
    ENDS: "AS2FM only converts it: the tree ends with its first tick, long before the robot is at its goal",
}
"""What differs for another reason."""


def _rows(names: Collection[str] | None, seeds: int, **changed: object) -> list[Row]:
    chosen = [case for case in cases() if names is None or case.system in names]
    return table(chosen, seeds, **changed)


def test_every_case_that_is_certain_agrees_but_for_those_listed_here() -> None:
    rows = _rows(None, SEEDS)
    print("\n".join([HEADER, *(row.line() for row in rows)]))
    certain = [row for row in rows if row.case.probability in (0, 1)]
    assert len(certain) == 53
    differing = {row.case.system for row in certain if not row.agrees}
    assert differing == {*HALTING, *OTHERS}


@pytest.mark.parametrize("halts_all", [True, False])
def test_what_differs_because_of_halting_agrees_where_only_that_is_changed(
    halts_all: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    use_trees(monkeypatch, halts_all)
    rows = _rows(HALTING, SEEDS)
    assert len(rows) == len(HALTING)
    assert [row.line() for row in rows if row.agrees is not halts_all] == []


def test_the_tree_that_ends_too_early_reaches_the_goal_where_it_is_ticked_on() -> None:
    (row,) = _rows([ENDS], SEEDS, tick_if_not_running=True)
    assert not row.case.upstream_checks_it
    assert row.agrees, row.line()
