"""Callers and answerers reach what only a machine's own constants reach."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.model import DiagnosticLog, load
from m2c.model.machine import Machine
from m2c.model.system import System
from m2c.simulation.program import Program, compile_node
from m2c.simulation.run import SimulatedRun
from tests.mutation.exercise import answerers, callers
from transports.interface import Observation, ObservationKind
from transports.simulated import SimulatedTransport, SimulatedWorld

ASK = "string name\nint64 number\nfloat64 level\n---\nint32 branch\n"
BRANCHES = (
    "name == 'PoiDone4'",
    "number == 5000000000",
    "number == -7",
    "level == 3.25",
    "name == CALLED",
)
"""Conditions that no value reaches but one that stands in the model, or is next to it."""
CONSTANTS = '<datamodel><data id="CALLED" type="string" expr="\'dock 2\'"/></datamodel>'


def system(folder: Path, body: str) -> System:
    """One machine called ``M``."""
    (folder / "interfaces/t/srv").mkdir(parents=True)
    (folder / "interfaces/t/srv/Ask.srv").write_text(ASK)
    (folder / "interfaces/t/srv/Told.srv").write_text("---\n" + ASK.partition("---")[0])
    (folder / "m.scxml").write_text(
        '<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="M" initial="idle">'
        f"{CONSTANTS}{body}</scxml>"
    )
    log = DiagnosticLog()
    found = load([folder], log)
    assert found is not None, log.diagnostics
    assert not log.has_errors, log.diagnostics
    return found


def heard_of(folder: Path, body: str) -> list[Observation]:
    """What the machine sends in a minute among callers and answerers."""
    models = system(folder, body)
    machine: Machine = models.nodes[0]
    world = SimulatedWorld(1)
    heard: list[Observation] = []
    SimulatedTransport(world, "listener").tap([], heard.append)
    run = SimulatedRun(Program({"M": compile_node(machine, models)}, {}, None), world)
    callers(world, machine, models.library)
    answerers(world, machine, models.library)
    run.run(60.0)
    return [item for item in heard if item.source == "M"]


@pytest.mark.parametrize("condition", BRANCHES)
def test_a_request_has_the_value_that_a_condition_compares_with(
    tmp_path: Path, condition: str
) -> None:
    answer = (
        '<ros_service_send_response name="/ask"><field name="branch" expr="{}"/>'
        "</ros_service_send_response></ros_service_handle_request>"
    )
    compared = condition.replace("name", "_req.name").replace("number", "_req.number")
    heard = heard_of(
        tmp_path,
        '<ros_service_server service_name="/ask" type="t/Ask"/><state id="idle">'
        f'<ros_service_handle_request name="/ask" cond="{compared.replace("level", "_req.level")}">'
        f"{answer.format(1)}"
        f'<ros_service_handle_request name="/ask">{answer.format(0)}</state>',
    )
    sent = [i.data["branch"] for i in heard if i.kind is ObservationKind.RESPONSE_SENT]
    assert set(sent) == {0, 1}


def test_an_answer_has_the_text_that_a_condition_compares_with(tmp_path: Path) -> None:
    heard = heard_of(
        tmp_path,
        '<ros_service_client service_name="/told" type="t/Told"/>'
        '<ros_topic_publisher topic="/done" type="std_msgs/Empty"/>'
        '<state id="idle"><transition after="100ms" target="asking"/></state>'
        '<state id="asking"><onentry><ros_service_send_request name="/told"/></onentry>'
        '<ros_service_handle_response name="/told" cond="_res.name == \'PoiDone4\'" target="idle">'
        '<ros_topic_publish name="/done"/></ros_service_handle_response>'
        '<ros_service_handle_response name="/told" target="idle"/>'
        '<ros_service_handle_error name="/told" target="idle"/>'
        '<transition after="2s" target="idle"/></state>',
    )
    assert "/done" in {item.channel for item in heard}
