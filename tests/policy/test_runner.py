"""Ticking a tree whose leaves are answered by a transport of this file's own."""

from __future__ import annotations

import gc
import subprocess
import sys
import threading
import weakref
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import msgspec
import pytest

from m2c.language.datatypes import Primitive, Structure
from m2c.policy.library import PolicyError
from m2c.policy.program import Leaf, Policy
from m2c.policy.runner import PolicyRunner
from transports.interface import CallOutcome, CallResult, TransportError

REQUEST = Structure("t/srv/TickAction_Request", ())
RESPONSE = Structure("t/srv/TickAction_Response", (("status", Primitive("int8")),))


class Completion:
    def __init__(self) -> None:
        self.event = threading.Event()
        self.value: Any = None

    def set(self, value: Any) -> None:
        self.value = value
        self.event.set()

    def wait(self, timeout_s: float) -> Any:
        return self.value  # posted work has already run


class FakeTransport:
    """Answers calls from a table: channel → status, outcome or exception."""

    node = "policy"

    def __init__(self, answers: dict[str, Any]) -> None:
        self.answers = answers
        self.calls: list[str] = []
        self.published: list[Any] = []
        self.timeouts: set[float] = set()
        self.clock_ns = 0
        self.call_takes_ns = 0
        self.rounds = 0

    def now_ns(self) -> int:
        return self.clock_ns

    def completion(self) -> Completion:
        return Completion()

    def post(self, handler: Any) -> None:
        handler()

    def tick_complete(self) -> None:
        self.rounds += 1

    def publisher(self, topic: Any) -> Any:
        return SimpleNamespace(publish=self.published.append)

    def client(self, service: Any) -> Any:
        def call_and_wait(request: Any, timeout_s: float = 5.0) -> CallResult:
            self.calls.append(service.name)
            self.timeouts.add(timeout_s)
            self.clock_ns += self.call_takes_ns
            answer = self.answers[service.name]
            if isinstance(answer, Exception):
                raise answer
            if isinstance(answer, CallOutcome):
                return CallResult(answer, error="no answer")
            return CallResult(CallOutcome.RESPONSE, service.response(status=answer))

        return SimpleNamespace(call_and_wait=call_and_wait)


def leaf(name: str, action: bool = True, halt: bool = False, plugin: str = "") -> Leaf:
    types = {"tick_type": "t/srv/Tick", "tick_request": REQUEST, "tick_response": RESPONSE}
    halts = {
        "halt": f"/{name}/halt",
        "halt_type": "t/srv/Halt",
        "halt_request": REQUEST,
        "halt_response": RESPONSE,
    }
    return Leaf(
        id=name,
        name=name,
        action=action,
        tick=f"/{name}/tick",
        plugin=plugin,
        **types,
        **(halts if halt else {}),
    )


def runner(
    body: str, answers: dict[str, Any], *leaves: Leaf, plugins: Any = None
) -> tuple[PolicyRunner, FakeTransport]:
    xml = (
        '<root BTCPP_format="4" main_tree_to_execute="M"><BehaviorTree ID="M">'
        f"{body}</BehaviorTree></root>"
    )
    transport = FakeTransport(answers)
    return PolicyRunner(transport, Policy("p", "M", xml, leaves), plugins, 0.5), transport


@pytest.mark.parametrize(("number", "status"), [(0, "SUCCESS"), (1, "FAILURE"), (2, "RUNNING")])
def test_a_skills_number_is_its_leafs_status(number: int, status: str) -> None:
    tree, transport = runner("<A/>", {"/A/tick": number}, leaf("A"))
    assert tree.tick().status == status
    assert transport.published[0].leaves[0].status == status


def test_a_leafs_duration_is_taken_from_the_transports_clock() -> None:
    tree, transport = runner("<A/>", {"/A/tick": 0}, leaf("A"))
    transport.call_takes_ns = 1_250_000
    assert tree.tick().leaves[0].duration_us == 1250.0


def test_a_condition_that_answers_running_fails_and_is_named(
    caplog: pytest.LogCaptureFixture,
) -> None:
    tree, _ = runner("<C/>", {"/C/tick": 2}, leaf("C", action=False))
    assert tree.tick().status == "FAILURE"
    assert "condition C answers RUNNING" in caplog.text


@pytest.mark.parametrize("outcome", [CallOutcome.TIMEOUT, CallOutcome.UNAVAILABLE])
def test_a_skill_that_does_not_answer_fails_after_one_bounded_call(
    outcome: CallOutcome, caplog: pytest.LogCaptureFixture
) -> None:
    tree, transport = runner("<A/>", {"/A/tick": outcome}, leaf("A"))
    assert tree.tick().status == "FAILURE"
    assert transport.calls == ["/A/tick"]
    assert transport.timeouts == {0.5}
    assert "leaf A: /A/tick" in caplog.text


def test_a_transport_error_in_a_leaf_is_a_failure() -> None:
    tree, _ = runner("<A/>", {"/A/tick": TransportError("closed")}, leaf("A"))
    assert tree.tick().status == "FAILURE"


def test_an_exception_in_a_leaf_comes_out_of_tick_and_not_through_the_tree() -> None:
    tree, transport = runner("<A/>", {"/A/tick": ValueError("a fault")}, leaf("A"))
    with pytest.raises(ValueError, match="a fault"):
        tree.tick()
    assert transport.published[0].status == "FAILURE"


def test_a_running_action_that_loses_its_turn_is_halted_by_its_halt_service() -> None:
    leaves = (leaf("C", action=False), leaf("A", halt=True))
    body = "<ReactiveSequence><C/><A/></ReactiveSequence>"
    tree, transport = runner(body, {"/C/tick": 0, "/A/tick": 2, "/A/halt": 0}, *leaves)
    tree.tick()
    transport.answers["/C/tick"] = 1
    tree.tick()
    assert transport.calls == ["/C/tick", "/A/tick", "/C/tick", "/A/halt"]


def test_the_tree_is_halted_after_its_last_tick() -> None:
    tree, transport = runner("<A/>", {"/A/tick": 2, "/A/halt": 0}, leaf("A", halt=True))
    assert tree.run(1.0, 1) == 1
    assert transport.calls == ["/A/tick", "/A/halt"]


@pytest.mark.parametrize(("answer", "ticks"), [(0, 1), (1, 1), (2, 5)])
def test_a_policy_that_is_not_to_tick_again_ends_with_its_tree(answer: int, ticks: int) -> None:
    xml = '<root BTCPP_format="4"><BehaviorTree ID="M"><A/></BehaviorTree></root>'
    policy = Policy("p", "M", xml, (leaf("A"),), tick_if_not_running=False)
    tree = PolicyRunner(FakeTransport({"/A/tick": answer}), policy)
    assert tree.run(1e6, 5) == ticks
    assert tree.is_over is (answer != 2)


def test_it_says_that_a_round_is_over_before_each_pause_and_not_without_one() -> None:
    tree, transport = runner("<A/>", {"/A/tick": 0}, leaf("A"))
    tree.run(1e6, 3)
    assert transport.rounds == 2
    transport.call_takes_ns = 10_000
    tree.run(1e6, 6)
    assert transport.rounds == 2


def test_a_tree_that_cannot_go_on_is_halted() -> None:
    body = '<Parallel success_count="2"><A/><Script code="m:=nothing*2"/></Parallel>'
    tree, transport = runner(body, {"/A/tick": 2, "/A/halt": 0}, leaf("A", halt=True))
    with pytest.raises(PolicyError, match=r"the tree cannot be ticked: .*nothing"):
        tree.run(1.0)
    assert transport.calls == ["/A/tick", "/A/halt"]


def test_a_sequence_with_memory_of_leaves_that_succeed_at_once_succeeds_in_one_tick() -> None:
    body = "<SequenceWithMemory><A/><B/></SequenceWithMemory>"
    tree, _ = runner(body, {"/A/tick": 0, "/B/tick": 0}, leaf("A"), leaf("B"))
    assert tree.tick().status == "SUCCESS"


class Plugin:
    """Answers its ticks with ``script``, one entry a tick; None is no answer."""

    script: ClassVar[list[str | None]] = []
    made = 0

    def __init__(self, _t: Any, tree: Any, _s: Any, _p: Any) -> None:
        type(self).made += 1
        self.tree = tree

    def start(self) -> None: ...

    def tick(self) -> None:
        status = type(self).script.pop(0)
        if status is not None:
            self.tree.return_status(status)

    def halt(self) -> None:
        self.tree.return_halted()


def test_every_tick_of_a_plugin_gets_its_own_answer() -> None:
    Plugin.script = ["RUNNING", "FAILURE", "SUCCESS"]
    tree, _ = runner("<A/>", {}, leaf("A", plugin="P"), plugins={"P": Plugin})
    assert [tree.tick().status for _ in range(3)] == ["RUNNING", "FAILURE", "SUCCESS"]


def test_a_plugin_that_does_not_answer_fails_and_is_replaced() -> None:
    Plugin.script, Plugin.made = [None, "SUCCESS"], 0
    tree, _ = runner("<A/>", {}, leaf("A", plugin="P"), plugins={"P": Plugin})
    assert [tree.tick().status for _ in range(2)] == ["FAILURE", "SUCCESS"]
    assert Plugin.made == 2


@pytest.mark.parametrize("plugin", ["", "P"])
def test_a_runner_that_nobody_holds_is_freed_with_its_tree_and_its_transport(plugin: str) -> None:
    """Its tree's callbacks go through C++, where Python sees no cycle."""
    Plugin.script = ["SUCCESS"]
    tree, transport = runner(
        "<A/>", {"/A/tick": 0}, leaf("A", plugin=plugin), plugins={"P": Plugin}
    )
    tree.tick()
    known = weakref.ref(tree), weakref.ref(transport)
    del tree, transport
    gc.collect()
    assert [one() for one in known] == [None, None]


@pytest.mark.zenoh
def test_a_policy_with_a_channel_that_its_middleware_refuses_ends_with_one_line(
    tmp_path: Path,
) -> None:
    leaf = Leaf(
        id="Go",
        name="Go",
        action=True,
        tick="/tank/**",
        tick_type="t/srv/TickAction",
        tick_request=REQUEST,
        tick_response=RESPONSE,
    )
    xml = '<root BTCPP_format="4"><BehaviorTree ID="Main"><Go/></BehaviorTree></root>'
    policy = Policy("policy", "Main", xml, (leaf,))
    (tmp_path / "policy.json").write_bytes(msgspec.json.encode(policy))
    code = (
        "from pathlib import Path; from m2c.policy.main import main;"
        f"main(Path({str(tmp_path)!r}), {{}}, ['--ticks', '1'])"
    )
    ended = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False
    )
    assert ended.returncode == 2
    assert "error: channel '/tank/**' cannot be named on Zenoh" in ended.stderr
    assert "Traceback" not in ended.stderr
