"""Control nodes that m2c itself runs: those of Nav2, with the meaning that Nav2 documents, and ``TryCatch``."""

from __future__ import annotations

import random
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from m2c.policy.program import Policy
from m2c.policy.runner import PolicyRunner
from m2c.policy.ticks import LeafTick
from moon.policy.run import BEGIN, ELAPSED, WAITING, AskKind, TreeRun, Trees
from tests.docs.trees import Skills, read, with_skills
from transports.interface import CallOutcome, CallResult

LEAVES = ("A", "B", "C")
CODES = {"S": 0, "F": 1, "R": 2}


class Scripted(Skills):
    """Skills that answer what is scripted for a tick; a clock that is moved by hand."""

    def __init__(self) -> None:
        super().__init__({})
        self.now: dict[str, str] = {}
        self.did: list[str] = []
        self.timers: list[tuple[float, Any]] = []
        self.time_s = 0.0

    def client(self, service: Any) -> Any:
        name, what = service.name[1:].split("/")

        def call(_request: Any, _timeout_s: float) -> CallResult:
            self.did.append(name if what == "tick" else f"{name} halted")
            if what == "halt":
                return CallResult(CallOutcome.RESPONSE, service.response(is_ok=True))
            status = CODES[self.now.get(name, "S")]
            return CallResult(CallOutcome.RESPONSE, service.response(status=status))

        return SimpleNamespace(call_and_wait=call)

    def after(self, delay_s: float, handler: Any) -> Any:
        timer = (self.time_s + delay_s, handler)
        self.timers.append(timer)
        return SimpleNamespace(cancel=lambda: timer in self.timers and self.timers.remove(timer))

    def pass_time(self, seconds: float) -> None:
        self.time_s += seconds
        for timer in [timer for timer in self.timers if timer[0] <= self.time_s]:
            self.timers.remove(timer)
            timer[1]()


def policy_of(folder: Path, tree: str) -> Policy:
    for name in LEAVES:
        tree = tree.replace(f"<{name}/>", f'<Action ID="{name}" service_name="/{name}/tick"/>')
        tree = tree.replace(f"<{name} ", f'<Action ID="{name}" service_name="/{name}/tick" ')
    policy, log = with_skills(folder, f'<BehaviorTree ID="Main">{tree}</BehaviorTree>', LEAVES)
    assert policy is not None, log.diagnostics
    return policy


class Judge:
    """Follows each tick as the monitor does, by what was called and what was reported."""

    def __init__(self, policy: Policy) -> None:
        self._run = TreeRun(Trees(policy, frozenset(), records=True))
        self._timed = {leaf.name for leaf in policy.leaves if leaf.timed}

    def follow(
        self, did: Sequence[str], statuses: dict[str, str], leaves: Sequence[LeafTick]
    ) -> str:
        """The status of the tick in which the policy did that."""
        words = {"S": "SUCCESS", "F": "FAILURE", "R": "RUNNING"}
        reported = [leaf for leaf in leaves if leaf.name in self._timed and leaf.status != "HALTED"]
        calls = list(did)
        ask = self._run.step(BEGIN)
        while ask.kind is not AskKind.END:
            assert ask.leaf is not None
            if ask.kind is AskKind.OPEN:
                said = reported.pop(0)
                assert said.name == ask.leaf.name
                ask = self._run.step(ELAPSED if said.elapsed else WAITING)
                continue
            wanted = f"{ask.leaf.name} halted" if ask.kind is AskKind.HALT else ask.leaf.name
            assert calls[:1] == [wanted]
            calls.pop(0)
            ask = self._run.step(words[statuses.get(ask.leaf.name, "S")])
        assert not calls
        assert not reported
        return ask.status

    def close(self) -> None:
        self._run.close()


def play(folder: Path, tree: str, ticks: Sequence[str]) -> list[str]:
    """What each tick calls and gives, judged as well.

    A tick is ``A:F B:R``, the answers of skills in it (else SUCCESS), after ``+0.5`` seconds.
    """
    policy = policy_of(folder, tree)
    transport = Scripted()
    runner = PolicyRunner(transport, policy)
    judge = Judge(policy)
    found = []
    for tick in ticks:
        words = tick.split()
        transport.pass_time(sum(float(word) for word in words if word.startswith("+")))
        transport.now = dict(word.split(":") for word in words if ":" in word)
        transport.did = []
        record = runner.tick()
        found.append(f"{', '.join(transport.did)} → {record.status}")
        assert judge.follow(transport.did, transport.now, record.leaves) == record.status
    judge.close()
    return found


CASES = {
    "a pipeline ticks what is before the child that runs, too": (
        "<PipelineSequence><A/><B/><C/></PipelineSequence>",
        ["A:R", "B:R", "A:R C:R", "B:F", "A:R"],
        [
            "A → RUNNING",
            "A, B → RUNNING",
            "A, B, C → RUNNING",
            "A, B, C halted → FAILURE",
            "A → RUNNING",
        ],
    ),
    "a pipeline that succeeds halts what runs before": (
        "<PipelineSequence><A/><B/></PipelineSequence>",
        ["B:R", "A:R", "A:R"],
        ["A, B → RUNNING", "A, B, A halted → SUCCESS", "A → RUNNING"],
    ),
    "a pipeline of skipped children is skipped": (
        '<Sequence><PipelineSequence><A _skipIf="true"/></PipelineSequence><B/></Sequence>',
        [""],
        ["B → SUCCESS"],
    ),
    "a recovery is tried before each retry": (
        '<RecoveryNode number_of_retries="2"><A/><B/></RecoveryNode>',
        ["A:F", "A:F B:R", "A:F B:F", "A:R", ""],
        [
            "A, B, A, B, A → FAILURE",
            "A, B → RUNNING",
            "B → FAILURE",
            "A → RUNNING",
            "A → SUCCESS",
        ],
    ),
    "one retry is the default": (
        "<RecoveryNode><A/><B/></RecoveryNode>",
        ["A:F", "A:F B:R", "A:R", ""],
        ["A, B, A → FAILURE", "A, B → RUNNING", "B, A → RUNNING", "A → SUCCESS"],
    ),
    "without retries nothing is recovered": (
        '<RecoveryNode number_of_retries="0"><A/><B/></RecoveryNode>',
        ["A:F"],
        ["A → FAILURE"],
    ),
    "a recovery that is skipped is none": (
        '<RecoveryNode><A/><B _skipIf="true"/></RecoveryNode>',
        ["A:F", ""],
        ["A → FAILURE", "A → SUCCESS"],
    ),
    "a main child that is skipped skips the node": (
        '<Sequence><RecoveryNode><A _skipIf="true"/><B/></RecoveryNode><C/></Sequence>',
        [""],
        ["C → SUCCESS"],
    ),
    "a round goes on after the child that succeeded": (
        '<RoundRobin wrap_around="true"><A/><B/><C/></RoundRobin>',
        ["", "", "", "A:F", "C:R", "C:F A:F B:F"],
        [
            "A → SUCCESS",
            "B → SUCCESS",
            "C → SUCCESS",
            "A, B → SUCCESS",
            "C → RUNNING",
            "C, A, B → FAILURE",
        ],
    ),
    "by default a round ends with the last child": (
        "<RoundRobin><A/><B/></RoundRobin>",
        ["A:F", "A:F B:F", "", "B:F", "A:R"],
        ["A, B → SUCCESS", "A, B → FAILURE", "A → SUCCESS", "B → FAILURE", "A → RUNNING"],
    ),
    "a round of skipped children is skipped": (
        '<Sequence><RoundRobin><A _skipIf="true"/><B _skipIf="true"/></RoundRobin><C/></Sequence>',
        [""],
        ["C → SUCCESS"],
    ),
    "a recovery takes turns": (
        "<RecoveryNode><A/><RoundRobin><B/><C/></RoundRobin></RecoveryNode>",
        ["A:F", "A:F", "A:F"],
        ["A, B, A → FAILURE", "A, C, A → FAILURE", "A, B, A → FAILURE"],
    ),
    "the rate limits how often the child is ticked": (
        '<PipelineSequence><RateController hz="2"><A/></RateController><B/></PipelineSequence>',
        ["B:R", "B:R", "+0.4 B:R", "+0.2 A:R B:R", "A:R B:R", "B:R", "B:R", "+0.5 B:S", "B:R"],
        [
            "A, B → RUNNING",
            "B → RUNNING",
            "B → RUNNING",
            "A, B → RUNNING",
            "A, B → RUNNING",
            "A, B → RUNNING",
            "B → RUNNING",
            "A, B → SUCCESS",
            "A, B → RUNNING",
        ],
    ),
    "elsewhere it starts anew once its child has ended": (
        '<RateController hz="2"><A/></RateController>',
        ["", "", "A:R", ""],
        ["A → SUCCESS", "A → SUCCESS", "A → RUNNING", "A → SUCCESS"],
    ),
    "what a decorator is around starts anew, too": (
        '<PipelineSequence><ForceSuccess><RateController hz="2"><A/></RateController></ForceSuccess>'
        "<B/></PipelineSequence>",
        ["B:R", "B:R"],
        ["A, B → RUNNING", "A, B → RUNNING"],
    ),
    "a trigger works once": (
        "<PipelineSequence><ForceSuccess><A/></ForceSuccess><B/></PipelineSequence>",
        ["B:R"],
        ["A, B → RUNNING"],
    ),
    "a single trigger fails until the sequence around it ends": (
        "<NonblockingSequence><B/><SingleTrigger><A/></SingleTrigger></NonblockingSequence>",
        ["B:R A:R", "B:R", "B:R", "A:R"],
        ["B, A → RUNNING", "B, A → RUNNING", "B, B halted → FAILURE", "B, A → RUNNING"],
    ),
    "all are ticked again until all succeed at once": (
        "<NonblockingSequence><A/><B/><C/></NonblockingSequence>",
        ["A:R C:R", "B:R", "", "A:R B:F"],
        [
            "A, B, C → RUNNING",
            "A, B, C → RUNNING",
            "A, B, C → SUCCESS",
            "A, B, A halted → FAILURE",
        ],
    ),
    "a persistent sequence goes on after a halt": (
        '<Sequence><Script code="i := 0" _skipIf="0"/><Repeat num_cycles="1"><Timeout msec="500">'
        '<PersistentSequence current_child_idx="{i}"><A/><B/><C/></PersistentSequence>'
        "</Timeout></Repeat></Sequence>",
        ["B:R", "+1 B:R"],
        ["A, B → RUNNING", "B halted → FAILURE"],
    ),
    "a try that fails is cleaned up": (
        "<TryCatch><A/><B/><C/></TryCatch>",
        ["B:R", "B:F C:R", "", "", "A:F"],
        [
            "A, B → RUNNING",
            "B, C → RUNNING",
            "C → FAILURE",
            "A, B → SUCCESS",
            "A, C → FAILURE",
        ],
    ),
    "a try that is halted is cleaned up if that is wanted": (
        '<Timeout msec="500"><TryCatch catch_on_halt="true"><A/><C/></TryCatch></Timeout>',
        ["A:R", "+1 C:R", "A:R"],
        ["A → RUNNING", "A halted, C, C halted → FAILURE", "A → RUNNING"],
    ),
    "else it is not": (
        '<Timeout msec="500"><TryCatch><A/><C/></TryCatch></Timeout>',
        ["A:R", "+1"],
        ["A → RUNNING", "A halted → FAILURE"],
    ),
    "a try of skipped children is skipped": (
        '<Sequence><TryCatch><A _skipIf="true"/><C/></TryCatch><B/></Sequence>',
        [""],
        ["B → SUCCESS"],
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_a_node_does_what_it_should_and_the_monitor_agrees(tmp_path: Path, case: str) -> None:
    tree, ticks, expected = CASES[case]
    assert play(tmp_path, tree, ticks) == expected


def test_a_persistent_sequence_begins_where_the_blackboard_says(tmp_path: Path) -> None:
    tree = (
        '<Sequence><Script code="i := 1"/>'
        '<PersistentSequence current_child_idx="{i}"><A/><B/></PersistentSequence>'
        '<ScriptCondition code="i == 0"/></Sequence>'
    )
    assert play(tmp_path, tree, ["", "B:F"]) == ["B → SUCCESS", "B → FAILURE"]


def test_retries_without_end_do_not_stop_the_tree(tmp_path: Path) -> None:
    tree = '<RecoveryNode number_of_retries="2000000000"><AlwaysFailure/><AlwaysSuccess/></RecoveryNode>'
    assert play(tmp_path, tree, ["", ""]) == [" → RUNNING", " → RUNNING"]


def test_retries_in_one_another_do_not_stop_the_tree(tmp_path: Path) -> None:
    tree = "<RecoveryNode>" * 40 + "<A/>" + "<AlwaysSuccess/></RecoveryNode>" * 40
    found = play(tmp_path, tree, ["A:F", "A:R", ""])
    assert [said.rpartition("→ ")[2] for said in found] == ["RUNNING", "RUNNING", "SUCCESS"]
    assert found[0].count("A") < 2_000


@pytest.mark.parametrize("tag", ["PipelineSequence", "NonblockingSequence", "TryCatch"])
def test_nodes_may_be_as_deep_as_a_file_is_read(tmp_path: Path, tag: str) -> None:
    other = "<AlwaysSuccess/>" if tag == "TryCatch" else ""
    tree = f"<{tag}>" * 56 + "<A/>" + f"{other}</{tag}>" * 56
    assert play(tmp_path, tree, ["A:R", "", "A:F"]) == ["A → RUNNING", "A → SUCCESS", "A → FAILURE"]


@pytest.mark.parametrize("value", [-1, 7])
def test_a_number_that_is_no_child_is_no_crash(tmp_path: Path, value: int) -> None:
    tree = (
        f'<Sequence><Script code="i := {value}"/>'
        '<PersistentSequence current_child_idx="{i}"><A/><B/></PersistentSequence></Sequence>'
    )
    (said,) = play(tmp_path, tree, [""])
    assert said == (" → FAILURE" if value < 0 else " → SUCCESS")


CONTROLS = (
    "PipelineSequence",
    "NonblockingSequence",
    'RoundRobin wrap_around="true"',
    "RoundRobin",
    "TryCatch",
    'TryCatch catch_on_halt="true"',
    'RecoveryNode number_of_retries="2"',
    "Sequence",
    "ReactiveFallback",
)
DECORATORS = ('RateController hz="2"', "SingleTrigger", 'Timeout msec="900"', "Inverter")


def drawn(draw: random.Random, depth: int = 0) -> str:
    kind = draw.random()
    if depth == 3 or kind < 0.2:
        return f"<{draw.choice(LEAVES)}/>"
    tag = draw.choice(CONTROLS if kind < 0.7 else DECORATORS)
    count = 1 if kind >= 0.7 else 2
    inner = "".join(drawn(draw, depth + 1) for _ in range(count))
    return f"<{tag}>{inner}</{tag.split()[0]}>"


@pytest.mark.parametrize("seed", range(40))
def test_the_monitor_follows_trees_of_such_nodes(tmp_path: Path, seed: int) -> None:
    draw = random.Random(seed)
    ticks = [
        " ".join(
            [f"+{draw.choice((0, 0.3))}", *(f"{leaf}:{draw.choice('SFR')}" for leaf in LEAVES)]
        )
        for _ in range(25)
    ]
    assert len(play(tmp_path, drawn(draw), ticks)) == 25


@pytest.mark.parametrize(
    ("node", "said"),
    [
        ('<RateController hz="0"><S/></RateController>', "a rate in Hz, more than 0"),
        ('<RateController hz="-1"><S/></RateController>', "a rate in Hz, more than 0"),
        ('<RateController hz="nan"><S/></RateController>', "a rate in Hz, more than 0"),
        ('<RateController hz="fast"><S/></RateController>', "a rate in Hz, more than 0"),
        ('<RecoveryNode number_of_retries="-1"><S/><F/></RecoveryNode>', "0 or more"),
        ('<RecoveryNode number_of_retries="1.5"><S/><F/></RecoveryNode>', "0 or more"),
        ('<RecoveryNode><S/></RecoveryNode>', "RecoveryNode takes 2"),
        ('<RoundRobin wrap_around="maybe"><S/></RoundRobin>', "true or false"),
        ('<PersistentSequence current_child_idx="0"><S/></PersistentSequence>', "blackboard entry"),
        ("<PersistentSequence><S/></PersistentSequence>", "`current_child_idx` is missing"),
        ('<RecoveryNode number_of_retries="{n}"><S/><F/></RecoveryNode>', "reads the entry `n`"),
        ("<TryCatch><S/></TryCatch>", "TryCatch takes at least 2"),
        ('<PipelineSequence hz="1"><S/></PipelineSequence>', "PipelineSequence has no port `hz`"),
    ],
)  # fmt: skip
def test_what_such_a_node_does_not_take_is_said(tmp_path: Path, node: str, said: str) -> None:
    policy, found = read(tmp_path, node)
    assert policy is None
    assert any(said in line for line in found), found
