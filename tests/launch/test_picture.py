"""The tree that `m2c run` draws: a policy's names stand in it as text."""

from __future__ import annotations

import pytest
from rich.console import Console

from m2c.launch.picture import TreePicture
from m2c.launch.screen import screen_for
from m2c.policy.program import Leaf, Policy
from m2c.policy.runner import LeafTick, TreeTick
from tests.commands.on_terminal import HOSTILE, SHOWN, require_harmless

MARKUP = "[bold red]x[/] :skull: [link=file:///]"
XML = (
    '<root><BehaviorTree ID="Main&#x202e;&#x9b;31m"><Sequence name="order&#x202e;&#x9b;31m">'
    '<L0/><SubTree ID="Sub&#x9b;31m"/></Sequence></BehaviorTree>'
    '<BehaviorTree ID="Sub&#x9b;31m"><L1/></BehaviorTree></root>'
)


def policy() -> Policy:
    leaves = (Leaf(id="L0", name=HOSTILE, action=True), Leaf(id="L1", name=MARKUP, action=False))
    return Policy("p", "Main\u202e\x9b31m", XML, leaves)


def tick_of(status: str) -> TreeTick:
    return TreeTick(1, status, tuple(LeafTick(name, status) for name in (HOSTILE, MARKUP)))


def test_the_names_of_a_policy_are_drawn_as_they_are_written() -> None:
    console = Console(width=250, force_terminal=True)
    picture = TreePicture(policy())
    with console.capture() as drawn:
        for status in ("RUNNING", HOSTILE):
            picture.show(tick_of(status))
            console.print(picture.render())
    require_harmless(drawn.get())
    words = drawn.get()
    assert all(
        word in words
        for word in (SHOWN, MARKUP, r"Main\u202e\x9b31m", r"order\u202e\x9b31m", r"Sub\x9b31m")
    )


@pytest.mark.parametrize("width", [60, 80, 100])
def test_a_leaf_and_its_status_stand_whole_on_a_narrow_terminal(width: int) -> None:
    xml = (
        '<root><BehaviorTree ID="Main"><Sequence name="s"><Fallback name="f"><Inverter><L0/></Inverter>'
        "</Fallback></Sequence></BehaviorTree></root>"
    )
    name = "VisitorsFollowingRobot"
    picture = TreePicture(Policy("p", "Main", xml, (Leaf(id="L0", name=name, action=True),)))
    picture.show(TreeTick(1, "RUNNING", (LeafTick(name, "SUCCESS", 123_456_789),)))
    picture.show(TreeTick(2, "RUNNING", ()))
    console = Console(width=width)
    with console.capture() as drawn:
        console.print(picture.render())
    assert f"{name}  SUCCESS" in drawn.get()
    assert "in tick 1" in " ".join(drawn.get().split())
    assert all(len(line.rstrip()) <= width for line in drawn.get().splitlines())


def test_lines_above_the_tree_are_shown_as_they_are_written() -> None:
    console = Console(width=250, force_terminal=True)
    with console.capture() as drawn, screen_for(policy(), False, console) as screen:
        screen.line(f"{MARKUP} {HOSTILE}")
    require_harmless(drawn.get())
    assert MARKUP in drawn.get()
    assert SHOWN in drawn.get()
