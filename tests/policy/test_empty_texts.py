"""An empty text in a port: a value where the port takes texts, else as if the port were not given."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.docs.trees import read, statuses

SET = '<SetBlackboard output_key="a" value="{}"/>'


@pytest.mark.parametrize("cases", range(2, 7))
@pytest.mark.parametrize(
    ("value", "expected"), [("", "RUNNING"), ("x", "FAILURE"), ("1", "SUCCESS")]
)
def test_an_empty_case_is_the_one_of_an_empty_text(
    tmp_path: Path, cases: int, value: str, expected: str
) -> None:
    other = "".join(f' case_{number}="{number}"' for number in range(1, cases))
    switch = (
        f'<Switch{cases} variable="{{a}}"{other} case_{cases}="">'
        f"{'<S/>' * (cases - 1)}<R/><F/></Switch{cases}>"
    )
    policy = f"<Sequence>{SET.format(value)}{switch}</Sequence>"
    assert statuses(tmp_path, policy, 1) == [expected]


@pytest.mark.parametrize(
    ("tree", "expected"),
    [
        (f"<Sequence>{SET.format('')}<ScriptCondition code=\"a == ''\"/></Sequence>", "SUCCESS"),
        ('<Switch2 variable="" case_1="" case_2="b"><S/><F/><F/></Switch2>', "SUCCESS"),
        ('<Switch2 variable="" case_1="a" case_2="b"><F/><F/><S/></Switch2>', "SUCCESS"),
        ('<LoopString queue="" value="{n}"><F/></LoopString>', "SUCCESS"),
        ('<LoopInt queue="" value="{n}" if_empty="FAILURE"><S/></LoopInt>', "FAILURE"),
        ('<LoopString queue=";a" value="{n}"><ScriptCondition code="n == \'\'"/></LoopString>', "RUNNING"),
        ('<Script code=""/>', "SUCCESS"),
        (
            '<BehaviorTree ID="Main"><SubTree ID="T" n=""/></BehaviorTree>'
            '<BehaviorTree ID="T"><ScriptCondition code="n == \'\'"/></BehaviorTree>',
            "SUCCESS",
        ),
    ],
)  # fmt: skip
def test_an_empty_text_is_a_value(tmp_path: Path, tree: str, expected: str) -> None:
    assert statuses(tmp_path, tree, 1) == [expected]


@pytest.mark.parametrize(
    "tree",
    [
        '<ScriptCondition code=""/>',
        '<Precondition if="" else="FAILURE"><S/></Precondition>',
        '<Repeat num_cycles=" "><S/></Repeat>',
        '<UnsetBlackboard key=""/>',
        '<WasEntryUpdated entry=""/>',
        '<BlackboardCheckInt value_A="" value_B="1"><S/></BlackboardCheckInt>',
        '<Sleep msec=""/>',
    ],
)
def test_elsewhere_an_empty_port_is_not_given(tmp_path: Path, tree: str) -> None:
    policy, said = read(tmp_path, tree)
    assert policy is None
    assert any("is missing" in line for line in said)
