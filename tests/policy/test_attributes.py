"""Attributes that begin with ``_``: BehaviorTree.CPP reads a few, and editors keep theirs there."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.model import DiagnosticLog
from m2c.policy.reader import read_policy_file

LEAF = '<Action ID="A" service_name="/A/tick"/>'
PLACES = {
    "tree": ('<BehaviorTree ID="M"{}>' + LEAF + "</BehaviorTree>", "BehaviorTree"),
    "control": (f'<BehaviorTree ID="M"><Sequence{{}}>{LEAF}</Sequence></BehaviorTree>', "Sequence"),
    "leaf": ('<BehaviorTree ID="M"><Action ID="A" service_name="/A/tick"{}/></BehaviorTree>', ""),
    "waiting": ('<BehaviorTree ID="M"><Sleep msec="1"{}/></BehaviorTree>', "Sleep"),
    "sub-tree": (
        '<BehaviorTree ID="M"><SubTree ID="N"{}/></BehaviorTree>'
        f'<BehaviorTree ID="N">{LEAF}</BehaviorTree>',
        "SubTree",
    ),
}


def read(folder: Path, trees: str) -> tuple[bool, list[str]]:
    path = folder / "policy.xml"
    path.write_text(f'<root BTCPP_format="4" main_tree_to_execute="M">{trees}</root>')
    log = DiagnosticLog()
    policy = read_policy_file(path, log)
    if policy is not None:
        assert not any("_fav" in key for leaf in policy.leaves() for key, _ in leaf.attributes)
    return policy is not None, [str(found).split(": ", 1)[1] for found in log.diagnostics]


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(
    "written", ["_favourite", "_fav_colour", "_collapsed", "_x", "_", "_description", "_uid"]
)
def test_an_editor_s_attribute_is_ignored_wherever_it_stands(
    tmp_path: Path, place: str, written: str
) -> None:
    for value in ("1", "", "{an entry}", "{n}", "a &lt; b &amp;&amp;"):
        assert read(tmp_path, PLACES[place][0].format(f' {written}="{value}"')) == (True, [])


@pytest.mark.parametrize("place", [place for place in PLACES if place != "tree"])
def test_what_looks_like_a_misspelt_script_is_a_warning(tmp_path: Path, place: str) -> None:
    is_read, (said,) = read(tmp_path, PLACES[place][0].format(' _onSucces="n := 1"'))
    assert is_read
    assert said.startswith("warning")
    assert "BehaviorTree.CPP ignores `_onSucces` here; did you mean _onSuccess?" in said


@pytest.mark.parametrize("place", ["control", "leaf", "waiting", "tree"])
def test_only_a_sub_tree_is_remapped(tmp_path: Path, place: str) -> None:
    is_read, (said,) = read(tmp_path, PLACES[place][0].format(' _autoremap="true"'))
    assert is_read
    assert "ignores `_autoremap` here; only a <SubTree> has it" in said


@pytest.mark.parametrize(
    ("attribute", "said"),
    [
        ('main_tree_to_execute="M"', "a tree has no `main_tree_to_execute`; write it on <root>"),
        ('BTCPP_format="4"', "a tree has no `BTCPP_format`; write it on <root>"),
        ('num_cycles="2"', "a tree has no `num_cycles`; write it on the tree's root node"),
        ('Name="M"', "a tree has no `Name`; did you mean name?"),
        ('colour="red"', "a tree has no `colour`; remove it; a tree has ID"),
    ],
)
def test_any_other_attribute_of_a_tree_is_an_error_that_says_where_it_belongs(
    tmp_path: Path, attribute: str, said: str
) -> None:
    tree = f'<BehaviorTree ID="M" {attribute}><Repeat num_cycles="2">{LEAF}</Repeat></BehaviorTree>'
    is_read, found = read(tmp_path, tree)
    assert not is_read
    assert said in found[0]


def test_a_script_on_a_tree_is_never_run_and_that_is_said(tmp_path: Path) -> None:
    is_read, (said,) = read(tmp_path, PLACES["tree"][0].format(' _skipIf="1 == 1"'))
    assert is_read
    assert "ignores `_skipIf` here; write it on the tree's root node" in said
