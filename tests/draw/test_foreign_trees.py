"""Whatever ``m2c check`` accepts of a policy is drawn, and trees of others with leaves that nobody declares."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from m2c.cli import main
from tests.docs.test_trees import NODES, shown

FOREIGN = """<root BTCPP_format="4" main_tree_to_execute="Tour">
  <include path="recover.xml"/>
  <BehaviorTree ID="Tour" _collapsed="true">
    <RecoveryNode number_of_retries="6" name="Navigate">
      <PipelineSequence name="With replanning">
        <RateController hz="1.0">
          <FindPath goal="{goal}" path="{path}" planner="{planner}"/>
        </RateController>
        <Patience seconds="3"><FollowPath path="{path}"/></Patience>
      </PipelineSequence>
      <SubTree ID="Recover" _autoremap="true"/>
    </RecoveryNode>
  </BehaviorTree>
</root>
"""
RECOVER = """<root BTCPP_format="4"><BehaviorTree ID="Recover">
  <ReactiveFallback><GoalChanged/><RoundRobin><Turn angle="1.57"/><Control ID="Slowly"><Back/></Control></RoundRobin>
  <RetryUntilSuccessful num_attempts="{attempts}"><Beep/></RetryUntilSuccessful></ReactiveFallback>
</BehaviorTree></root>
"""


def ran(*arguments: object) -> tuple[int, str]:
    result = CliRunner().invoke(main, [*map(str, arguments)])
    return result.exit_code, result.output


def drawn(path: Path) -> list[str]:
    """The picture of ``path`` in each format."""
    pictures = []
    for suffix in (".svg", ".mmd", ".dot"):
        code, said = ran("draw", path, "-o", path.with_suffix(suffix))
        assert code == 0, said
        pictures.append(path.with_suffix(suffix).read_text())
    return pictures


@pytest.mark.parametrize("example", [shown(row[3]) for row in NODES], ids=[row[0] for row in NODES])
def test_what_the_check_accepts_is_drawn(tmp_path: Path, example: str) -> None:
    path = tmp_path / "policy.xml"
    if not example.startswith("<BehaviorTree"):
        example = f'<BehaviorTree ID="Main">{example}</BehaviorTree>'
    path.write_text(f'<root BTCPP_format="4" main_tree_to_execute="Main">{example}</root>')
    code, said = ran("check", path)
    assert code == 0, said
    assert all(picture for picture in drawn(path))


def test_a_tree_with_leaves_that_are_not_known_is_drawn(tmp_path: Path) -> None:
    path = tmp_path / "tour.xml"
    path.write_text(FOREIGN)
    (tmp_path / "recover.xml").write_text(RECOVER)
    for picture in drawn(path):
        for name in ("FindPath", "FollowPath", "Patience", "RecoveryNode", "Turn", "Slowly"):
            assert name in picture


def test_leaves_of_included_files_may_be_plugins_too(tmp_path: Path) -> None:
    path = tmp_path / "tour.xml"
    path.write_text(FOREIGN)
    (tmp_path / "recover.xml").write_text(RECOVER.replace("{attempts}", "3"))
    code, said = ran("check", path)
    assert code == 0, said


def test_a_misspelt_control_node_is_not_drawn_as_a_leaf(tmp_path: Path) -> None:
    path = tmp_path / "tour.xml"
    path.write_text(FOREIGN.replace("PipelineSequence", "PipelineSequenze"))
    (tmp_path / "recover.xml").write_text(RECOVER)
    code, said = ran("draw", path, "-o", tmp_path / "tour.svg")
    assert code == 2
    assert "did you mean PipelineSequence?" in said
