"""A system of plugins and nodes written by a test: checked, and run as generated code in virtual time."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from m2c.check import check_system
from m2c.model import DiagnosticLog, System, load
from m2c.policy.program import read_policy
from m2c.simulation.program import compile_system
from m2c.simulation.run import SimulatedRun
from transports.simulated import SimulatedWorld

HEAD = '<scxml xmlns="http://www.w3.org/2005/07/scxml" name="{}" initial="{}">'
NODE = f'{HEAD.format("Node", "a")}<state id="a"/></scxml>'


def written(
    folder: Path, tree: str, plugins: Mapping[str, str], nodes: Mapping[str, str] | None = None
) -> Path:
    """The system file of ``tree`` (a node of one, or several ``<BehaviorTree>``) with these models by name."""
    trees = tree if "<BehaviorTree" in tree else f'<BehaviorTree ID="M">{tree}</BehaviorTree>'
    (folder / "policy.xml").write_text(f'<root main_tree_to_execute="M">{trees}</root>')
    nodes = {"Node": NODE} if nodes is None else nodes
    inputs = {"bt-plugin-ascxml": plugins, "node-ascxml": nodes}
    lines = dict.fromkeys(inputs, "")
    for kind, models in inputs.items():
        for name, text in models.items():
            (folder / f"{name}.scxml").write_text(text)
            lines[kind] += f'<input type="{kind}" src="{name}.scxml"/>'
    system = folder / "system.xml"
    system.write_text(
        '<roaml><parameters><bt_tick_rate value="1"/></parameters><behavior_tree>'
        f'<input type="bt.cpp-xml" src="policy.xml"/>{lines["bt-plugin-ascxml"]}</behavior_tree>'
        f"<node_models>{lines['node-ascxml']}</node_models></roaml>"
    )
    return system


def checked(system: Path) -> tuple[System | None, list[str]]:
    """What is read, and what ``m2c check`` says: position without folder, severity, message, rule."""
    log = DiagnosticLog()
    found = load([system], log)
    if found is not None:
        check_system(found, log)
        if found.policy is not None and not log.has_errors:
            read_policy(found.policy, found, log)
    said = [str(item).replace(f"{system.parent}/", "") for item in log.diagnostics]
    return found, [re.sub(r"^(\S+?):\d+:\d+: ", r"\1: ", line) for line in said]


def simulated(system: Path, seconds: float, world: SimulatedWorld | None = None) -> SimulatedRun:
    """A run of the system, which must be without errors."""
    found, said = checked(system)
    assert found is not None, said
    assert not any(": error:" in line for line in said), said
    run = SimulatedRun(compile_system(found), world or SimulatedWorld(seed=1))
    run.run(seconds)
    return run


def statuses(run: SimulatedRun) -> list[str]:
    """The status of the tree, tick by tick."""
    return [tick.status for tick in run.ticks]
