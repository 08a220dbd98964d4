"""Ports of sub-trees as format 3 has them: the name of an entry, without braces."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.model import DiagnosticLog
from m2c.policy.reader import read_policy_file
from m2c.policy.tree import BuiltinNode, SubTreeNode

SET = '<SetBlackboard output_key="goal" value="3"/>'
INNER = '<BehaviorTree ID="T"><ScriptCondition code="target == 3"/></BehaviorTree>'


def given(folder: Path, root: str, use: str, before: str = SET) -> tuple[dict[str, str], list[str]]:
    """What the sub-tree in ``use`` is given, and what is said of it."""
    path = folder / "policy.xml"
    main = f'<BehaviorTree ID="M"><Sequence>{before}\n{use}</Sequence></BehaviorTree>'
    path.write_text(f'<root main_tree_to_execute="M" {root}>{main}{INNER}</root>')
    log = DiagnosticLog()
    policy = read_policy_file(path, log)
    assert policy is not None, log.diagnostics
    sequence = policy.trees[0].root
    assert isinstance(sequence, BuiltinNode)
    found = sequence.children[-1]
    assert isinstance(found, SubTreeNode)
    return dict(found.attributes), [str(item).split("policy.xml:")[1] for item in log.diagnostics]


@pytest.mark.parametrize("root", ['BTCPP_format="3"', ""])
def test_a_port_of_a_sub_tree_names_an_entry(tmp_path: Path, root: str) -> None:
    ports, said = given(tmp_path, root, '<SubTree ID="T" target="goal"/>')
    assert ports == {"target": "{goal}"}
    assert said == [
        "2:25: note: <SubTree>: `goal` is read as `{goal}`; "
        "in format 3 it is the name of an entry [older-spelling]"
    ]


@pytest.mark.parametrize(
    ("root", "use", "value"),
    [
        ('BTCPP_format="4"', '<SubTree ID="T" target="goal"/>', "goal"),
        ("", '<SubTree ID="T" target="gaol"/>', "gaol"),
        ("", '<SubTree ID="T" target="target"/>', "target"),
        ('BTCPP_format="3"', '<SubTree ID="T" target="gaol"/>', "{gaol}"),
        ('BTCPP_format="3"', '<SubTree ID="T" target="{goal}"/>', "{goal}"),
        ('BTCPP_format="3"', '<SubTree ID="T" target="3"/>', "3"),
        ('BTCPP_format="3"', '<SubTree ID="T" target="1;2;3"/>', "1;2;3"),
        ('BTCPP_format="3"', '<SubTree ID="T" target=""/>', ""),
        ('BTCPP_format="3"', '<SubTreePlus ID="T" target="goal"/>', "goal"),
        ("", '<SubTreePlus ID="T" target="{goal}"/>', "{goal}"),
    ],
)
def test_what_is_a_text_in_format_4_stays_one(
    tmp_path: Path, root: str, use: str, value: str
) -> None:
    assert given(tmp_path, root, use)[0] == {"target": value}


@pytest.mark.parametrize(
    "before",
    ['<Script code="goal := 3"/>', '<A service_name="/A/tick" where="{goal}"/>'],
)
def test_without_a_declared_format_an_entry_is_one_that_another_tree_has(
    tmp_path: Path, before: str
) -> None:
    assert given(tmp_path, "", '<SubTree ID="T" target="goal"/>', before)[0] == {"target": "{goal}"}


@pytest.mark.parametrize("declared", ["3", "4", "3.8", "4.6"])
def test_formats_that_exist_are_not_told(tmp_path: Path, declared: str) -> None:
    _, said = given(tmp_path, f'BTCPP_format="{declared}"', '<SubTree ID="T" target="{goal}"/>')
    assert said == []


@pytest.mark.parametrize("declared", ["5", "44", "v4", "4,0"])
def test_a_format_that_does_not_exist_is_told(tmp_path: Path, declared: str) -> None:
    _, (said,) = given(tmp_path, f'BTCPP_format="{declared}"', '<SubTree ID="T" target="{goal}"/>')
    assert said == (
        f"1:46: warning: <root>: there is no format `{declared}`: the file is read as one of format 4; "
        'write BTCPP_format="4", or "3" for one of BehaviorTree.CPP 3 [ignored-attribute]'
    )


@pytest.mark.parametrize("first", ["", "<BehaviorTree><AlwaysSuccess/></BehaviorTree>"])
@pytest.mark.parametrize("main", ["", 'main_tree_to_execute="B"'])
def test_a_tree_without_a_name_is_alone_or_an_error_at_its_place(
    tmp_path: Path, first: str, main: str
) -> None:
    path = tmp_path / "policy.xml"
    nameless = '<BehaviorTree ID=""><AlwaysSuccess/></BehaviorTree>'
    named = '<BehaviorTree ID="B"><AlwaysSuccess/></BehaviorTree>'
    path.write_text(f"<root {main}>{first}\n{nameless}\n{named}</root>")
    log = DiagnosticLog()
    assert read_policy_file(path, log) is None
    said = [str(item).split("policy.xml:")[1] for item in log.diagnostics]
    error = (
        "error: <BehaviorTree>: the attribute `ID` is missing; where a file has several trees, "
        "each needs a name [missing-attribute]"
    )
    places = ["2:1", f"1:{8 + len(main)}"] if first else ["2:1"]
    assert sorted(said) == sorted(f"{place}: {error}" for place in places)
