"""Generated code against the oracle's interpreter, step by step: what fails, what is raised, what never ends.

Both are implementations of one semantics (W3C SCXML 3.13, appendix D), compiled from the same ``Machine``.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from random import Random
from typing import Any

import msgspec
import pytest

from m2c.model.machine import EventKind
from m2c.runtime.machine import MAX_STEPS, EndlessLoopError
from moon.oracle.program import MachineProgram
from tests.codegen.harness import Generated
from tests.oracle.machines import library

HEAD = """<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" datamodel="ecmascript" name="Probe"
initial="idle"><ros_topic_subscriber topic="/level" type="std_msgs/Int32" name="level"/>
<ros_topic_publisher topic="/out" type="std_msgs/Int32" name="out"/>
<datamodel><data id="n" type="int32" expr="0"/><data id="m" type="int32" expr="0"/>
<data id="items" expr="[1, 2]"/></datamodel>
<state id="idle"><ros_topic_callback name="level" target="s0"/></state>"""
FAILS = ("items[n + 9].x == 1", "items[_msg.data].x == 1")
HOLDS = ("n % 2 == 0", "n % 3 != 1", "n &gt; m", "n &lt; 40", "items[0] &gt; 0")
NAMES = ("a", "b.c", "error.execution")
DESCRIPTORS = ("a", "b", "b.*", "error", "error.execution", "*")


class Both:
    """A generated machine and its program, taking the same events."""

    def __init__(self, folder: Path, text: str) -> None:
        self.made = Generated(folder, text)
        self.program = MachineProgram(self.made.machine_model, library())
        ((_, self.step),) = self.program.start(self.program.initial_data())
        self.expect_same()
        self.take(0)

    def take(self, number: int) -> None:
        """A message on ``/level``."""
        self.made.outputs.sent.clear()
        message = self.made.interfaces.Int32(number)
        with contextlib.suppress(EndlessLoopError):
            self.made.it.on_level_message(message)
        event = (EventKind.MESSAGE, "level")
        data = tuple(self.step.data)
        ((_, self.step),) = self.program.take(
            self.step.state, data, event, {"data": number}, {}, False
        )
        self.expect_same()

    def expect_same(self) -> None:
        """Both have sent the same, and are in the same state with the same data."""
        it, step = self.made.it, self.step
        sent = [item[1].data for item in self.made.outputs.sent if item[0] == "publish_out"]
        assert sent == [output.fields["data"] for output in step.outputs]
        assert it.state.value == self.program.states[step.state].name
        for name, value in zip(self.program.names, step.data, strict=True):
            if name in self.program.live:
                assert msgspec.to_builtins(getattr(it, name)) == value, name


class Writer:
    """A random machine: a condition or a statement may fail anywhere, and anything may be raised."""

    def __init__(self, draw: Random) -> None:
        self._draw = draw
        self._states = [f"s{index}" for index in range(draw.randint(1, 3))]
        self._raising = 0.4 if draw.random() < 0.3 else 0.15
        """Every few machines raise more than they take: they never end."""

    def text(self) -> str:
        """All of it."""
        return "".join([HEAD, *map(self._state, self._states), "</scxml>"])

    def _state(self, name: str) -> str:
        chance = self._draw.random
        entry = f"<onentry>{self._block(False)}</onentry>" if chance() < 0.5 else ""
        leaving = f"<onexit>{self._block(False)}</onexit>" if chance() < 0.4 else ""
        inner = "".join(self._transition() for _ in range(self._draw.randint(1, 5)))
        eventless = self._eventless() if chance() < 0.3 else ""
        return f'<state id="{name}">{entry}{leaving}{eventless}{inner}</state>'

    def _target(self, chance: float) -> str:
        if self._draw.random() >= chance:
            return ""
        return f' target="{self._draw.choice(self._states)}"'

    def _condition(self, of_message: bool) -> str:
        fails = FAILS if of_message else FAILS[:1]
        if self._draw.random() < 0.35:
            return f' cond="{self._draw.choice(fails)}"'
        return f' cond="{self._draw.choice(HOLDS)}"' if self._draw.random() < 0.5 else ""

    def _transition(self) -> str:
        of_message = self._draw.random() < 0.5
        cond, target = self._condition(of_message), self._target(0.5)
        if of_message:
            body = self._block(True)
            return f'<ros_topic_callback name="level"{cond}{target}>{body}</ros_topic_callback>'
        event = self._draw.choice(DESCRIPTORS)
        return f'<transition event="{event}"{cond}{target}>{self._block(False)}</transition>'

    def _eventless(self) -> str:
        cond = self._condition(False) if self._draw.random() < 0.2 else ' cond="n % 7 == 3"'
        return (
            f"<transition{cond}{self._target(0.7)}>{self._count()}{self._block(False)}</transition>"
        )

    def _count(self) -> str:
        return '<assign location="n" expr="(n + 1) % 50"/>'

    def _block(self, of_message: bool) -> str:
        return "".join(self._statement(of_message, 0) for _ in range(self._draw.randint(0, 3)))

    def _statement(self, of_message: bool, depth: int) -> str:
        draw = self._draw.random()
        if draw < self._raising:
            return f'<raise event="{self._draw.choice(NAMES)}"/>'
        if draw < 0.5:
            return '<ros_topic_publish name="out"><field name="data" expr="n * 100 + m"/></ros_topic_publish>'
        if draw < 0.65:
            return self._count()
        if draw < 0.72:
            return '<assign location="m" expr="items[n + 9].x"/>'
        if draw < 0.78:
            return '<assign location="items[n % 3]" expr="m + n"/>'
        if draw < 0.82:
            return '<log expr="items[n + 9].x"/>'
        if draw < 0.86 and of_message:
            return '<assign location="m" expr="_msg.data"/>'
        if depth == 2:
            return ""
        inner = [self._statement(of_message, depth + 1) for _ in range(3)]
        test, other = self._condition(of_message) or ' cond="true"', self._condition(of_message)
        alternative = f"<elseif{other}/>{inner[1]}" if other else ""
        return f"<if{test}>{inner[0]}{alternative}<else/>{inner[2]}</if>"


@pytest.mark.parametrize("first", range(0, 120, 10))
def test_random_machines_do_the_same_step_by_step_whatever_fails(
    tmp_path: Path, first: int
) -> None:
    for seed in range(first, first + 10):
        draw = Random(seed)
        folder = tmp_path / str(seed)
        folder.mkdir()
        both = Both(folder, Writer(draw).text())
        for _ in range(8):
            both.take(draw.randint(0, 5))


def published(both: Both) -> list[Any]:
    """What the generated machine has published at its last event."""
    return [item[1].data for item in both.made.outputs.sent if item[0] == "publish_out"]


PUBLISH = '<ros_topic_publish name="out"><field name="data" expr="{}"/></ros_topic_publish>'


def machine(content: str) -> str:
    return f'{HEAD}<state id="s0">{content}</state><state id="s1"/></scxml>'


def test_a_condition_that_fails_is_an_event_before_the_next_message(tmp_path: Path) -> None:
    both = Both(
        tmp_path,
        machine(
            f"""<ros_topic_callback name="level" cond="items[_msg.data].x == 1" target="s1"/>
            <transition event="error.execution">{PUBLISH.format(7)}</transition>"""
        ),
    )
    both.take(5)
    assert published(both) == [7]
    both.take(5)
    assert published(both) == [7]


def test_what_handles_a_failed_condition_may_change_the_state_without_sending(
    tmp_path: Path,
) -> None:
    both = Both(
        tmp_path,
        machine(
            """<ros_topic_callback name="level" cond="items[_msg.data].x == 1"/>
            <transition event="error" target="s1"/>"""
        ),
    )
    both.take(5)
    assert both.made.it.state.value == "s1"


CHAIN = """<ros_topic_callback name="level"><assign location="n" expr="0"/><assign location="m" expr="_msg.data"/>
<raise event="again"/></ros_topic_callback>
<transition event="again" cond="n &lt; m"><assign location="n" expr="n + 1"/><raise event="again"/></transition>
<transition event="again">{}</transition>"""


@pytest.mark.parametrize("length", [600, MAX_STEPS - 1])
def test_a_chain_of_raised_events_is_taken_to_its_end(tmp_path: Path, length: int) -> None:
    both = Both(tmp_path, machine(CHAIN.format(PUBLISH.format("n"))))
    both.take(length - 1)
    assert published(both) == [length - 1]


def test_what_an_endless_loop_has_raised_is_dropped_with_it(tmp_path: Path) -> None:
    both = Both(tmp_path, machine(CHAIN.format(PUBLISH.format("n"))))
    both.take(5 * MAX_STEPS)
    assert published(both) == []
    both.take(3)
    assert published(both) == [3]


def test_an_endless_loop_of_two_states_ends_in_the_same_one(tmp_path: Path) -> None:
    both = Both(
        tmp_path,
        f"""{HEAD}<state id="s0"><ros_topic_callback name="level" target="s1"/></state>
        <state id="s1"><onentry><raise event="a"/></onentry><transition event="a" target="s2"/></state>
        <state id="s2"><onentry><raise event="a"/></onentry><transition event="a" target="s1"/>
        <ros_topic_callback name="level">{PUBLISH.format(2)}</ros_topic_callback></state></scxml>""",
    )
    both.take(1)
    both.take(1)
