"""A whole system: node models, behaviour-tree policy and plugins, tick rate, interface types."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from pathlib import Path

import msgspec

from m2c.model.diagnostics import Diagnostic, DiagnosticLog, Position, shortened
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import Dialect, Machine
from m2c.model.paths import entries_below, meant, why_no_file, why_no_folder
from m2c.model.qualities import (
    TopicQuality,
    read_qualities,
    report_unknown_topics,
    with_qualities,
)
from m2c.model.reader import machine_of
from m2c.model.structure import note_read_as, number
from m2c.model.typing import nearest
from m2c.model.xml import Element, read_xml

DEFAULT_TICK_RATE_HZ = 1.0
MODEL_SUFFIXES = (".scxml", ".ascxml")
POLICY_ROOT = "root"
SYSTEM_ROOT = "roaml"
SYSTEM_ROOTS = ("convince_mc_tc", SYSTEM_ROOT)
_MAX_SHOWN = 200
"""Characters of a path that a message repeats."""
_ANCESTORS = 3
"""How many folders above a model an ``interfaces`` folder is looked for."""

# the first is the current name of its kind; the others are older, and read as it
_NODE_TYPES = ("ros-ascxml", "ros-scxml", "scxml", "ascxml")
_PLUGIN_TYPES = ("bt-plugin-ros-ascxml", "bt-plugin-ros-scxml")
_IGNORED = {
    "properties": "properties are checked by moon, not by m2c",
    "generated_files": "",
}


def current_input_type(written: str) -> str:
    """The newest name of the input type ``written``; itself if there is no other."""
    kind = next((names for names in (_NODE_TYPES, _PLUGIN_TYPES) if written in names), (written,))
    return kind[0]


class System(msgspec.Struct, frozen=True, kw_only=True):
    """What is generated and run together.

    Attributes:
        name: of the system file or folder, or of the only model.
        path: where it was read from.
        nodes: one machine per process.
        plugins: behaviour-tree plugins, by machine name the leaf's ID.
        policy: the behaviour tree's XML file, if there is one.
        tick_rate_hz: how often the tree is ticked.
        library: the interface types that the models use.
        sources: every file that was read, models and policy.
        qualities: what is asked of the middleware for single topics; the machines have it too.
        findings: what its reader found, where that was asked for (:func:`m2c.read_system`).
    """

    name: str
    path: Path
    nodes: tuple[Machine, ...]
    plugins: tuple[Machine, ...] = ()
    policy: Path | None = None
    tick_rate_hz: float = DEFAULT_TICK_RATE_HZ
    library: InterfaceLibrary
    sources: tuple[Path, ...] = ()
    qualities: tuple[TopicQuality, ...] = ()
    findings: tuple[Diagnostic, ...] = ()

    def node(self, name: str) -> Machine | None:
        """The node called ``name``."""
        return next((node for node in self.nodes if node.name == name), None)


def load(
    paths: Sequence[Path], log: DiagnosticLog, interface_directories: Sequence[Path] = ()
) -> System | None:
    """Read models, folders of models or one system file as one system.

    Args:
        paths: ``.scxml``/``.ascxml`` files, folders, or one system file (root ``convince_mc_tc``,
            ``roaml`` or ``specification``).
        log: where every fault goes.
        interface_directories: where ``.msg``/``.srv``/``.action`` files are; in addition, a folder
            ``interfaces`` beside a model or up to three folders above it is used.

    Returns:
        The system, or None if nothing usable was read. Errors in single models leave the others.
    """
    files: list[Path] = []
    for path in paths:
        files += _models_in(path, log) if os.path.isdir(path) else [path]
    files = [file for file in files if _is_file(file, log)]
    systems = [path for path in files if path.suffix not in MODEL_SUFFIXES]
    if systems:
        if len(files) > 1:
            what = "a system file is read alone"
            log.error("mixed-input", Position(str(systems[0])), "", what, "give one path")
            return None
        return read_system(systems[0], log, interface_directories)
    if not files:
        return None
    library = library_for(files, interface_directories, log)
    nodes = read_machines(files, library, log)
    first = next(path for path in paths if os.path.exists(path))
    name = files[0].stem if len(files) == 1 else first.resolve().stem
    sources = tuple(files)
    return System(name=name, path=paths[0], nodes=nodes, library=library, sources=sources)


def _models_in(folder: Path, log: DiagnosticLog) -> list[Path]:
    try:
        found = [item for item in entries_below(folder) if item.suffix in MODEL_SUFFIXES]
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
        from m2c.model.full_model import read_full_model

        return read_full_model(root, path, log, interface_directories)
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
    return _SystemReader(path, log).read(root, interface_directories)


class _SystemReader:
    def __init__(self, path: Path, log: DiagnosticLog) -> None:
        self._path = path
        self._log = log
        self._nodes: list[Path] = []
        self._plugins: list[Path] = []
        self._interfaces: list[Path] = []
        self._policy: Path | None = None
        self._qualities: list[TopicQuality] = []
        self._names_any = False
        self._rate = DEFAULT_TICK_RATE_HZ

    def read(self, root: Element, interface_directories: Sequence[Path]) -> System:
        self._note(root, root.tag, SYSTEM_ROOT)
        for child in root.children:
            match child.tag:
                case "mc_parameters" | "parameters":
                    self._note(child, child.tag, "parameters")
                    self._parameters(child)
                case "behavior_tree":
                    self._tree(child)
                case "node_models":
                    self._nodes += self._inputs(child, _NODE_TYPES)
                case "interfaces":
                    self._interfaces += self._inputs(child, ("ros-interfaces",), wants_folder=True)
                case "qos":
                    self._qualities += read_qualities(child, self._log)
                case tag if tag in _IGNORED:
                    self._log.note(
                        "ignored-element", child.position, tag, _IGNORED[tag] or "ignored"
                    )
                case tag:
                    known = (
                        "parameters",
                        "behavior_tree",
                        "node_models",
                        "interfaces",
                        "qos",
                        "properties",
                    )
                    what = f"not an element of <{root.tag}>"
                    self._log.error("unknown-tag", child.position, tag, what, nearest(tag, known))
        if not self._names_any and not self._log.has_errors:
            hint = 'name them: <node_models><input type="ros-scxml" src="…"/></node_models>'
            self._log.error("no-models", root.position, root.tag, "no model in this system", hint)
        models = [*self._nodes, *self._plugins]
        library = library_for(models, [*interface_directories, *self._interfaces], self._log)
        sources = [self._path, *models, *([self._policy] if self._policy else [])]
        stem = self._path.stem
        folder = self._path.resolve().parent.name
        nodes = read_machines(self._nodes, library, self._log)
        plugins = read_machines(self._plugins, library, self._log)
        if not self._log.has_errors:  # else a model may be missing here
            report_unknown_topics(self._qualities, (*nodes, *plugins), self._log)
        return System(
            name=folder if stem in ("system", "main") else stem,
            path=self._path,
            nodes=tuple(with_qualities(node, self._qualities) for node in nodes),
            plugins=tuple(with_qualities(plugin, self._qualities) for plugin in plugins),
            policy=self._policy,
            tick_rate_hz=self._rate,
            library=library,
            sources=tuple(sources),
            qualities=tuple(self._qualities),
        )

    def _note(self, element: Element, written: str, current: str, attribute: str = "") -> None:
        if written != current:
            note_read_as(element.at(attribute), element.tag, written, f"`{current}`", self._log)

    def _parameters(self, element: Element) -> None:
        for child in element.all("bt_tick_rate"):
            rate = number(child.get("value"))
            if rate is None or rate <= 0:
                self._log.error(
                    "bad-rate",
                    child.at("value"),
                    child.tag,
                    f"`{child.get('value')}` is not a rate",
                    "ticks a second, greater than 0",
                )
            else:
                self._rate = rate

    def _tree(self, element: Element) -> None:
        policies = self._inputs(element, ("bt.cpp-xml",), others=_PLUGIN_TYPES)
        self._plugins += self._inputs(element, _PLUGIN_TYPES, others=None)  # reported above
        if len(policies) > 1:
            what = f"{len(policies)} behaviour trees"
            self._log.error("duplicate-policy", element.position, element.tag, what, "give one")
        self._policy = policies[0] if policies else self._policy

    def _inputs(
        self,
        element: Element,
        types: Sequence[str],
        others: Sequence[str] | None = (),
        *,
        wants_folder: bool = False,
    ) -> list[Path]:
        """The files, or with ``wants_folder`` the folders, of one of ``types``.

        ``others`` may stand there too (None: anything may).
        """
        found: list[Path] = []
        for child in element.children:
            self._names_any = self._names_any or not wants_folder
            kind = child.get("type")
            if child.tag != "input" or kind not in types:
                if others is not None and (child.tag != "input" or kind not in others):
                    self._report_input(child, element.tag, (*types, *others))
                continue
            path = resolve(
                self._path.parent, child.get("src"), child, self._log, wants_folder=wants_folder
            )
            if types is _NODE_TYPES and path in (*found, *self._nodes):
                what = "this model is listed twice"
                self._log.warning("duplicate-input", child.at("src"), child.tag, what)
            elif path is not None:
                self._note(child, kind, current_input_type(kind), "type")
                found.append(path)
        return found

    def _report_input(self, child: Element, parent: str, types: Sequence[str]) -> None:
        if child.tag != "input":
            what, hint = f"not an element of <{parent}>", "use <input>"
        else:
            kind = child.get("type")
            what, hint = f"unknown input type `{kind}`", nearest(kind, types)
        self._log.error("unknown-tag", child.position, child.tag, what, hint)


def resolve(
    folder: Path, source: str, element: Element, log: DiagnosticLog, *, wants_folder: bool = False
) -> Path | None:
    """The file ``source``, or with ``wants_folder`` the folder, relative to ``folder``.

    A path that differs from an existing one only by case is accepted with a warning: published
    systems were written on file systems that do not tell them apart.
    """
    at = element.at("src" if "src" in element.attributes else "path")
    if not source:
        what = "the attribute `src` is missing"
        log.error("missing-attribute", element.position, element.tag, what)
        return None
    path: Path | None = folder / source
    try:
        (folder / source).stat()
    except (FileNotFoundError, NotADirectoryError):
        path = _in_another_case(folder, source, element, at, log)
    except (OSError, ValueError):
        pass  # told below: a loop of links, a name that is too long
    if path is None:
        return None
    why = why_no_folder(path) if wants_folder else why_no_file(path)
    if why and wants_folder:
        log.error("missing-file", at, element.tag, f"this interface folder {why}")
    elif why:
        log.error("unreadable-file", at, element.tag, f"cannot read the file: {why}")
    return None if why else path


def _in_another_case(
    folder: Path, source: str, element: Element, at: Position, log: DiagnosticLog
) -> Path | None:
    current = folder
    for part in Path(source).parts:
        exact = current / part
        if part == ".." or os.path.exists(exact):
            current = exact
            continue
        near = [item for item in _entries(current) if item.name.lower() == part.lower()]
        if len(near) != 1:
            hint = meant(folder / source).replace(f"{folder}{os.sep}", "")
            hint = hint or nearest(part, (item.name for item in _entries(current)))
            what = f"{shortened(str(folder / source), _MAX_SHOWN)} does not exist"
            log.error("missing-file", at, element.tag, what, hint)
            return None
        current = near[0]
    log.warning(
        "path-case",
        at,
        element.tag,
        f"`{source}` is written {current} on disk",
        "use the same case",
    )
    return current


def _entries(folder: Path) -> Iterable[Path]:
    try:
        return list(folder.iterdir())
    except OSError:  # none, or not ours to look into
        return ()


def library_for(
    files: Sequence[Path], directories: Sequence[Path], log: DiagnosticLog
) -> InterfaceLibrary:
    """The interface types for ``files``: ``directories``, and ``interfaces`` folders near them."""
    folders = [*directories, *interfaces_near(files)]
    usable = []
    for folder in dict.fromkeys(folders):
        if os.path.isdir(folder):
            usable.append(folder.resolve())
        else:
            missing = "is not a folder" if os.path.exists(folder) else "does not exist"
            what = f"this interface folder {missing}"
            log.error("missing-file", Position(str(folder)), "", what, meant(folder))
    return InterfaceLibrary.load(list(dict.fromkeys(usable)), log)


def interfaces_near(files: Iterable[Path]) -> list[Path]:
    """The folders ``interfaces`` beside ``files``, or up to three folders above them."""
    folders = []
    for file in files:
        for parent in file.resolve().parents[: _ANCESTORS + 1]:
            candidate = parent / "interfaces"
            if candidate.is_dir() and any(candidate.glob("*/[msa]*/*")):
                folders.append(candidate)
                break
    return list(dict.fromkeys(folders))


def read_with_reference(
    path: Path, system: System, name: str, log: DiagnosticLog
) -> Machine | None:
    """Read the model in ``path`` as a replacement for the node ``name`` of ``system``."""
    root = read_xml(path, log)
    if root is None:
        return None
    reference = system.node(name)
    machine = machine_of(root, log, system.library, reference, _channels(system.nodes))
    if machine is None:
        return None
    return with_qualities(msgspec.structs.replace(machine, name=name), system.qualities)


def read_machines(
    files: Sequence[Path], library: InterfaceLibrary, log: DiagnosticLog
) -> tuple[Machine, ...]:
    """All machines; plain ones last, when the channels of the others are known."""
    machines: dict[Path, Machine] = {}
    plain: list[tuple[Path, Element]] = []
    seen: set[Path] = set()
    for file in files:
        if file in seen:
            log.warning("duplicate-input", Position(str(file)), "", "this model is listed twice")
            continue
        seen.add(file)
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
    channels = _channels(machines.values())
    for file, root in plain:
        errors = DiagnosticLog()
        machine = machine_of(root, errors, library, None, channels)
        log.diagnostics += errors.diagnostics
        if machine is not None and not errors.has_errors:
            machines[file] = machine
    return tuple(machines[file] for file in dict.fromkeys(files) if file in machines)


def _channels(machines: Iterable[Machine]) -> dict[str, str]:
    return {
        interface.channel: interface.type_name
        for machine in machines
        for interface in machine.interfaces
        if interface.channel and interface.type_name
    }
