"""Compile models of robot deliberation into running nodes.

The names in ``__all__`` are the interface; everything else may change. A system is read, checked and
generated:

>>> import m2c
>>> system = m2c.read_system("examples/lab_tour/system.xml")
>>> len(system.nodes), system.policy.name
(17, 'policy.xml')
>>> m2c.check(system)
[]
>>> import tempfile
>>> with tempfile.TemporaryDirectory() as folder:
...     files = m2c.generate(system, folder)
...     files[0].relative_to(folder).as_posix()
'alarm_skill/alarm_skill/__init__.py'

The same nodes run in a simulated world, in virtual time:

>>> from transports import SimulatedWorld
>>> run = m2c.simulate(system, SimulatedWorld(seed=1))
>>> run.run(10.0)
>>> len(run.ticks)
50

A node may be written by hand (:class:`Node`), and takes part in both.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from m2c.codegen.generation import OtherPackagesError
    from m2c.codegen.rendering import TemplateFault
    from m2c.codegen.writer import EditedFilesError
    from m2c.diagnostics import Diagnostic, ModelError
    from m2c.model.machine import Machine
    from m2c.model.system import System
    from m2c.runtime.main import run_node
    from m2c.runtime.messages import ActionType, ServiceType
    from m2c.runtime.node import Call, Client, Node, Publisher
    from m2c.simulation.run import SimulatedRun
    from transports.simulated import SimulatedWorld

__all__ = [
    "ActionType",
    "Call",
    "Client",
    "Diagnostic",
    "EditedFilesError",
    "Machine",
    "ModelError",
    "Node",
    "OtherPackagesError",
    "Publisher",
    "ServiceType",
    "System",
    "TemplateFault",
    "check",
    "generate",
    "read_system",
    "run_node",
    "simulate",
]

_HOMES = {
    "ActionType": "m2c.runtime.messages",
    "Call": "m2c.runtime.node",
    "Client": "m2c.runtime.node",
    "Diagnostic": "m2c.diagnostics",
    "EditedFilesError": "m2c.codegen.writer",
    "Machine": "m2c.model.machine",
    "ModelError": "m2c.diagnostics",
    "Node": "m2c.runtime.node",
    "OtherPackagesError": "m2c.codegen.generation",
    "Publisher": "m2c.runtime.node",
    "ServiceType": "m2c.runtime.messages",
    "System": "m2c.model.system",
    "TemplateFault": "m2c.codegen.rendering",
    "run_node": "m2c.runtime.main",
}
"""Where a name is defined. It is imported when it is first used: the command line stays quick."""

# Importing a package binds its name in the package around it. That of the checks is imported here, so
# that no later import of it takes the place of the function `check`.
importlib.import_module("m2c.check")


def read_system(
    path: Path | str,
    *more: Path | str,
    interfaces: Sequence[Path | str] = (),
    lenient: bool = False,
    parameters: Sequence[str] = (),
    remaps: Sequence[str] = (),
) -> System:
    """Read models as one system.

    Args:
        path: a model (``.scxml``, ``.ascxml``), a folder of them, or a system file.
        more: further models or folders; a system file is read alone.
        interfaces: folders of ROS interface packages; a folder ``interfaces`` beside a model, or up
            to three folders above it, is used without being named.
        lenient: whether a string, number or bool becomes another of them where its type is needed, as
            ECMAScript has it. That is run and monitored so, and :func:`check` warns of it; else it is
            an error.
        parameters: what variables of nodes begin with, as ``GoTo.poi=3``.
        remaps: channels that take the place of nodes' own, as ``GoTo:/goal:=/dock/goal``.

    Returns:
        The system, with the warnings of its reader as ``findings``.

    Raises:
        ModelError: something in a file is wrong, or there is no model; ``diagnostics`` says what.
    """
    from m2c.changes import Changes
    from m2c.model.reading import read_or_raise

    return read_or_raise(
        [Path(item) for item in (path, *more)],
        [Path(item) for item in interfaces],
        Changes(lenient, tuple(parameters), tuple(remaps)),
    )


def check(system: System, *, transport: str | None = None) -> list[Diagnostic]:
    """Check a system, and its policy if it has one, as the command ``m2c check`` does.

    Args:
        system: what :func:`read_system` has read.
        transport: where the nodes will run (``zenoh``, ``ros2``): a name of a node or channel that it
            does not take is an error. By default, a name that any transport does not take is a
            warning.

    Returns:
        The findings, those of the reader among them, in the order of their places. The system can be
        generated if the ``severity`` of none is ``error``.

    Raises:
        TransportError: no such transport is installed.
    """
    from m2c.check.reading import findings_of
    from m2c.naming import naming_of

    return findings_of(system, naming_of(transport))


def generate(
    system: System,
    folder: Path | str,
    *,
    transport: str = "zenoh",
    templates: Path | str | None = None,
    force: bool = False,
) -> list[Path]:
    """Generate the nodes of a system, its policy, and a launch description.

    The same system gives the same files, byte for byte. A file that is there already with the right
    contents is not written again.

    Args:
        system: what :func:`read_system` has read.
        folder: where the packages go; made if it does not exist.
        transport: the middleware of the nodes: ``zenoh`` (a Python distribution for each) or ``ros2``
            (a package of a ROS 2 workspace for each).
        templates: a folder of Jinja2 templates that override or extend those that come with m2c.
        force: overwrite files that a person has edited.

    Returns:
        The paths of all generated files, sorted.

    Raises:
        ModelError: :func:`check` finds errors; nothing is written.
        EditedFilesError: a file was edited since it was generated; nothing is written.
        OtherPackagesError: ``folder`` has packages for another transport; nothing is written.
        TemplateFault: a template cannot be used; nothing is written.
        TransportError: no such transport is installed.
        OSError: a file cannot be written.
    """
    from m2c.check.reading import raise_if_errors
    from m2c.codegen.generation import write_system
    from m2c.naming import naming_of

    naming = naming_of(transport)
    raise_if_errors(system, naming)
    made_from = None if templates is None else Path(templates)
    return list(write_system(system, Path(folder), transport, made_from, naming, force).paths)


def simulate(system: System, world: SimulatedWorld) -> SimulatedRun:
    """Start every node of a system, and its policy, in a simulated world.

    The nodes are the code that :func:`generate` writes; only the processes are left out. What
    happens is decided by the models and by the seed and the conditions of ``world``.

    Args:
        system: what :func:`read_system` has read.
        world: where it runs. What is to observe the nodes from the beginning is connected before.

    Returns:
        The run: ``run(seconds)`` lets virtual time pass, ``ticks`` has what the policy did.

    Raises:
        ModelError: :func:`check` finds errors.
    """
    from m2c.check.reading import raise_if_errors
    from m2c.simulation.program import compile_system
    from m2c.simulation.run import SimulatedRun

    raise_if_errors(system)
    return SimulatedRun(compile_system(system), world)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
