"""Trees of a folder that no file includes."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.model import DiagnosticLog
from m2c.policy.reader import read_policy_file
from m2c.policy.tree import PolicyFile

LEAF = "<AlwaysSuccess/>"


def tree(name: str, content: str = LEAF) -> str:
    return f'<BehaviorTree ID="{name}">{content}</BehaviorTree>'


def use(*names: str) -> str:
    uses = [f'<SubTree ID="{name}"/>' for name in names]
    return f"<Sequence>{''.join(uses)}</Sequence>"


def read(folder: Path, files: dict[str, str]) -> tuple[PolicyFile | None, list[str]]:
    for name, content in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(
            content if content.startswith("<!") else f"<root>{content}</root>"
        )
    log = DiagnosticLog()
    policy = read_policy_file(folder / "policy.xml", log)
    return policy, [str(found).replace(f"{folder}/", "") for found in log.diagnostics]


def names(policy: PolicyFile | None) -> list[str]:
    assert policy is not None
    return [tree.id for tree in policy.trees]


def test_a_sub_tree_is_found_in_another_file_of_the_folder(tmp_path: Path) -> None:
    policy, said = read(
        tmp_path, {"policy.xml": tree("M", use("A")), "a.xml": tree("A") + tree("Other")}
    )
    assert names(policy) == ["M", "A"]
    assert policy is not None
    assert policy.main == "M"  # though no file says so
    assert said == [
        "policy.xml:1:51: note: <SubTree>: the tree `A` is taken from a.xml, which is not included; "
        'write <include path="a.xml"/> [tree-beside]'
    ]


def test_so_are_those_that_it_uses_and_what_their_files_declare(tmp_path: Path) -> None:
    declared = '<TreeNodesModel><SubTree ID="B"><input_port name="n" default="3"/></SubTree></TreeNodesModel>'
    policy, _ = read(
        tmp_path,
        {
            "policy.xml": tree("M", use("A", "B")),
            "a.xml": tree("A", use("C")) + tree("M"),
            "b.xml": tree("B", '<ScriptCondition code="n == 3"/>') + declared,
            "c.xml": tree("C", use("B")),
        },
    )
    assert names(policy) == ["M", "A", "B", "C"]


def test_a_tree_of_a_file_that_is_read_is_not_looked_for(tmp_path: Path) -> None:
    policy, said = read(
        tmp_path,
        {
            "policy.xml": f'<include path="in/a.xml"/>{tree("M", use("A"))}',
            "in/a.xml": tree("A"),
            "a.xml": tree("A", use("M")),
        },
    )
    assert policy is None  # which tree is executed is not said
    assert all("tree-beside" not in line for line in said)


def test_a_file_that_is_included_has_a_folder_of_its_own(tmp_path: Path) -> None:
    content = f'<include path="in/a.xml"/>{tree("M", use("A"))}'
    policy, said = read(
        tmp_path, {"policy.xml": content, "in/a.xml": tree("A", use("B")), "in/b.xml": tree("B")}
    )
    assert policy is None
    assert said[0].startswith("in/a.xml:1:51: note: <SubTree>: the tree `B` is taken from b.xml")
    assert "which of the trees A, M is executed is not said" in said[1]


def test_a_tree_that_several_files_have_is_an_error(tmp_path: Path) -> None:
    policy, said = read(
        tmp_path,
        {"policy.xml": tree("M", use("A")), "a.xml": tree("A"), "b.xml": tree("A")},
    )
    assert policy is None
    assert said == [
        "policy.xml:1:51: error: <SubTree>: several files of the folder have a tree `A`: a.xml, b.xml; "
        'include the one that is meant: <include path="a.xml"/> [missing-subtree]'
    ]


@pytest.mark.parametrize(
    "other", ["<!nonsense", "<scxml/>", tree("B"), f"<roaml>{tree('A')}</roaml>"]
)
def test_other_files_of_the_folder_do_not_matter(tmp_path: Path, other: str) -> None:
    policy, said = read(tmp_path, {"policy.xml": tree("M", use("A")), "other.xml": other})
    assert policy is None
    assert "the sub-tree `A` does not exist" in said[0]


def test_trees_of_a_folder_that_contain_one_another_are_an_error(tmp_path: Path) -> None:
    policy, said = read(
        tmp_path,
        {
            "policy.xml": tree("M", use("A")),
            "a.xml": tree("A", use("B")),
            "b.xml": tree("B", use("A")),
        },
    )
    assert policy is None
    assert "a tree cannot contain itself: A → B → A" in said[-1]
