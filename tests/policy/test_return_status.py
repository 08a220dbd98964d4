"""``<bt_return_status>`` of a status that a variable holds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from m2c.model.machine import EventKind
from moon.oracle.program import MachineProgram
from tests.oracle.machines import library, read
from tests.policy.simulated import HEAD, checked, simulated, statuses, written

STEPS = (
    HEAD.format("Steps", "wait")
    + """
<datamodel><data id="held" {}/><data id="n" type="int8" expr="0"/></datamodel>
<state id="wait"><bt_tick target="wait">
  <assign location="n" expr="n + 1"/>
  {}
  <bt_return_status status="held"/>
</bt_tick></state></scxml>"""
)
BY_NAME = STEPS.format(
    'type="string" expr="\'RUNNING\'"',
    """<if cond="n == 2"><assign location="held" expr="'SUCCESS'"/>
    <elseif cond="n == 3"/><assign location="held" expr="'FAILURE'"/></if>""",
)
BY_NUMBER = STEPS.format(
    'type="int8" expr="3"', '<if cond="n > 1"><assign location="held" expr="n - 1"/></if>'
)
UNTYPED = STEPS.format('expr="3"', '<if cond="n > 1"><assign location="held" expr="n - 1"/></if>')


@pytest.mark.parametrize("plugin", [BY_NAME, BY_NUMBER, UNTYPED])
def test_a_plugin_returns_the_status_that_a_variable_holds_by_name_or_as_2fm_s_number(
    plugin: str, tmp_path: Path
) -> None:
    run = simulated(written(tmp_path, "<Steps/>", {"Steps": plugin}), 3.0)
    assert statuses(run) == ["RUNNING", "SUCCESS", "FAILURE"]


@pytest.mark.parametrize("plugin", [BY_NAME, BY_NUMBER, UNTYPED])
def test_the_oracle_has_the_same_status(plugin: str) -> None:
    program = MachineProgram(read(plugin), library())
    data: tuple[Any, ...] = program.initial_data()
    said = []
    for _ in range(3):
        ((_, step),) = program.take(0, data, (EventKind.BT_TICK, ""), None, {}, False)
        data = tuple(step.data)
        said += [output.fields["status"] for output in step.outputs]
    assert said == ["RUNNING", "SUCCESS", "FAILURE"]


EARLY = (
    HEAD.format("Early", "wait")
    + """
<datamodel><data id="n" type="int8" expr="0"/></datamodel>
<state id="wait"><transition event="bt_tick" target="wait">
  <assign location="n" expr="n + 1"/>
  <if cond="n == 1"><send event="bt_running"/><elseif cond="n == 2"/><send event="bt_success"/>
  <else/><send event="bt_failure"/></if>
</transition></state></scxml>"""
)


def test_the_events_by_which_early_plugins_answer_a_tick_are_its_status(tmp_path: Path) -> None:
    system = written(tmp_path, "<Early/>", {"Early": EARLY})
    said = checked(system)[1]
    assert all("[older-spelling]" in line for line in said)
    assert len(said) == 4
    assert statuses(simulated(system, 3.0)) == ["RUNNING", "SUCCESS", "FAILURE"]


@pytest.mark.parametrize(
    ("kind", "value"), [("string", "'DONE'"), ("int8", "0"), ("int8", "4"), ("float64[]", "")]
)
def test_a_variable_that_holds_no_status_is_no_answer_to_a_tick(
    kind: str, value: str, tmp_path: Path, caplog: Any
) -> None:
    text = STEPS.format(f'type="{kind}" expr="{value}"' if value else f'type="{kind}"', "")
    system = written(tmp_path, "<Steps/>", {"Steps": text})
    if kind == "float64[]":
        _, said = checked(system)
        assert said == [
            "Steps.scxml: error: <bt_return_status>: `held` has type float64[], which holds no status; "
            "a status is a string, SUCCESS, FAILURE, RUNNING, or an integer, 1 for SUCCESS, 2 for FAILURE, "
            "3 for RUNNING [bad-status]"
        ]
        return
    assert statuses(simulated(system, 1.0)) == ["FAILURE"]
    assert f"{value} where a status is declared" in caplog.text


def test_a_status_that_is_neither_named_nor_a_variable_is_refused(tmp_path: Path) -> None:
    text = STEPS.format('type="int8"', "").replace('status="held"', 'status="Succes"')
    _, said = checked(written(tmp_path, "<Steps/>", {"Steps": text}))
    assert said == [
        "Steps.scxml: error: <bt_return_status>: `Succes` is not a status; one of SUCCESS, FAILURE, RUNNING, "
        "or a variable that holds one [bad-status]"
    ]
