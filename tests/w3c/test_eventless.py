"""Eventless transitions are tested after every event, taken or not (W3C SCXML appendix D, mainEventLoop)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from m2c.model import DiagnosticLog, load
from m2c.model.machine import EventKind
from m2c.simulation.program import compile_system
from m2c.simulation.run import SimulatedRun
from m2c.simulation.semantics import Semantics
from moon.oracle.program import MachineProgram
from tests.codegen.harness import Generated
from tests.oracle.machines import library
from tests.w3c.both import Both, probe, say

DRAWS = '<transition cond="Math.random() &lt; 0.5" target="b"/>'
THERE = f'<state id="b"><onentry>{say(1)}</onentry></state>'
OTHERS = {
    "nobody waits for it": "",
    "another state waits for it": '<state id="c"><transition event="go"/></state>',
    "its condition does not hold": '<state id="c"><transition event="go"/></state>',
    "it is raised elsewhere": '<state id="c"><transition event="x"><raise event="go"/></transition></state>',
}
CONDITIONAL = '<transition event="go" cond="1 == 2" target="c"/>'


@pytest.mark.parametrize("which", OTHERS)
def test_a_draw_is_made_again_after_an_event_that_nobody_takes(which: str, tmp_path: Path) -> None:
    own = CONDITIONAL if "condition" in which else ""
    beat = '<transition event="beat"/>'  # it has events, so it can be sent one
    text = probe(
        f'<state id="a">{DRAWS}{own}</state>{THERE}{OTHERS[which]}<state id="d">{beat}</state>'
    )
    made = Generated(tmp_path, text)
    if made.it.state.value == "b":
        made.it.state = type(made.it.state).A
    drawn = iter((0.9, 0.9, 0.1))
    made.it._random = lambda: next(drawn)
    states = []
    for _ in range(3):
        made.it.on_event("go")
        states.append(made.it.state.value)
    assert states == ["a", "a", "b"]
    program = MachineProgram(made.machine_model, library())
    found = program.take(0, (), (EventKind.INTERNAL, "go"), None, {"name": "go"})
    assert {(taken, program.states[step.state].name) for taken, step in found} == {
        (False, "a"),
        (False, "b"),
    }


def test_a_condition_on_variables_alone_is_not_tested_again(tmp_path: Path) -> None:
    data = '<datamodel><data id="n" type="int32" expr="0"/></datamodel>'
    wait = '<transition cond="n &gt; 0" target="b"/><transition event="go"/>'
    both = Both(tmp_path, probe(f'{data}<state id="a">{wait}</state>{THERE}'))
    assert both.take("other", "go") == []
    assert "taken=False" not in both.made.files["machine.py"]


SERVER = '<ros_service_server name="ask" service_name="/ask" type="std_srvs/Trigger"/>'
ANSWER = '<ros_service_send_response name="ask"/>'
FAILS = '<data id="items" expr="[1]"/>'


def served(content: str) -> str:
    return probe(f"<datamodel>{FAILS}</datamodel>{SERVER}{content}")


LEAVES = {
    "a condition that failed": '<ros_service_handle_request name="ask" cond="items[9].x == 1"/>'
    '<transition event="error.execution" target="b"/>',
    "a draw": DRAWS,
}
ANSWERS = (
    f'<state id="b"><ros_service_handle_request name="ask">{ANSWER}{say(2)}'
    "</ros_service_handle_request></state>"
)


@pytest.mark.parametrize("leaves", LEAVES)
def test_an_event_is_not_offered_to_the_state_that_its_discarding_led_to(
    leaves: str, tmp_path: Path
) -> None:
    made = Generated(tmp_path, served(f'<state id="a">{LEAVES[leaves]}</state>{ANSWERS}'))
    made.it.state = type(made.it.state).A
    if "draw" in leaves:
        made.it._random = lambda: 0.1
    made.outputs.sent.clear()
    request: Any = made.interfaces
    assert made.it.on_ask_request(request.TriggerRequest()) is False
    assert made.it.state.value == "b"
    assert "publish_out" not in made.outputs.names()


@pytest.mark.parametrize("leaves", LEAVES)
def test_a_run_in_steps_takes_them_too(leaves: str, tmp_path: Path) -> None:
    call = '<ros_service_send_request name="ask"/>'
    client = '<ros_service_client name="ask" service_name="/ask" type="std_srvs/Trigger"/>'
    asks = (
        f'<state id="s"><onentry>{call}</onentry><ros_service_handle_response name="ask"/></state>'
    )
    (tmp_path / "Asks.scxml").write_text(probe(client + asks).replace("Probe", "Asks"))
    text = served(f'<state id="a">{LEAVES[leaves]}</state>{ANSWERS}')
    (tmp_path / "Probe.scxml").write_text(text)
    log = DiagnosticLog()
    system = load([tmp_path], log)
    assert system is not None, log.diagnostics
    assert not log.has_errors, log.diagnostics
    stepwise = Semantics.AS2FM
    world = stepwise.world(1)
    heard: list[Any] = []
    world.connect("listener").tap([], heard.append)
    program = compile_system(system, stepwise)
    SimulatedRun(program, world, stepwise.settings(1.0)).run(1.0)
    assert [item.data["data"] for item in heard if item.channel == "/out"] == [2]
