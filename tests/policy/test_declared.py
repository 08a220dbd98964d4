"""What ``<TreeNodesModel>`` declares of a sub-tree's ports is what BehaviorTree.CPP makes of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.docs.trees import read, statuses

INNER = '<BehaviorTree ID="T"><ScriptCondition code="{}"/></BehaviorTree>'


def trees(ports: str, use: str, code: str, before: str = "", after: str = "") -> str:
    main = f"<Sequence>{before}{use}{after}</Sequence>"
    model = f'<TreeNodesModel><SubTree ID="T">{ports}</SubTree></TreeNodesModel>'
    return f'<BehaviorTree ID="Main">{main}</BehaviorTree>{INNER.format(code)}{model}'


@pytest.mark.parametrize("port", ["input_port", "output_port", "inout_port", "bidirectional_port"])
@pytest.mark.parametrize(
    ("default", "before", "code"),
    [
        ("3", "", "n == 3"),
        ("text", "", "n == 'text'"),
        ("{m}", '<Script code="m := 3"/>', "n == 3"),
        ("{=}", '<Script code="n := 3"/>', "n == 3"),
    ],
)
def test_a_port_that_is_not_given_has_its_default(
    tmp_path: Path, port: str, default: str, before: str, code: str
) -> None:
    declared = f'<{port} name="n" default="{default}"/>'
    assert statuses(tmp_path, trees(declared, '<SubTree ID="T"/>', code, before), 1) == ["SUCCESS"]


def test_a_value_that_is_given_counts_more_than_the_default(tmp_path: Path) -> None:
    declared = '<input_port name="n" default="3"/>'
    policy = trees(declared, '<SubTree ID="T" n="4"/>', "n == 4")
    assert statuses(tmp_path, policy, 1) == ["SUCCESS"]


def test_an_output_by_default_reaches_the_tree_around(tmp_path: Path) -> None:
    declared = '<output_port name="out" default="{result}"/>'
    policy = trees(declared, '<SubTree ID="T"/>', "true", "", '<ScriptCondition code="result==5"/>')
    policy = policy.replace('<ScriptCondition code="true"/>', '<Script code="out := 5"/>')
    assert statuses(tmp_path, policy, 1) == ["SUCCESS"]


@pytest.mark.parametrize("port", ["input_port", "output_port", "inout_port"])
@pytest.mark.parametrize("default", ["", 'default=""'])
def test_a_port_without_a_default_has_to_be_given(tmp_path: Path, port: str, default: str) -> None:
    declared = f'<{port} name="n" {default}/><{port} name="m" {default}/>'
    policy, said = read(tmp_path, trees(declared, '<SubTree ID="T" m="1"/>', "m == 1"))
    assert policy is None
    assert said == [
        "<SubTree>: the port `n` of the tree `T` is not given; "
        'write n="…": it has no default in <TreeNodesModel>'
    ]


@pytest.mark.parametrize("remaps", ["true", "1"])
def test_a_sub_tree_with_the_entries_around_it_takes_no_defaults(
    tmp_path: Path, remaps: str
) -> None:
    declared = '<input_port name="n"/><input_port name="m" default="3"/>'
    use = f'<SubTree ID="T" _autoremap="{remaps}"/>'
    policy = trees(declared, use, "n + m == 3", '<Script code="n := 1; m := 2"/>')
    assert statuses(tmp_path, policy, 1) == ["SUCCESS"]


def test_what_is_declared_in_an_included_file_counts(tmp_path: Path) -> None:
    whole = trees('<input_port name="n" default="3"/>', '<SubTree ID="T"/>', "n == 3")
    main, _, model = whole.partition("<TreeNodesModel>")
    (tmp_path / "model.xml").write_text(f"<root><TreeNodesModel>{model}</root>")
    assert statuses(tmp_path, f'{main}<include path="model.xml"/>', 1) == ["SUCCESS"]
