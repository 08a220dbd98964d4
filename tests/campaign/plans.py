"""A plan: a whole system as plain data, and how it is written, read and compiled."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path

import msgspec

from m2c.check.reading import read_and_check
from m2c.model import DiagnosticLog
from m2c.model.system import System
from m2c.simulation.program import Program, compile_system
from moon.properties.files import read_properties
from moon.properties.files.interfaces import Interfaces
from moon.properties.property import Property
from tests.campaign.elements import Element, e
from tests.campaign.instances import instance, modelled

SYSTEM_FILE = "system.xml"
PROPERTY_FILE = "properties.yaml"
POLICY_FILE = "policy.xml"
STRUCTURE_FILE = "types.xml"
PACKAGE = "campaign_interfaces"
NAMESPACE = "http://www.w3.org/2005/07/scxml"


class Spelling(StrEnum):
    """How a model is written."""

    HL_SCXML = "scxml"
    ASCXML = "ascxml"
    PLAIN = "plain"


class Model(msgspec.Struct, frozen=True):
    """A machine; ``root`` has the tag ``scxml``, whatever the spelling."""

    name: str
    root: Element
    spelling: Spelling = Spelling.HL_SCXML
    is_plugin: bool = False

    @property
    def file(self) -> str:
        """Its path in the system's folder."""
        folder = "plugins" if self.is_plugin else "nodes"
        return f"{folder}/{self.name}.{'ascxml' if self.spelling is Spelling.ASCXML else 'scxml'}"


class Definition(msgspec.Struct, frozen=True):
    """An interface definition: ``msg/Reading`` and the text of its file."""

    name: str
    text: str


class Stated(msgspec.Struct, frozen=True):
    """A property as its file has it.

    Attributes:
        name: its id.
        body: everything else that is written of it.
        holds: True: true of every nominal run by construction; None: the trace decides.
    """

    name: str
    body: dict[str, object]
    holds: bool | None = None


class Plan(msgspec.Struct, frozen=True):
    """A system: machines, interfaces, tree, properties.

    Attributes:
        seed, size: what it was made from.
        models: nodes and plugins.
        definitions: of the package of interfaces.
        structures: ``<types>``, if it has some.
        policy: ``<root>`` of the behaviour tree, if it has one.
        tick_rate_hz: of the tree.
        ports: of the properties.
        properties: what is stated of it.
        qualities: ``<topic>`` elements of the system file's ``<qos>``.
        leaves: bindings of leaves of the tree.
        instances: whether its nodes are instances of models that have other names, data and channels.
    """

    seed: int
    size: int
    models: tuple[Model, ...]
    definitions: tuple[Definition, ...] = ()
    structures: Element | None = None
    policy: Element | None = None
    tick_rate_hz: float = 5.0
    ports: dict[str, dict[str, object]] = {}
    properties: tuple[Stated, ...] = ()
    qualities: tuple[Element, ...] = ()
    leaves: tuple[Element, ...] = ()
    instances: bool = False

    @property
    def name(self) -> str:
        """For people."""
        return f"system {self.seed} of size {self.size}"

    def has_instance(self, model: Model) -> bool:
        """Whether the node of ``model`` is an instance."""
        return self.instances and not model.is_plugin and model.spelling is not Spelling.PLAIN


class InvalidPlanError(ValueError):
    """``m2c check`` or moon finds errors in what was written."""


def write(plan: Plan, folder: Path) -> Path:
    """Write all of ``plan`` into ``folder``, which is made.

    Returns:
        The system file.
    """
    files = {SYSTEM_FILE: str(_system(plan))}
    for model in plan.models:
        files[model.file] = str(
            modelled(_root(model)) if plan.has_instance(model) else _root(model)
        )
    for definition in plan.definitions:
        kind = definition.name.partition("/")[0]
        files[f"interfaces/{PACKAGE}/{definition.name}.{kind}"] = definition.text
    if plan.structures is not None:
        files[STRUCTURE_FILE] = str(plan.structures)
    if plan.policy is not None:
        files[POLICY_FILE] = str(plan.policy)
    if plan.properties:
        files[PROPERTY_FILE] = _properties(plan)
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"{text}\n")
    return folder / SYSTEM_FILE


def _root(model: Model) -> Element:
    tag = "ascxml" if model.spelling is Spelling.ASCXML else "scxml"
    return msgspec.structs.replace(model.root, tag=tag)


def _system(plan: Plan) -> Element:
    def source(kind: str, path: str) -> Element:
        return e("input", type=kind, src=f"./{path}")

    parts = [e("parameters", e("bt_tick_rate", value=plan.tick_rate_hz))] if plan.policy else []
    plugins = [source("bt-plugin-ascxml", m.file) for m in plan.models if m.is_plugin]
    if plan.policy is not None:
        parts.append(e("behavior_tree", source("bt.cpp-xml", POLICY_FILE), *plugins, *plan.leaves))
    nodes = []
    for model in (model for model in plan.models if not model.is_plugin):
        node = source("node-ascxml", model.file)
        nodes.append(instance(model, node) if plan.has_instance(model) else node)
    parts.append(e("node_models", *nodes))
    if plan.structures is not None:
        parts.append(e("data_declarations", source("xml", STRUCTURE_FILE)))
    if plan.definitions:
        parts.append(e("interfaces", source("ros-interfaces", "interfaces")))
    if plan.qualities:
        parts.append(e("qos", *plan.qualities))
    return e("roaml", *parts)


def _properties(plan: Plan) -> str:
    """JSON is YAML; a property a line."""
    ports = [f"  {name}: {json.dumps(port)}" for name, port in plan.ports.items()]
    stated = [f"  - {json.dumps({'id': item.name, **item.body})}" for item in plan.properties]
    return "\n".join(["ports:", *ports, "properties:", *stated])


def read(path: Path) -> System:
    """The system in the file ``path``, as every command reads it.

    Raises:
        InvalidPlanError: there are errors.
    """
    log = DiagnosticLog()
    system = read_and_check([path], [], log)
    if system is None or log.has_errors:
        raise InvalidPlanError([str(item) for item in log.diagnostics if item.severity == "error"])
    return system


def stated(path: Path, system: System) -> list[Property]:
    """The properties beside the system file ``path``, held against its models.

    Raises:
        InvalidPlanError: there are errors.
    """
    file = path.parent / PROPERTY_FILE
    if not file.exists():
        return []
    log = DiagnosticLog()
    found = read_properties(file, log, Interfaces(system.library, system))
    if log.has_errors:
        raise InvalidPlanError([str(item) for item in log.diagnostics])
    return found


def compiled(system: System) -> Program:
    """Its generated code, imported."""
    return compile_system(system)
