"""What the page on behaviour trees says is what happens: every example of its lists is run."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from m2c.policy.tree import BUILTINS, CONDITIONS, MANY
from tests.docs.trees import read, statuses

REFERENCE = (Path(__file__).parents[2] / "docs" / "behaviour-trees.md").read_text()
ROWS = [
    [cell.strip().replace("\\|", "|") for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
    for line in REFERENCE.splitlines()
    if line.startswith("| `")
]
NODES = [row for row in ROWS if len(row) == 5]
ATTRIBUTES = [row for row in ROWS if len(row) == 4]
REFUSED = [row for row in ROWS if len(row) == 2 and row[0].startswith("`` <")]


def shown(cell: str) -> str:
    return cell.strip("` ")


def named(cell: str) -> list[str]:
    """The names in a cell: `` `Switch2` … `Switch6` `` are five."""
    found = re.findall(r"`(\w+)`", cell)
    if "…" not in cell:
        return found
    first, last = (int(name[-1]) for name in found)
    return [f"{found[0][:-1]}{number}" for number in range(first, last + 1)]


def test_every_node_and_attribute_that_works_is_in_the_reference() -> None:
    assert sorted(name for row in NODES for name in named(row[0])) == sorted([*BUILTINS, "SubTree"])
    assert sorted(name for row in ATTRIBUTES for name in named(row[0])) == sorted(CONDITIONS)


@pytest.mark.parametrize("name", BUILTINS)
def test_the_reference_has_the_children_and_the_ports_of_a_node(name: str) -> None:
    row = next(row for row in NODES if name in named(row[0]))
    node = BUILTINS[name]
    if name.startswith("Switch"):
        assert (node.least, node.most) == (int(name[-1]) + 1,) * 2
        assert row[1:3] == ["3 … 7, the last for no case", "**`variable`**, `case_1`, `case_2` …"]
        return
    many = f"{node.least} to {node.most}" if node.most < MANY else f"{node.least} or more"
    children = str(node.least or "none") if node.least == node.most else many
    assert row[1] == children
    assert re.findall(r"`(\w+)`", row[2]) == list(node.ports)


@pytest.mark.parametrize(
    ("example", "expected"),
    [(shown(row[-2]), row[-1].split(", ")) for row in (*NODES, *ATTRIBUTES)],
    ids=[row[0] for row in (*NODES, *ATTRIBUTES)],
)
def test_an_example_of_a_tree_gives_the_statuses_beside_it(
    tmp_path: Path, example: str, expected: list[str]
) -> None:
    assert statuses(tmp_path, example, len(expected)) == expected


@pytest.mark.parametrize(
    ("name", "example", "port"),
    [
        (row[0], shown(row[3]), port)
        for row in NODES
        for port in re.findall(r"\*\*`(\w+)`\*\*", row[2])
        if port != "ID"
    ],
)
def test_a_port_that_is_needed_is_asked_for(
    tmp_path: Path, name: str, example: str, port: str
) -> None:
    tag = named(name)[0]
    without = re.sub(rf'(<{tag}[^>]*?) {port}="[^"]*"', r"\1", example)
    assert without != example
    policy, said = read(tmp_path, without)
    assert policy is None
    assert any(f"`{port}` is missing" in line for line in said), said


@pytest.mark.parametrize(("example", "said"), [(shown(row[0]), shown(row[1])) for row in REFUSED])
def test_an_example_of_what_does_not_work_is_refused_with_these_words(
    tmp_path: Path, example: str, said: str
) -> None:
    policy, found = read(tmp_path, example)
    assert policy is None
    assert found[0] == said


OLD_WORDS = {
    '<SequenceStar><S/><F/></SequenceStar>': "FAILURE",
    '<RetryUntilSuccesful num_attempts="2"><F/></RetryUntilSuccesful>': "FAILURE",
    '<Parallel success_threshold="1" failure_threshold="2"><S/><F/></Parallel>': "SUCCESS",
    '<BehaviorTree ID="Main"><Sequence><Script code="n := 3"/><SubTreePlus ID="T" __autoremap="true"/>'
    '</Sequence></BehaviorTree><BehaviorTree ID="T"><ScriptCondition code="n == 3"/></BehaviorTree>': "SUCCESS",
    '<BehaviorTree ID="Main"><Sequence><Script code="n := 3"/><SubTree ID="T" __shared_blackboard="true"/>'
    '</Sequence></BehaviorTree><BehaviorTree ID="T"><ScriptCondition code="n == 3"/></BehaviorTree>': "SUCCESS",
}  # fmt: skip


@pytest.mark.parametrize("example", OLD_WORDS)
def test_the_words_of_format_3_work(tmp_path: Path, example: str) -> None:
    assert statuses(tmp_path, example, 1) == [OLD_WORDS[example]]


SCRIPTS = [
    "n := 1; n = 2; n += 3; n -= 1; n *= 2; n /= 4; ok := n == 2",
    "n := 1; ok := n != 2 && n < 2 && n <= 1 && !(n > 1) || n >= 5",
    "n := 1; ok := n == 1 ? true : false",
    "t := 'a b := c'; ok := t == 'a b := c'",
    "n := 0x10 + 1.5e1; ok := n == 31",
]


@pytest.mark.parametrize("script", SCRIPTS)
def test_the_operators_of_scripts_work(tmp_path: Path, script: str) -> None:
    escaped = script.replace("&", "&amp;").replace("<", "&lt;")
    tree = f'<Sequence><Script code="{escaped}"/><ScriptCondition code="ok"/></Sequence>'
    assert statuses(tmp_path, tree, 1) == ["SUCCESS"]
