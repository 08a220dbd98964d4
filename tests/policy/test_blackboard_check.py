"""``BlackboardCheckInt`` and its like of format 3, and ``SetBlackboard`` with its entry in braces."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.docs.trees import read, statuses

CHECK = '<BlackboardCheckInt value_A="{}" value_B="{}" {}>{}</BlackboardCheckInt>'
SETS = '<SetBlackboard output_key="n" value="{}"/>'


@pytest.mark.parametrize(
    ("one", "other", "mismatch", "expected"),
    [
        ("{n}", "1", "", "SUCCESS"),
        ("1", "{n}", 'return_on_mismatch="RUNNING"', "SUCCESS"),
        ("{n}", "+1", "", "SUCCESS"),
        ("{n}", "2", "", "FAILURE"),
        ("{n}", "-1", 'return_on_mismatch="SUCCESS"', "SUCCESS"),
        ("{n}", "2", 'return_on_mismatch="RUNNING"', "RUNNING"),
        ("{n}", "2", 'return_on_mismatch="1"', "SUCCESS"),
        ("{n}", "2", 'return_on_mismatch="2"', "FAILURE"),
        ("{n}", "2", 'return_on_mismatch="3"', "RUNNING"),
    ],
)
def test_values_that_differ_give_the_status_for_that(
    tmp_path: Path, one: str, other: str, mismatch: str, expected: str
) -> None:
    checked = CHECK.format(one, other, mismatch, "<S/>")
    tree = f"<Sequence>{SETS.format(1)}{checked}</Sequence>"
    assert statuses(tmp_path, tree, 2) == [expected, expected]


def test_the_values_are_looked_at_at_each_tick_and_a_running_child_is_halted(
    tmp_path: Path,
) -> None:
    child = '<R _onHalted="halted := 1"/>'
    checked = CHECK.format("{n}", "2", 'return_on_mismatch="SUCCESS"', child)
    tree = (
        '<Sequence><Script code="n := 0; halted := 0"/><ReactiveSequence><Script code="n += 1"/>'
        f'{checked}<ScriptCondition code="n == 1 || halted == 1"/><Sleep msec="500"/>'
        "</ReactiveSequence></Sequence>"
    )
    # n is 1 (differs, sleeps), 2 (equal, the child runs), 3 (differs: the child is halted)
    assert statuses(tmp_path, tree, 3) == ["RUNNING", "RUNNING", "RUNNING"]
    tree = tree.replace("halted == 1", "halted == 0")
    assert statuses(tmp_path, tree, 3) == ["RUNNING", "RUNNING", "FAILURE"]


@pytest.mark.parametrize(
    ("element", "said"),
    [
        (
            CHECK.format("{n}", "many", "", "<S/>"),
            "`value_B` cannot be `many`; an integer, or an entry, {…}",
        ),
        (
            CHECK.format("{n}", "1", 'return_on_mismatch="SKIPPED"', "<S/>"),
            "`return_on_mismatch` cannot be `SKIPPED`; one of SUCCESS, FAILURE, RUNNING, or 1, 2, 3 for them",
        ),
        (CHECK.format("{n}", "1", "", "<S/><F/>"), "2 children; BlackboardCheckInt takes 1"),
        (
            CHECK.format("{n}", "1", 'on_mismatch="1"', "<S/>"),
            "BlackboardCheckInt has no port `on_mismatch`; did you mean return_on_mismatch?",
        ),
    ],
)
def test_a_check_that_is_written_wrongly_is_refused_with_its_own_words(
    tmp_path: Path, element: str, said: str
) -> None:
    policy, found = read(tmp_path, f"<Sequence>{SETS.format(1)}{element}</Sequence>")
    assert policy is None
    assert found == [f"<BlackboardCheckInt>: {said}"]


@pytest.mark.parametrize("set_by", ["SetBlackboard", "Script"])
@pytest.mark.parametrize(
    ("kind", "value", "script", "equal", "other"),
    [
        ("Double", "0.5", "0.5", "0.50", "-2"),
        ("Double", "3", "3", "3.0", "1e3"),
        ("String", "go on", "'go on'", "go on", "go"),
        ("Bool", "true", "true", "1", "false"),
        ("Bool", "false", "false", "False", "true"),
    ],
)
def test_values_of_every_kind_are_compared(
    tmp_path: Path, set_by: str, kind: str, value: str, script: str, equal: str, other: str
) -> None:
    sets = SETS.format(value) if set_by == "SetBlackboard" else f'<Script code="n := {script}"/>'
    for against, expected in ((equal, "RUNNING"), (other, "FAILURE")):
        check = CHECK.replace("CheckInt", f"Check{kind}").format("{n}", against, "", "<R/>")
        assert statuses(tmp_path, f"<Sequence>{sets}{check}</Sequence>", 1) == [expected]


@pytest.mark.parametrize(
    ("kind", "value", "wanted"),
    [
        ("Double", "fast", "a number"),
        ("Double", "nan", "a number"),
        ("Bool", "yes", "true or false"),
        ("String", "it's", "a text without '"),
    ],
)
def test_a_value_of_another_kind_is_refused(
    tmp_path: Path, kind: str, value: str, wanted: str
) -> None:
    check = CHECK.replace("CheckInt", f"Check{kind}").format("{n}", value, "", "<S/>")
    policy, found = read(tmp_path, f"<Sequence>{SETS.format(1)}{check}</Sequence>")
    assert policy is None
    said = f"`value_B` cannot be `{value}`; {wanted}, or an entry, {{…}}"
    assert found == [f"<BlackboardCheck{kind}>: {said}"]


def test_a_check_of_an_entry_that_nothing_sets_is_refused(tmp_path: Path) -> None:
    policy, (found,) = read(tmp_path, CHECK.format("{n}", "1", "", "<S/>"))
    assert policy is None
    assert "reads the entry `n`, which nothing in the policy sets" in found


def test_an_entry_in_braces_is_the_entry_that_is_set(tmp_path: Path) -> None:
    braced = SETS.format(5).replace('"n"', '"{n}"')
    tree = f'<Sequence>{braced}<ScriptCondition code="n == 5"/></Sequence>'
    assert statuses(tmp_path, tree, 1) == ["SUCCESS"]
