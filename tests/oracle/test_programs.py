"""A machine's programs are made once; the difference is seen only in how long a step takes."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from m2c.model.machine import EventKind
from moon.oracle.program import MachineProgram, Program
from tests.oracle.machines import library, read
from tests.oracle.tour import lab_tour

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("machine", lab_tour()[0].nodes, ids=lambda machine: machine.name)
def test_the_program_for_unknown_values_is_made_once(machine) -> None:
    program = MachineProgram(machine, lab_tour()[0].library)
    assert program._symbolic[0] is program._symbolic[0]


def test_nothing_that_is_compiled_needs_a_property_that_keeps_its_value(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """mypyc takes ``functools.cached_property`` for a property: it is computed each time, without a word."""
    monkeypatch.chdir(ROOT)
    monkeypatch.delenv("MOON_COMPILED", raising=False)
    monkeypatch.setattr("setuptools.setup", lambda **_: None)
    modules = runpy.run_path("setup.py")["modules"]()
    assert len(modules) > 40
    assert not [name for name in modules if "cached_property" in without_comments(name)]


def without_comments(name: str) -> str:
    lines = (ROOT / name).read_text(encoding="utf-8").splitlines()
    return "\n".join(line.partition("  # ")[0] for line in lines)


HEAD = """<scxml xmlns="http://www.w3.org/2005/07/scxml" name="Probe" initial="s">
<ros_topic_publisher topic="/out" type="std_msgs/Int32" name="out"/>
<datamodel><data id="n" type="int32" expr="{}"/><data id="a" expr="[1, 2]"/></datamodel><state id="s">"""


@pytest.mark.parametrize(
    ("initial", "content", "draws"),
    [
        ("0", """<onentry><log label="function='random'" expr="n"/></onentry>""", False),
        ("0", """<onentry><log expr="'Math.random()'"/></onentry>""", False),
        ("0", """<onentry><log expr='"function=&apos;random&apos;"'/></onentry>""", False),
        ("0", '<onentry><assign location="n" expr="Math.floor(Math.max(1, 2))"/></onentry>', False),
        ("Math.floor(Math.random() * 3)", "", True),
        ("0", '<transition cond="n &gt; 0 &amp;&amp; Math.random() &lt; 0.5" target="s"/>', True),
        ("0", '<onentry><assign location="a[Math.floor(Math.random() * 2)]" expr="1"/></onentry>', True),
        ("0", '<onentry><if cond="!(Math.random() &gt; 0.5)"><log expr="1"/></if></onentry>', True),
        ("0", '<onentry><send event="x" delayexpr="n ? 1 : Math.random()"/></onentry>', True),
        ("0", '<onexit><raise event="x"/><log expr="[Math.random()]"/></onexit>', True),
    ],
)  # fmt: skip
def test_whether_a_machine_draws_is_seen_in_its_expressions_not_in_its_texts(
    initial: str, content: str, draws: bool
) -> None:
    assert (
        MachineProgram(read(f"{HEAD.format(initial)}{content}</state></scxml>"), library()).draws
        is draws
    )


FAILING = """<ros_topic_callback name="/in" cond="a[5] &gt; 0"/>
<transition event="error.execution"><assign location="n" expr="n + 1"/></transition>"""


@pytest.mark.parametrize(
    ("content", "changes"),
    [
        (FAILING, True),
        (FAILING.replace("error.execution", "error.*"), True),
        (FAILING.replace("error.execution", "other"), False),
        (FAILING.replace(' cond="a[5] &gt; 0"', ""), False),
    ],
)
def test_a_message_changes_something_where_only_its_condition_does_by_failing(
    content: str, changes: bool
) -> None:
    head = HEAD.format("0").replace(
        "<datamodel>",
        '<ros_topic_subscriber topic="/in" type="std_msgs/Int32" name="/in"/><datamodel>',
    )
    program = Program(read(f"{head}{content}</state></scxml>"), library())
    assert program.changes_something((EventKind.MESSAGE, "/in")) is changes
