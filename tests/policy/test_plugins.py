"""Plugins: leaves with ports on the blackboard, decorators and control nodes, generated and ticked."""

from __future__ import annotations

import importlib
import sys
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from m2c.codegen.package import system_files
from m2c.codegen.writer import write_files
from m2c.policy.runner import PolicyRunner
from m2c.simulation.program import compile_system
from m2c.simulation.run import SimulatedRun
from tests.codegen.quality import formatted, strictly_typed
from tests.policy.plugin_models import loaded
from transports.simulated import SimulatedWorld


class OneThread:
    """A transport without channels, on one thread: waiting runs what was posted."""

    node = "policy"

    def __init__(self) -> None:
        self.work: deque[Callable[[], None]] = deque()
        self.clock_ns = 0
        self.set_forward_ns = 0
        """By how much the time of day was set."""
        self.timers: list[tuple[int, Callable[[], None]]] = []

    def now_ns(self) -> int:
        return self.clock_ns + self.set_forward_ns

    def after(self, delay_s: float, handler: Callable[[], None]) -> Any:
        timer = (self.clock_ns + round(delay_s * 1e9), handler)
        self.timers.append(timer)
        return SimpleNamespace(cancel=lambda: timer in self.timers and self.timers.remove(timer))

    def pass_time(self, nanoseconds: int) -> None:
        while self.work:
            self.work.popleft()()
        self.clock_ns += nanoseconds
        for timer in [timer for timer in self.timers if timer[0] <= self.clock_ns]:
            self.timers.remove(timer)
            timer[1]()

    def post(self, handler: Callable[[], None]) -> None:
        self.work.append(handler)

    def publisher(self, topic: Any) -> Any:
        return SimpleNamespace(publish=lambda message: None)

    def completion(self) -> Any:
        values: list[Any] = []

        def wait(timeout_s: float) -> Any:
            while self.work and not values:
                self.work.popleft()()
            if not values:
                self.clock_ns += round(timeout_s * 1e9)
            return values[0] if values else None

        return SimpleNamespace(set=values.append, wait=wait)


@pytest.fixture
def run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[[str], tuple[PolicyRunner, OneThread]]]:
    """A runner of the policy with this body, its plugins generated and imported."""

    def make(body: str) -> tuple[PolicyRunner, OneThread]:
        system, policy, faults = loaded(tmp_path, body)
        assert policy is not None, faults
        write_files(system_files(system), tmp_path / "generated")
        (package,) = (tmp_path / "generated").glob("*_policy")
        monkeypatch.syspath_prepend(str(package))
        used = {leaf.plugin for leaf in policy.leaves if leaf.plugin}
        classes = {
            name: getattr(
                importlib.import_module(f"{package.name}.plugins.{snake}.node"), f"{name}Node"
            )
            for name, snake in (
                ("Invert", "invert"),
                ("InTurn", "in_turn"),
                ("Add", "add"),
                ("Once", "once"),
                ("Far", "far"),
                ("Deaf", "deaf"),
                ("Hasty", "hasty"),
                ("Twice", "twice"),
                ("Marked", "marked"),
            )
            if name in used
        }
        transport = OneThread()
        return PolicyRunner(transport, policy, classes, 0.5), transport

    yield make
    for name in [name for name in sys.modules if "_policy" in name.partition(".")[0]]:
        del sys.modules[name]


def test_a_decorator_plugin_ticks_its_child_and_changes_its_status(run: Any) -> None:
    runner, _ = run("<Invert><AlwaysFailure/></Invert>")
    assert runner.tick().status == "SUCCESS"
    assert [(leaf.name, leaf.status) for leaf in runner.tick().leaves] == [("Invert", "SUCCESS")]


@pytest.mark.parametrize(
    "element",
    [
        '<Decorator ID="Invert"><AlwaysSuccess/></Decorator>',
        '<Control ID="Invert"><AlwaysSuccess/></Control>',
    ],
)
def test_a_plugin_with_children_may_be_written_as_control_or_decorator(
    element: str, run: Any
) -> None:
    assert run(element)[0].tick().status == "FAILURE"


def test_plugins_nest_and_a_child_may_be_running(run: Any) -> None:
    runner, _ = run("<Invert><Invert><Once/></Invert></Invert>")
    assert [runner.tick().status for _ in range(4)] == ["RUNNING", "SUCCESS", "RUNNING", "SUCCESS"]


def test_a_control_plugin_names_its_children_by_a_variable(run: Any) -> None:
    runner, _ = run("<InTurn><AlwaysSuccess/><Invert><AlwaysFailure/></Invert><Once/></InTurn>")
    assert [runner.tick().status for _ in range(2)] == ["RUNNING", "SUCCESS"]
    runner, _ = run("<InTurn><AlwaysSuccess/><AlwaysFailure/><Once/></InTurn>")
    assert runner.tick().status == "FAILURE"


def test_a_halted_plugin_halts_its_running_child(run: Any, caplog: Any) -> None:
    caplog.set_level("INFO")
    runner, _ = run("<Invert><Once/></Invert>")
    assert runner.run(1.0, 1) == 1
    assert "halted: Once" in caplog.text


def test_a_halt_that_the_state_does_not_take_is_answered_at_once(run: Any) -> None:
    runner, transport = run("<Deaf/>")
    runner.run(1.0, 1)
    assert transport.clock_ns == 0  # waiting in vain would have moved the clock


def test_a_plugin_that_ends_leaves_no_child_running(run: Any, caplog: Any) -> None:
    caplog.set_level("INFO")
    runner, _ = run("<Hasty><Once/></Hasty>")
    tick = runner.tick()
    assert tick.status == "SUCCESS"
    assert "halted: Once" in caplog.text
    assert [(leaf.name, leaf.status) for leaf in tick.leaves][-1] == ("Once", "HALTED")


def test_only_the_first_answer_to_a_tick_counts(run: Any) -> None:
    runner, _ = run("<Twice/>")
    assert [runner.tick().status for _ in range(3)] == ["RUNNING"] * 3


def test_each_place_of_a_plugin_has_a_machine_of_its_own(run: Any) -> None:
    body = "<Parallel success_count='2' failure_count='1'><Once/><Sequence><Once/></Sequence></Parallel>"
    runner, _ = run(body)
    assert [runner.tick().status for _ in range(2)] == ["RUNNING", "SUCCESS"]


def test_ports_are_read_from_and_written_to_the_blackboard_of_the_sub_tree(run: Any) -> None:
    runner, _ = run(
        '<BehaviorTree ID="M"><Sequence><Script code="a:=40; text:=\'1\'"/>'
        '<Add to="{a}" step="2" sum="{b}"/><SubTree ID="S" in="{b}" out="{c}"/>'
        '<ScriptCondition code="b==42 &amp;&amp; c==52"/></Sequence></BehaviorTree>'
        '<BehaviorTree ID="S"><Invert><Invert><Add to="{in}" step="10" sum="{out}"/></Invert>'
        "</Invert></BehaviorTree>"
    )
    tick = runner.tick()
    assert tick.status == "SUCCESS"
    assert [leaf.name for leaf in tick.leaves] == ["Add", "Invert", "Invert_2", "Add_2"]


def test_a_plugin_gets_the_port_that_it_declares_although_a_mark_has_its_name(run: Any) -> None:
    for value, status in (("true", "SUCCESS"), ("false", "FAILURE")):
        for tag in (
            f'<Marked isMonitored="{value}"/>',
            f'<Action ID="Marked" isMonitored="{value}"/>',
        ):
            runner, _ = run(tag)
            assert runner.tick().status == status


def test_the_mark_of_a_plugin_that_has_no_such_port_is_ignored_and_said(tmp_path: Path) -> None:
    _, policy, (said,) = loaded(tmp_path, '<Once isMonitored="true"/>')
    assert policy is not None
    assert said == (
        "policy.xml:1:53: note: <Once>: isMonitored is ignored; moon monitors passively "
        "[monitored-leaf]"
    )


def chain(count: int) -> str:
    trees = "".join(
        f'<BehaviorTree ID="T{i}"><Invert><SubTree ID="T{i + 1}"/></Invert></BehaviorTree>'
        for i in range(count)
    )
    return (
        f'<BehaviorTree ID="M"><SubTree ID="T0"/></BehaviorTree>{trees}'
        f'<BehaviorTree ID="T{count}"><AlwaysFailure/></BehaviorTree>'
    )


def test_plugins_nested_as_deep_as_is_allowed_can_be_ticked(run: Any) -> None:
    runner, _ = run(chain(50))
    assert runner.tick().status == "FAILURE"
    assert runner.tick().status == "FAILURE"


def test_plugins_nested_deeper_are_an_error(tmp_path: Path) -> None:
    _, policy, faults = loaded(tmp_path, chain(52))
    assert policy is None
    assert "[deep-tree]" in faults[0]


def test_an_entry_that_is_not_on_the_blackboard_fails_the_leaf_and_is_named(
    run: Any, caplog: Any
) -> None:
    runner, _ = run('<Add to="{nowhere}" step="2" sum="{b}"/>')
    assert runner.tick().status == "FAILURE"
    assert (
        "leaf Add: its port `to` cannot be read from the blackboard entry `nowhere`" in caplog.text
    )


def test_a_child_that_is_not_there_fails_the_plugin_and_is_named(run: Any, caplog: Any) -> None:
    runner, _ = run("<Far><AlwaysSuccess/></Far>")
    assert runner.tick().status == "FAILURE"
    assert "its plugin Far names child 7; it has 1, numbered from 0" in caplog.text


def test_waiting_nodes_go_by_the_transports_clock(run: Any) -> None:
    runner, transport = run('<Delay delay_msec="100"><AlwaysSuccess/></Delay>')
    assert runner.tick().status == "RUNNING"
    transport.pass_time(99_999_999)
    assert runner.tick().status == "RUNNING"
    transport.pass_time(1)
    assert runner.tick().status == "SUCCESS"


@pytest.mark.parametrize("step_s", [-86_400, -3600, -1, 1, 3600, 86_400])
def test_a_clock_that_is_set_makes_nobody_wait_for_longer_or_less(run: Any, step_s: int) -> None:
    runner, transport = run('<Timeout msec="100"><Sleep msec="60"/></Timeout>')
    assert runner.tick().status == "RUNNING"
    transport.pass_time(59_999_999)
    transport.set_forward_ns += step_s * 10**9
    assert runner.tick().status == "RUNNING"
    transport.pass_time(1)
    assert runner.tick().status == "SUCCESS"
    assert runner.tick().status == "RUNNING"
    transport.pass_time(0)
    assert len(transport.timers) == 2  # those of the time before are gone


@pytest.mark.parametrize("step_s", [-86_400, -3600, -5, 5, 3600])
def test_a_tree_is_ticked_on_when_the_clock_is_set(run: Any, step_s: int) -> None:
    runner, transport = run("<AlwaysSuccess/>")
    steps = deque([0, step_s, 0, 0])

    def tick_complete() -> None:
        transport.set_forward_ns += steps.popleft() * 10**9

    transport.tick_complete = tick_complete
    assert runner.run(10.0, 5) == 5
    assert transport.clock_ns in (300_000_000, 400_000_000)  # at most one tick comes early


def test_a_timeout_halts_its_child_and_fails(run: Any, caplog: Any) -> None:
    caplog.set_level("INFO")
    runner, transport = run(
        '<Timeout msec="50"><Sequence><Once/><Sleep msec="1000"/></Sequence></Timeout>'
    )
    assert [runner.tick().status for _ in range(2)] == ["RUNNING", "RUNNING"]
    transport.pass_time(50_000_000)
    assert runner.tick().status == "FAILURE"
    assert runner.tick().status == "RUNNING"
    transport.pass_time(60_000_000)
    runner.tick()
    assert "halted: Once" in caplog.text


@pytest.mark.parametrize(
    "timed",
    ['Timeout msec="50"', 'Delay delay_msec="0"', 'Timeout msec="50"><Delay delay_msec="0"'],
)
def test_a_timed_node_whose_child_is_skipped_is_skipped(run: Any, capfd: Any, timed: str) -> None:
    """As BehaviorTree.CPP's own are: what is around it goes on as if it were not there."""
    ends = "".join(f"</{word.split()[0]}>" for word in reversed(timed.split("><")))
    around = f'<{timed}><AlwaysFailure _skipIf="1 == 1"/>{ends}'
    runner, _ = run(f"<Sequence>{around}<AlwaysSuccess/></Sequence>")
    assert [runner.tick().status for _ in range(2)] == ["SUCCESS", "SUCCESS"]
    runner, _ = run(f"<Fallback>{around}<AlwaysSuccess/></Fallback>")
    assert runner.tick().status == "SUCCESS"
    runner, _ = run(around)
    assert runner.tick().status == "SKIPPED"
    assert not capfd.readouterr().err


def test_a_repeat_without_end_does_not_hold_up_a_tick(run: Any) -> None:
    runner, _ = run('<Repeat num_cycles="-1"><AlwaysSuccess/></Repeat>')
    assert runner.tick().status == "RUNNING"


def test_a_script_before_a_leaf_is_kept(run: Any) -> None:
    runner, _ = run('<Add to="1" step="2" sum="{b}" _failureIf="true"/>')
    tick = runner.tick()
    assert (tick.status, tick.leaves) == ("FAILURE", [])


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        (
            '<Add to="{a}" step="2" sum="b"/>',
            "<Add>: the output port `sum` is `b`, which is not a blackboard entry; "
            'write sum="{sum}" [leaf-port]',
        ),
        (
            '<Add to="many" step="2" sum="{b}"/>',
            "<Add>: `to` is `many`; the port has type int32 [leaf-port]",
        ),
        (
            '<Add to="1_0" step="2" sum="{b}"/>',
            "<Add>: `to` is `1_0`; the port has type int32 [leaf-port]",
        ),
        (
            '<Add to="٣" step="2" sum="{b}"/>',
            "<Add>: `to` is `٣`; the port has type int32 [leaf-port]",
        ),
        (
            '<Add step="2" sum="{b}"/>',
            '<Add>: the port `to` of `Add` is not given; write to="…" [leaf-port]',
        ),
        (
            "<Invert/>",
            "<Invert>: the plugin `Invert` ticks children, and has none here [child-count]",
        ),
        (
            "<Once><AlwaysSuccess/></Once>",
            "<AlwaysSuccess>: the leaf `Once` cannot have children [child-count]",
        ),
        (
            '<Sleep msec="soon"/>',
            '<Sleep>: `msec` is `soon`; write a number of milliseconds, msec="500" [leaf-port]',
        ),
    ],
)
def test_a_plugin_that_is_used_wrongly_is_reported_with_its_place(
    body: str, expected: str, tmp_path: Path
) -> None:
    _, policy, faults = loaded(tmp_path, body)
    assert policy is None
    (fault,) = faults
    assert fault.startswith("policy.xml:1:")
    assert fault.endswith(f"error: {expected}")


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ('<Add to="1" step="2" sum="{b}" stpe="3"/>', "<Add>: `Add` has no port `stpe`; did you mean step?"),
        ('<Add to="1" step="2" sum="{b}" zzz=""/>', "<Add>: `Add` has no port `zzz`; known: step, sum, to"),
        ('<Action ID="Add" to="1" step="2" sum="{b}" _uid="3" interface="ROS2SERVICE"/>', ""),
        (
            '<Action ID="Go" service_name="/Go/tick" speed="3"/>',
            "<Action>: `speed` is ignored; a skill's tick carries no values; a plugin or a <leaf> called `Go` could",
        ),
        ('<Action ID="Go" service_name="/Go/tick" _uid="3" isMonitored="false"/>', ""),
    ],
)  # fmt: skip
def test_what_is_no_port_of_a_leaf_is_told(body: str, expected: str, tmp_path: Path) -> None:
    _, policy, said = loaded(tmp_path, body)
    assert policy is not None, said
    warned = [one.partition(" warning: ")[2] for one in said if "[ignored-attribute]" in one]
    assert warned == ([f"{expected} [ignored-attribute]"] if expected else [])


def test_a_system_with_plugins_repeats_itself_in_virtual_time(tmp_path: Path) -> None:
    system, _, _ = loaded(
        tmp_path,
        "<Sequence><Invert><AlwaysFailure/></Invert><Delay delay_msec='2500'><Once/></Delay>"
        "<Timeout msec='1500'><Sleep msec='5000'/></Timeout></Sequence>",
    )
    program = compile_system(system)
    runs = []
    for _ in range(2):
        made = SimulatedRun(program, SimulatedWorld(seed=1))
        made.run(12.0)
        runs.append(made.ticks)
    assert runs[0] == runs[1]
    assert [tick.status for tick in runs[0][:7]] == [*["RUNNING"] * 6, "FAILURE"]


def test_generated_plugins_are_formatted_and_strictly_typed(tmp_path: Path) -> None:
    system, _, _ = loaded(tmp_path, "<Invert><Add to='1' step='2' sum='{b}'/></Invert>")
    output = tmp_path / "generated"
    write_files(system_files(system), output)
    (package,) = output.glob("*_policy")
    formatted(output)
    strictly_typed(output, [package])
