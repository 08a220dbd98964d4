"""A whole system: node models, behaviour-tree policy and plugins, tick rate, interface types.

It is read by :mod:`m2c.model.loading`.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

import msgspec

from m2c.diagnostics import Diagnostic, DiagnosticLog, Position
from m2c.model.deployment import Process
from m2c.model.instances import Instance
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import Dialect, InterfaceKind, Machine
from m2c.model.parameters import (
    DEFAULT_ARRAY_SIZE,
    DEFAULT_TICK_RATE_HZ,
)
from m2c.model.paths import meant
from m2c.model.qualities import (
    TopicQuality,
    with_qualities,
)
from m2c.model.reader import MODEL_ROOTS, machine_of
from m2c.model.xml import Element, read_xml

MODEL_SUFFIXES = (".scxml", ".ascxml")
POLICY_ROOT = "root"
SYSTEM_ROOT = "roaml"
SYSTEM_ROOTS = ("convince_mc_tc", SYSTEM_ROOT)
_ANCESTORS = 3
"""How many folders above a model an ``interfaces`` folder is looked for."""


class Origin(msgspec.Struct, frozen=True):
    """What a node was made of: the machine of its model's file, and the instance that it is of it."""

    model: Machine
    instance: Instance


class System(msgspec.Struct, frozen=True, kw_only=True):
    """What is generated and run together.

    Attributes:
        name: of the system file or folder, or of the only model.
        path: where it was read from.
        nodes: one machine per node.
        plugins: behaviour-tree plugins, by machine name the leaf's ID.
        policy: the behaviour tree's XML file, if there is one.
        tick_rate_hz: how often the tree is ticked.
        tick_if_not_running: whether the tree is ticked again after it has ended.
        max_time_s: how long a run in virtual time lasts, in seconds; None if the system does not say it.
        max_array_size: elements of an array without a bound, for tools that need one.
        library: the interface types that the models use.
        sources: every file that was read, models and policy, and those that are named and not there.
        qualities: what is asked of the middleware for single topics; the machines have it too.
        deployment: its processes, where the system file says which there are.
        findings: what its reader found, where that was asked for (:func:`m2c.read_system`).
        origins: what the nodes that have a model's file were made of, by their names.
    """

    name: str
    path: Path
    nodes: tuple[Machine, ...]
    plugins: tuple[Machine, ...] = ()
    policy: Path | None = None
    tick_rate_hz: float = DEFAULT_TICK_RATE_HZ
    tick_if_not_running: bool = True
    max_time_s: float | None = None
    max_array_size: int = DEFAULT_ARRAY_SIZE
    library: InterfaceLibrary
    sources: tuple[Path, ...] = ()
    qualities: tuple[TopicQuality, ...] = ()
    deployment: tuple[Process, ...] = ()
    findings: tuple[Diagnostic, ...] = ()
    origins: dict[str, Origin] = {}

    def __repr__(self) -> str:
        count = len(self.nodes)
        plugins = f", {len(self.plugins)} plugins" if self.plugins else ""
        policy = f", policy {str(self.policy)!r}" if self.policy is not None else ""
        nodes = f"{count} node{'s' * (count != 1)}"
        return f"<System {self.name!r}: {nodes}{plugins}{policy}, read from {str(self.path)!r}>"

    def made_lenient(self) -> System:
        """The same system, of ``lenient`` machines."""
        return msgspec.structs.replace(
            self,
            nodes=tuple(machine.made_lenient() for machine in self.nodes),
            plugins=tuple(machine.made_lenient() for machine in self.plugins),
        )

    @property
    def channels(self) -> frozenset[str]:
        """The names of the channels that its models name."""
        ends = (end for machine in (*self.nodes, *self.plugins) for end in machine.interfaces)
        return frozenset(
            end.channel for end in ends if end.channel and end.kind is not InterfaceKind.TIMER
        )

    def node(self, name: str) -> Machine | None:
        """The node called ``name``."""
        return next((node for node in self.nodes if node.name == name), None)


def is_model(path: Path) -> bool:
    """Whether ``path`` is a model by its name, or an ``.xml`` file whose root is a state machine."""
    if path.suffix in MODEL_SUFFIXES:
        return True
    if path.suffix != ".xml" or not os.path.isfile(path):
        return False
    root = read_xml(path, DiagnosticLog())
    return root is not None and root.tag in MODEL_ROOTS


def library_for(
    files: Sequence[Path], directories: Sequence[Path], log: DiagnosticLog
) -> InterfaceLibrary:
    """The interface types for ``files``: of ``directories``, then of folders ``interfaces`` near them.

    Definitions are named as the folders that they are in.
    """
    folders = [*directories, *interfaces_near(files)]
    usable: dict[Path, Path] = {}
    for folder in dict.fromkeys(folders):
        if os.path.isdir(folder):
            usable.setdefault(folder.resolve(), folder)
        else:
            missing = "is not a folder" if os.path.exists(folder) else "does not exist"
            what = f"this interface folder {missing}"
            log.error("missing-file", Position(str(folder)), "", what, meant(folder))
    return InterfaceLibrary.load(list(usable.values()), log)


def interfaces_near(files: Iterable[Path]) -> list[Path]:
    """The folders ``interfaces`` beside ``files``, or up to three folders above them.

    One is named from the current folder, as the file is, unless that has an absolute path.
    """
    folders = []
    for file in files:
        for parent in file.resolve().parents[: _ANCESTORS + 1]:
            candidate = parent / "interfaces"
            if candidate.is_dir() and any(candidate.glob("*/[msa]*/*")):
                is_absolute = file.is_absolute()
                folders.append(candidate if is_absolute else Path(os.path.relpath(candidate)))
                break
    return list(dict.fromkeys(folders))


def read_with_reference(
    path: Path, system: System, name: str, log: DiagnosticLog
) -> Machine | None:
    """Read the model in ``path`` as a replacement for the node ``name`` of ``system``.

    It takes the place of the node's model: it is called as that one is, and has the name, values and
    channels that the system file gives the node.
    """
    root = read_xml(path, log)
    if root is None:
        return None
    origin = system.origins.get(name)
    reference = system.node(name) if origin is None else origin.model
    machine = machine_of(root, log, system.library, reference, _channels(system.nodes))
    if machine is None:
        return None
    called = name if reference is None else reference.name
    if machine.name != called:
        machine = Instance(name=called, position=machine.position).of(machine, log)
    if origin is not None:
        machine = origin.instance.of(machine, log)
    return with_qualities(machine, system.qualities)


def read_machines(
    instances: Sequence[Instance], library: InterfaceLibrary, log: DiagnosticLog
) -> tuple[Machine, ...]:
    """All machines; plain ones last, when the channels of the others are known."""
    return tuple(machine for machine, _ in read_nodes(instances, library, log))


def read_nodes(
    instances: Sequence[Instance], library: InterfaceLibrary, log: DiagnosticLog
) -> list[tuple[Machine, Origin]]:
    """As :func:`read_machines`, each machine with what it was made of."""
    given: list[Instance] = []
    for instance in instances:
        other = next((other for other in given if instance.is_like(other)), None)
        if other is None:
            given.append(instance)
        elif instance.name and instance.is_stated:
            what = f"a second instance is called `{instance.name}`"
            hint = f"the first is {other.position}"
            log.error("duplicate-node", instance.position, instance.element, what, hint)
        else:
            what = "this model is listed twice"
            log.warning("duplicate-input", instance.position, instance.element, what)
    models = _read_files(given, library, log)
    origins = [Origin(models[one.path], one) for one in given if one.path in models]
    return [(one.instance.of(one.model, log), one) for one in origins]


def _read_files(
    instances: Sequence[Instance], library: InterfaceLibrary, log: DiagnosticLog
) -> dict[Path, Machine]:
    """The machines of the files of ``instances``, as they are written there."""
    machines: dict[Path, Machine] = {}
    plain: list[tuple[Path, Element]] = []
    for file in dict.fromkeys(one.path for one in instances):
        root = read_xml(file, log)
        if root is None:
            continue
        errors = DiagnosticLog()
        machine = machine_of(root, errors, library)
        if machine is not None and machine.dialect is Dialect.SCXML:
            plain.append((file, root))
            continue
        log.diagnostics += errors.diagnostics
        if machine is not None and not errors.has_errors:
            machines[file] = machine
    unsaid = DiagnosticLog()  # it is said of the machines that come of it
    made = [one.of(machines[one.path], unsaid) for one in instances if one.path in machines]
    channels = _channels((*machines.values(), *made))
    for file, root in plain:
        errors = DiagnosticLog()
        machine = machine_of(root, errors, library, None, channels)
        log.diagnostics += errors.diagnostics
        if machine is not None and not errors.has_errors:
            machines[file] = machine
    return machines


def _channels(machines: Iterable[Machine]) -> dict[str, str]:
    return {
        interface.channel: interface.type_name
        for machine in machines
        for interface in machine.interfaces
        if interface.channel and interface.type_name
    }
