"""Reading a system: from its file, from models, or from the earlier tool's full-model file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import msgspec

from m2c.diagnostics import DiagnosticLog, Position
from m2c.model.clock import clock_for
from m2c.model.deployment import Process, names_in_deployment, read_deployment
from m2c.model.events import link_events
from m2c.model.full_model import read_full_model
from m2c.model.inputs import resolve
from m2c.model.instances import FILE, INPUT, Instance, as_they_are, read_instance
from m2c.model.leaf_bindings import LEAF, read_leaf
from m2c.model.parameters import (
    read_parameters,
)
from m2c.model.paths import entries_below, meant, why_no_file
from m2c.model.qualities import (
    TopicQuality,
    read_qualities,
    report_unknown_topics,
    with_qualities,
)
from m2c.model.structs import declare_structures
from m2c.model.structure import check_attributes, note_read_as
from m2c.model.system import (
    MODEL_SUFFIXES,
    POLICY_ROOT,
    SYSTEM_ROOT,
    SYSTEM_ROOTS,
    System,
    is_model,
    library_for,
    read_machines,
    read_nodes,
)
from m2c.model.xml import Element, read_xml
from m2c.suggestions import nearest

# the first is the current name of its kind; the others are older, and read as it
_NODE_TYPES = ("node-ascxml", "ros-ascxml", "ros-scxml", "scxml", "ascxml")
_PLUGIN_TYPES = ("bt-plugin-ascxml", "bt-plugin-ros-ascxml", "bt-plugin-ros-scxml")
_MODEL_TYPES = (*_NODE_TYPES, *_PLUGIN_TYPES)
_STRUCTURE_TYPES = ("xml", "json")
_SECTIONS = (
    "mc_parameters",  # older, and read as the next one
    "parameters",
    "behavior_tree",
    "node_models",
    "data_declarations",
    "interfaces",
    "qos",
    "deployment",
    "properties",
)
_IGNORED = {
    "properties": "properties are checked by moon, not by m2c",
    "generated_files": "",
}


def current_input_type(written: str) -> str:
    """The newest name of the input type ``written``; itself if there is no other."""
    kind = next((names for names in (_NODE_TYPES, _PLUGIN_TYPES) if written in names), (written,))
    return kind[0]


def load(
    paths: Sequence[Path], log: DiagnosticLog, interface_directories: Sequence[Path] = ()
) -> System | None:
    """Read models, folders of models or one system file as one system.

    Args:
        paths: ``.scxml``/``.ascxml`` files, ``.xml`` files with such a root, folders, or one system file
            (root ``convince_mc_tc``, ``roaml`` or ``specification``).
        log: where every fault goes.
        interface_directories: where ``.msg``/``.srv``/``.action`` files are. They come before the folders
            that the system file names, and those before a folder ``interfaces`` beside a model or up to
            three folders above it: a type is taken from the first that has it.

    Returns:
        The system, or None if nothing usable was read. Errors in single models leave the others.
    """
    files: list[Path] = []
    for path in paths:
        files += _models_in(path, log) if os.path.isdir(path) else [path]
    files = [file for file in files if _is_file(file, log)]
    systems = [path for path in files if not is_model(path)]
    if systems:
        if len(files) > 1:
            what = "a system file is read alone"
            log.error("mixed-input", Position(str(systems[0])), "", what, "give one path")
            return None
        return read_system(systems[0], log, interface_directories)
    if not files:
        return None
    library = library_for(files, interface_directories, log)
    nodes = read_machines(as_they_are(files), library, log)
    first = next(path for path in paths if os.path.exists(path))
    name = files[0].stem if len(files) == 1 else first.resolve().stem
    sources = tuple(files)
    system = System(name=name, path=paths[0], nodes=nodes, library=library, sources=sources)
    return linked(system, log)


def linked(system: System, log: DiagnosticLog) -> System:
    """``system`` with the plain events between its machines as messages, and its topics' qualities.

    Where ``log`` has errors a machine may be missing: no event is said to concern others then. A system
    that was linked may be given again, when a machine in it was replaced.
    """
    machines = (*system.nodes, *system.plugins)
    if not log.has_errors:
        machines = link_events(machines, system.library, log)
    machines = tuple(with_qualities(machine, system.qualities) for machine in machines)
    count = len(system.nodes)
    return msgspec.structs.replace(system, nodes=machines[:count], plugins=machines[count:])


def _models_in(folder: Path, log: DiagnosticLog) -> list[Path]:
    try:
        found = list(filter(is_model, entries_below(folder)))
    except OSError as error:
        what = f"this folder {error.strerror}"
        log.error("unreadable-file", Position(str(folder)), "", what)
        return []
    if not found:
        hint = f"a model ends in {' or '.join(MODEL_SUFFIXES)}"
        log.error("no-models", Position(str(folder)), "", "no model in this folder", hint)
    return found


def _is_file(path: Path, log: DiagnosticLog) -> bool:
    why = why_no_file(path)
    if why:
        what = f"cannot read the file: {why}"
        log.error("unreadable-file", Position(str(path)), "", what, meant(path))
    return not why


def read_system(
    path: Path, log: DiagnosticLog, interface_directories: Sequence[Path] = ()
) -> System | None:
    """Read the system file at ``path``; None if it is not one."""
    root = read_xml(path, log)
    if root is None:
        return None
    if root.tag == "specification":
        full = read_full_model(root, path, log, interface_directories)
        return None if full is None else linked(full, log)
    if root.tag == POLICY_ROOT:
        what = "a policy alone, without the system that it belongs to"
        hint = "give the system file that names it; `m2c check` and `m2c draw` take it alone, too"
        log.error("unknown-tag", root.position, root.tag, what, hint)
        return None
    if root.tag not in SYSTEM_ROOTS:
        log.error(
            "unknown-tag",
            root.position,
            root.tag,
            "neither a model nor a system file",
            f"the root of a system file is one of {', '.join(SYSTEM_ROOTS)}, specification",
        )
        return None
    system = linked(_SystemReader(path, log).read(root, interface_directories), log)
    if not log.has_errors:  # else a model may be missing here
        report_unknown_topics(system.qualities, (*system.nodes, *system.plugins), log)
    return system


class _SystemReader:
    def __init__(self, path: Path, log: DiagnosticLog) -> None:
        self._path = path
        self._log = log
        self._nodes: list[Instance] = []
        self._plugins: list[Instance] = []
        self._interfaces: list[Path] = []
        self._absent: list[Path] = []
        self._policy: Path | None = None
        self._leaves: list[Element] = []
        self._qualities: list[TopicQuality] = []
        self._names_any = False
        self._structures: list[tuple[Path, str]] = []
        self._lacks_structures = False
        self._parameters: list[Element] = []
        self._deployment: Element | None = None

    def read(self, root: Element, interface_directories: Sequence[Path]) -> System:
        self._note(root, root.tag, SYSTEM_ROOT)
        check_attributes(root, (), self._log)
        for child in root.children:
            if child.tag in _SECTIONS and child.tag not in _IGNORED:
                check_attributes(child, (), self._log)
            match child.tag:
                case "mc_parameters" | "parameters":
                    self._note(child, child.tag, "parameters")
                    self._parameters += child.children
                case "behavior_tree":
                    self._tree(child)
                case "node_models":
                    self._nodes += self._instances(child, _NODE_TYPES)
                case "data_declarations":
                    self._declarations(child)
                case "interfaces":
                    folders = self._inputs(child, ("ros-interfaces",), wants_folder=True)
                    self._interfaces += [folder for folder, _ in folders]
                case "qos":
                    self._qualities += read_qualities(child, self._log)
                case "deployment":
                    self._note_deployment(child)
                case tag if tag in _IGNORED:
                    self._log.note(
                        "ignored-element", child.position, tag, _IGNORED[tag] or "ignored"
                    )
                case tag:
                    hint = nearest(tag, _SECTIONS[1:])
                    what = f"not an element of <{root.tag}>"
                    self._log.error("unknown-tag", child.position, tag, what, hint)
        parameters = read_parameters(self._parameters, self._log)
        if not self._names_any and not self._log.has_errors:
            hint = 'name them: <node_models><input type="ros-scxml" src="…"/></node_models>'
            self._log.error("no-models", root.position, root.tag, "no model in this system", hint)
        models = list(dict.fromkeys(one.path for one in (*self._nodes, *self._plugins)))
        library = library_for(models, [*interface_directories, *self._interfaces], self._log)
        declared = DiagnosticLog()
        declare_structures(self._structures, library, declared)
        self._log.diagnostics += declared.diagnostics
        library.lacks_structures = self._lacks_structures or declared.has_errors
        structures = [file for file, _ in self._structures]
        sources = [self._path, *models, *structures, *([self._policy] if self._policy else [])]
        stem = self._path.stem
        folder = self._path.resolve().parent.name
        made = read_nodes(self._nodes, library, self._log)
        nodes = tuple(machine for machine, _ in made)
        plugins = read_machines(self._plugins, library, self._log)
        bound = [read_leaf(leaf, library, self._log) for leaf in self._leaves]
        plugins += tuple(leaf for leaf in bound if leaf is not None)
        if not self._log.has_errors:  # else a model may be missing here
            clock = clock_for((*nodes, *plugins), library, self._log)
            nodes = nodes if clock is None else (*nodes, clock)
        deployment: tuple[Process, ...] = ()
        if self._deployment is not None and not self._log.has_errors:
            names = names_in_deployment(nodes, self._policy is not None)
            deployment = read_deployment(self._deployment, names, self._log)
        return System(
            name=folder if stem in ("system", "main") else stem,
            path=self._path,
            nodes=nodes,
            plugins=plugins,
            policy=self._policy,
            tick_rate_hz=parameters.tick_rate_hz,
            tick_if_not_running=parameters.tick_if_not_running,
            max_time_s=parameters.max_time_s,
            max_array_size=parameters.max_array_size,
            library=library,
            sources=(*sources, *self._absent),
            qualities=tuple(self._qualities),
            deployment=deployment,
            origins={machine.name: origin for machine, origin in made},
        )

    def _note(self, element: Element, written: str, current: str, attribute: str = "") -> None:
        if written != current:
            note_read_as(element.at(attribute), element.tag, written, f"`{current}`", self._log)

    def _note_deployment(self, element: Element) -> None:
        if self._deployment is not None:
            hint = f"the first is at {self._deployment.position}"
            what = "two deployments"
            self._log.error("bad-deployment", element.position, element.tag, what, hint)
        else:
            self._deployment = element

    def _tree(self, element: Element) -> None:
        self._leaves += element.all(LEAF)
        policies = self._inputs(element, ("bt.cpp-xml",), others=_PLUGIN_TYPES)
        self._plugins += self._instances(element, _PLUGIN_TYPES, others=None)  # reported above
        if len(policies) > 1:
            what = f"{len(policies)} behaviour trees"
            self._log.error("duplicate-policy", element.position, element.tag, what, "give one")
        self._policy = policies[0][0] if policies else self._policy

    def _declarations(self, element: Element) -> None:
        named = len(self._structures)
        for kind in _STRUCTURE_TYPES:
            others = _STRUCTURE_TYPES if kind == _STRUCTURE_TYPES[0] else None  # reported once
            files = self._inputs(element, (kind,), others=others)
            self._structures += [(file, kind) for file, _ in files]
        is_whole = len(self._structures) - named == len(element.children)
        self._lacks_structures = self._lacks_structures or not is_whole

    def _inputs(
        self,
        element: Element,
        types: Sequence[str],
        others: Sequence[str] | None = (),
        *,
        wants_folder: bool = False,
    ) -> list[tuple[Path, Element]]:
        """The files, or with ``wants_folder`` the folders, of one of ``types``, and what names each.

        ``others`` may stand there too (None: anything may).
        """
        found = []
        for child in element.children:
            self._names_any = self._names_any or element.tag in ("behavior_tree", "node_models")
            kind = child.get("type")
            if child.tag == LEAF and element.tag == "behavior_tree":
                continue  # read when the types of interfaces are known
            if child.tag != "input" or kind not in types:
                if others is not None and (child.tag != "input" or kind not in others):
                    self._report_input(child, element.tag, (*types, *others))
                continue
            check_attributes(child, INPUT if kind in _MODEL_TYPES else FILE, self._log)
            path = resolve(
                self._path.parent, child.get("src"), child, self._log, wants_folder=wants_folder
            )
            if path is not None:
                self._note(child, kind, current_input_type(kind), "type")
                found.append((path, child))
            elif child.get("src"):
                self._absent.append(self._path.parent / child.get("src"))
        return found

    def _instances(
        self, element: Element, types: Sequence[str], others: Sequence[str] | None = ()
    ) -> list[Instance]:
        found = self._inputs(element, types, others)
        return [read_instance(path, child, self._log) for path, child in found]

    def _report_input(self, child: Element, parent: str, types: Sequence[str]) -> None:
        if child.tag != "input":
            what, hint = f"not an element of <{parent}>", "use <input>"
        else:
            kind = child.get("type")
            what, hint = f"unknown input type `{kind}`", nearest(kind, types)
        self._log.error("unknown-tag", child.position, child.tag, what, hint)
