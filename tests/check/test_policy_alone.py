"""A policy is checked without its system as far as that goes, and the check says how far."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from m2c.check.command import check
from m2c.codegen.command import generate

NOTE = (
    "policy.xml:0:0: note: checked without its system: not whether its leaves are served, their types and "
    "their ports; give the system file to check them [policy-alone]"
)
TREE = '<root BTCPP_format="4"><BehaviorTree ID="Main">\n{}\n</BehaviorTree></root>'
SKILL = '<Action ID="ROS2Action" name="Go" service_name="/go/tick"/>'


def lines(folder: Path, text: str, *options: str) -> tuple[int, list[str]]:
    path = folder / "policy.xml"
    path.write_text(text)
    ended = CliRunner().invoke(check, [str(path), *options])
    return ended.exit_code, ended.output.replace(f"{folder}/", "").splitlines()


@pytest.mark.parametrize(
    "content",
    [
        SKILL,
        f'<Sequence>{SKILL}<IsFull limit="3"/></Sequence>',
        f'<Retry num_attempts="3">{SKILL}</Retry>',
        f'<TankGuard limit="3">{SKILL}</TankGuard>',
        '<Condition ID="IsFull" limit="3"/>',
        f'<Decorator ID="TankGuard">{SKILL}</Decorator>',
    ],
)
def test_a_policy_without_faults_passes_with_a_note_of_what_was_not_checked(
    tmp_path: Path, content: str
) -> None:
    content = content.replace("Retry ", "RetryUntilSuccessful ").replace(
        "/Retry>", "/RetryUntilSuccessful>"
    )
    code, said = lines(tmp_path, TREE.format(content), "--strict")
    assert said == [NOTE, "1 policy, 0 errors, 0 warnings"]
    assert code == 0


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (
            "<Sequenze><AlwaysSuccess/></Sequenze>",
            "2:1: error: <Sequenze>: unknown node; did you mean Sequence? [unknown-node]",
        ),
        (
            "<Sequence/>",
            "2:1: error: <Sequence>: 0 children; Sequence takes at least 1 [child-count]",
        ),
        (
            '<SubTree ID="Man"/>',
            "2:1: error: <SubTree>: the sub-tree `Man` does not exist; did you mean Main? [missing-subtree]",
        ),
        (
            SKILL + SKILL,
            "1:24: error: <BehaviorTree>: a tree has one root node, this one has 2 [child-count]",
        ),
        (
            SKILL.replace("go/tick", "go/*"),
            "2:1: error: <Action>: the channel `/go/*` has `*`, which no transport takes in a name; write it like /go [bad-name]",
        ),
        (
            "<Sequence>",
            "3:3: error: malformed XML: mismatched tag </BehaviorTree>; <Sequence> of 2:1 is open; write </Sequence> before it [malformed-xml]",
        ),
    ],
)
def test_what_is_wrong_with_a_policy_whatever_its_system_is_found(
    tmp_path: Path, content: str, expected: str
) -> None:
    code, said = lines(tmp_path, TREE.format(content))
    assert f"policy.xml:{expected}" in said
    assert code == 2


def test_what_the_engine_of_trees_refuses_is_said(tmp_path: Path) -> None:
    code, said = lines(tmp_path, TREE.format(f'<Sequence><Script code="a:="/>{SKILL}</Sequence>'))
    assert code == 2
    (found,) = [line for line in said if line.endswith("[refused-policy]")]
    assert found.startswith(
        "policy.xml:2:11: error: <Script>: BehaviorTree.CPP refuses the policy: "
    )


def test_a_command_that_needs_the_system_says_so(tmp_path: Path) -> None:
    path = tmp_path / "policy.xml"
    path.write_text(TREE.format(SKILL))
    ended = CliRunner().invoke(generate, [str(path), "-o", str(tmp_path / "out")])
    assert ended.exit_code == 2
    assert (
        "a policy alone, without the system that it belongs to; give the system file"
        in ended.output
    )
