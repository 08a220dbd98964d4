"""The models of docs/models-of-other-nodes.md: nodes that keep to them conform, others are violated."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from m2c.model import DiagnosticLog, System, load
from m2c.simulation.program import compile_system
from m2c.simulation.run import SimulatedRun
from moon.monitor.models import ModelMonitor
from moon.verdict import Outcome, Verdict
from transports.simulated import SimulatedTransport, SimulatedWorld

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/models-of-other-nodes.md").read_text(encoding="utf-8")
MODELS = {
    re.findall(r'name="(\w+)" initial', text)[0]: text
    for text in re.findall(r"^```xml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
}
CLIENT = """<ascxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="Mission" initial="asking">
  <ros_action_client name="plan" action_name="/plan" type="mobile_interfaces/ComputePathToPose"/>
  <state id="asking">
    <onentry><ros_action_send_goal name="plan"/></onentry>
    <ros_action_handle_success_result name="plan" target="asking"/>
    <ros_action_handle_aborted_result name="plan" target="asking"/>
    <ros_action_handle_error name="plan" target="asking"/>
  </state>
</ascxml>"""


def system(folder: Path, change: tuple[str, str] = ("", "")) -> System:
    """The models of the page, ``change[0]`` of them replaced."""
    folder.mkdir()
    for name, text in {**MODELS, "Mission": CLIENT}.items():
        (folder / f"{name}.ascxml").write_text(text.replace(*change) if change[0] else text)
    log = DiagnosticLog()
    found = load([folder], log, [ROOT / "examples/navigation/interfaces"])
    assert found is not None, log.diagnostics
    assert not log.diagnostics, log.diagnostics
    return found


def said(folder: Path, *change: str, seed: int = 1) -> list[Verdict]:
    """What is said of nodes that are as the page says but for ``change``, in fifteen seconds."""
    monitored = system(folder / "monitored")
    assert not change or any(change[0] in text for text in MODELS.values())
    running = system(folder / "running", (change[0], change[1])) if change else monitored
    world = SimulatedWorld(seed=seed)
    others = [node for node in monitored.nodes if node.name in MODELS]
    monitor = ModelMonitor(others, monitored.library, synchronised=True)
    run = SimulatedRun(compile_system(running), world)
    listener = SimulatedTransport(world, "listener")
    found: list[Verdict] = []
    listener.tap([], lambda observation: found.extend(monitor.feed(observation)))
    listener.every(0.05, lambda: found.extend(monitor.advance(world.now_ns)))
    for node in others:
        monitor.node_started(node.name, world.now_ns)
    run.run(15.0)
    world.close()
    return found


def violated(verdicts: list[Verdict]) -> set[str]:
    """The nodes that are said to be violated."""
    return {verdict.node for verdict in verdicts if verdict.outcome is Outcome.VIOLATED}


def test_the_page_has_three_models() -> None:
    assert list(MODELS) == ["Lidar", "Planner", "Battery"]


@pytest.mark.parametrize("seed", range(3))
def test_nodes_that_do_as_their_models_say_conform(tmp_path: Path, seed: int) -> None:
    assert said(tmp_path, seed=seed) == []


@pytest.mark.parametrize(
    ("right", "wrong", "node"),
    [
        ("length: 360", "length: 359", "Lidar"),
        ("Math.random() * 3.375", "Math.random() * 3.375 + 2", "Lidar"),
        ("Infinity :", "-1 :", "Lidar"),
        ("Infinity :", "4 :", "Lidar"),
        ("* 4950", "* 4950 + 8000", "Planner"),
        ("? 207 : 208", "? 206 : 209", "Planner"),
        ("* 1900", "* 1900 + 5000", "Battery"),
        ("'charging'", "'empty'", "Battery"),
        ("charge * Math.random()", "charge + 1", "Battery"),
    ],
)
def test_a_node_that_does_otherwise_is_violated(
    tmp_path: Path, right: str, wrong: str, node: str
) -> None:
    assert violated(said(tmp_path, right, wrong)) == {node}


def test_a_violation_is_told_as_the_page_shows(tmp_path: Path) -> None:
    first, *_ = said(tmp_path, "Math.random() * 3.375", "5.375")
    shown = next(line for line in PAGE.splitlines() if line.startswith("expected "))
    parts = [re.sub(r"{header: .*", "", part) for part in first.reason.split(", observed ")]
    told = re.sub(r"\[\d+\]", "[7]", ", observed ".join(parts))
    assert told == shown.replace("{header: …}", "")
