"""The tour in virtual time, in this process."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from catalogue import Fault, Kind
from inject import generated, patched
from listener import Listener, Run

if TYPE_CHECKING:
    from m2c.model.system import System
    from moon.properties.property import Property

STEP_S = 0.2
"""How often the run looks whether it is over."""
BEFORE_S = 0.01
"""The nodes begin to connect so long after it listens."""


def simulated(
    chosen: Fault | None,
    system: System,
    seconds: float,
    properties: Sequence[Property] = (),
    keeps: bool = True,
) -> Run:
    """The tour in virtual time, in this process; see ``run.py`` for the arguments."""
    from m2c.simulation.run import SimulatedRun
    from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld

    program = _program(system)
    if chosen is not None:
        program = program.replacing(chosen.node, _faulty_node(chosen, system))
    conditions = Conditions(delay_s=(0.0, 0.002), tap_delay_s=(0.0, 0.002))
    world = SimulatedWorld(1, conditions)
    listener = Listener(
        SimulatedTransport(world, "listener"),
        system,
        "" if chosen is None else chosen.node,
        properties,
        keeps,
    )
    listener.start()
    world.run_for(BEFORE_S)
    run = SimulatedRun(program, world)
    passed = 0.0
    while passed < seconds and not listener.is_over:
        run.run(STEP_S)
        passed += STEP_S
    result = listener.result()
    world.close()
    return result


def _program(system: System) -> Any:
    from m2c.simulation.program import compile_system

    if not _programs:
        _programs.append(compile_system(system))
    return _programs[0]


_programs: list[Any] = []


def _faulty_node(chosen: Fault, system: System) -> Any:
    from m2c.model import DiagnosticLog
    from m2c.model.system import read_with_reference
    from m2c.simulation.program import compile_node, import_node

    if chosen.kind is Kind.MODEL:
        log = DiagnosticLog()
        machine = read_with_reference(chosen.path, system, chosen.node, log)
        log.raise_if_errors()
        assert machine is not None
        return compile_node(machine, system)
    files = {
        Path(path): text for path, text in patched(generated(chosen.node), chosen.path).items()
    }
    package = next(path.parent for path in files if path.name == "machine.py")
    modules = {
        path.stem: text
        for path, text in files.items()
        if path.parent == package and path.stem in ("__init__", "interfaces", "machine", "node")
    }
    return import_node(package.name, modules, chosen.node)
