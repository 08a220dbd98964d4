"""Random trees of Nav2's control nodes, against the rules written out: an object for each node, with a status.

The rules of the nodes are those of Nav2's pages (https://docs.nav2.org, behaviour-tree plugins), those of when a
node is reset are BehaviorTree.CPP's: who resets a child halts it if it runs, and a node that was reset begins anew. Only a
RateController or a SingleTrigger directly below another one is reset when it has ended, as below other decorators.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from tests.policy.test_controls import LEAVES, play

S, F, R, IDLE = "SUCCESS", "FAILURE", "RUNNING", "IDLE"
NAMES = {"S": S, "F": F, "R": R}


class World:
    """What leaves answer now, what was done, and what time it is (s)."""

    def __init__(self) -> None:
        self.now: dict[str, str] = {}
        self.did: list[str] = []
        self.time_s = 0.0


class Node:
    """A node of the tree, which is what its rule makes of its children."""

    def __init__(self, tag: str, children: Sequence[Node], world: World) -> None:
        self.tag = tag.split(maxsplit=1)[0]
        self.value = tag.partition('="')[2].rstrip('"')
        self.children = children
        self.world = world
        self.status = IDLE
        self.since_s = 0.0
        self.forget()

    def forget(self) -> None:
        self.current = self.count = 0

    def tick(self) -> str:
        if self.tag in LEAVES:
            self.world.did.append(self.tag)
            self.status = self.world.now.get(self.tag, S)
            return self.status
        begins = self.status == IDLE
        self.status = R
        self.status = RULES[self.tag](self, begins)
        return self.status

    def halt(self) -> None:
        """The rule of those that run; a leaf's skill is told."""
        if self.tag in LEAVES:
            self.world.did.append(f"{self.tag} halted")
        self.reset_children()
        self.forget()

    def reset(self) -> None:
        if self.status == R:
            self.halt()
        self.status = IDLE

    def reset_children(self) -> None:
        for child in self.children:
            child.reset()

    def ends(self, status: str) -> str:
        """All children are reset, and it begins with the first one."""
        self.reset_children()
        self.forget()
        return status


def pipeline(node: Node, begins: bool) -> str:
    for place, child in enumerate(node.children):
        status = child.tick()
        if status == F:
            return node.ends(F)
        if status == R and place >= node.current:
            node.current = place
            return R
    return node.ends(S)


def nonblocking(node: Node, begins: bool) -> str:
    runs = False
    for child in node.children:
        status = child.tick()
        if status == F:
            return node.ends(F)
        runs = runs or status == R
    return R if runs else node.ends(S)


def round_robin(node: Node, begins: bool) -> str:
    while node.count < len(node.children):
        status = node.children[node.current].tick()
        if status == R:
            return R
        was_last = node.current == len(node.children) - 1
        node.current = 0 if was_last else node.current + 1
        if status == S:
            node.count = 0
            node.reset_children()
            return S
        node.count += 1
        if was_last and node.value != "true":
            break
    return node.ends(F)


def recovery(node: Node, begins: bool) -> str:
    work, recover = node.children
    while True:
        if node.current == 0:
            status = work.tick()
            if status == R:
                return R
            if status == S or node.count == int(node.value or 1):
                return node.ends(status)
            work.reset()
            node.current = 1
        status = recover.tick()
        if status == R:
            return R
        if status == F:
            return node.ends(F)
        recover.reset()
        node.count += 1
        node.current = 0


def rate(node: Node, begins: bool) -> str:
    (child,) = node.children
    now_s = node.world.time_s
    if begins:
        node.since_s = now_s
    # half a microsecond: times that were added up differ in their last digit
    is_over = now_s - node.since_s > 1 / float(node.value) - 5e-7
    if not (begins or child.status == R or is_over):
        return R
    status = child.tick()
    if status == S:
        node.since_s = now_s
    if status != R:
        node.reset_children()
    return status


def once(node: Node, begins: bool) -> str:
    if begins:
        node.count = 0
    if node.count:
        return F
    status = node.children[0].tick()
    node.count = status != R
    if status != R:
        node.reset_children()
    return status


def inverter(node: Node, begins: bool) -> str:
    status = node.children[0].tick()
    if status != R:
        node.reset_children()
    return {S: F, F: S, R: R}[status]


def sequence(node: Node, begins: bool) -> str:
    while node.current < len(node.children):
        status = node.children[node.current].tick()
        if status == R:
            return R
        if status == F:
            return node.ends(F)
        node.current += 1
    return node.ends(S)


def fallback(node: Node, begins: bool) -> str:
    while node.current < len(node.children):
        status = node.children[node.current].tick()
        if status == R:
            return R
        if status == S:
            return node.ends(S)
        node.current += 1
    return node.ends(F)


RULES: dict[str, Callable[[Node, bool], str]] = {
    "PipelineSequence": pipeline,
    "NonblockingSequence": nonblocking,
    "RoundRobin": round_robin,
    "RecoveryNode": recovery,
    "RateController": rate,
    "SingleTrigger": once,
    "Inverter": inverter,
    "Sequence": sequence,
    "Fallback": fallback,
}
CONTROLS = (
    "PipelineSequence",
    "NonblockingSequence",
    "RoundRobin",
    'RoundRobin wrap_around="true"',
    'RecoveryNode number_of_retries="2"',
    "RecoveryNode",
    "Sequence",
    "Fallback",
)
DECORATORS = ('RateController hz="2"', "SingleTrigger", "Inverter")


def drawn(draw: random.Random, world: World, depth: int = 0) -> tuple[str, Node]:
    """A tree, as text and as objects."""
    kind = draw.random()
    if depth == 3 or (depth and kind < 0.25):
        leaf = draw.choice(LEAVES)
        return f"<{leaf}/>", Node(leaf, (), world)
    tag = draw.choice(CONTROLS if kind < 0.75 else DECORATORS)
    count = 1 if tag in DECORATORS else 2 if tag.startswith("Rec") else draw.choice((1, 2, 3))
    made = [drawn(draw, world, depth + 1) for _ in range(count)]
    inner = "".join(text for text, _ in made)
    return f"<{tag}>{inner}</{tag.split()[0]}>", Node(tag, [node for _, node in made], world)


@pytest.mark.parametrize("seed", range(40))
def test_random_trees_do_as_the_rules_say(tmp_path: Path, seed: int) -> None:
    draw = random.Random(seed)
    world = World()
    text, root = drawn(draw, world)
    ticks, expected = [], []
    for _ in range(20):
        later_s = draw.choice((0, 0.2, 0.5))
        answers = {leaf: draw.choice("SFRR") for leaf in LEAVES}
        ticks.append(
            " ".join([f"+{later_s}", *(f"{name}:{said}" for name, said in answers.items())])
        )
        world.time_s += later_s
        world.now = {name: NAMES[said] for name, said in answers.items()}
        world.did = []
        status = root.tick()
        if status != R:
            root.reset()
        expected.append(f"{', '.join(world.did)} → {status}")
    found = play(tmp_path, text, ticks)
    assert found == expected, text
