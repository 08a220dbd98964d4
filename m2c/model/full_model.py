"""The earlier tool's full-model files (root ``specification``) and its interface list.

Two shapes are in use: ``skillList``/``componentList`` with declarations and definitions, and the
newer ``skills``/``components``/``plugins`` with one element each.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from m2c.diagnostics import DiagnosticLog
from m2c.model.inputs import resolve
from m2c.model.instances import as_they_are
from m2c.model.machine import InterfaceKind
from m2c.model.structure import require
from m2c.model.system import System, library_for, read_machines
from m2c.model.xml import Element, read_xml
from m2c.suggestions import nearest

_CALL_KINDS = {
    "sync-service": "service",
    "async-service": "service",
    "topic": "topic",
    "action": "action",
}
_USES = {
    InterfaceKind.PUBLISHER: "topic",
    InterfaceKind.SUBSCRIBER: "topic",
    InterfaceKind.SERVER: "service",
    InterfaceKind.CLIENT: "service",
    InterfaceKind.ACTION_SERVER: "action",
    InterfaceKind.ACTION_CLIENT: "action",
}
_A = {"topic": "a topic", "service": "a service", "action": "an action"}


def read_full_model(
    root: Element, path: Path, log: DiagnosticLog, interface_directories: Sequence[Path] = ()
) -> System | None:
    """The system that a ``specification`` describes; declarations without a model are skipped."""
    model = root.first("model")
    if model is None:
        log.error("missing-element", root.position, root.tag, "<model> is missing")
        return None
    nodes: list[Path] = []
    plugins: list[Path] = []
    policy: Path | None = None
    for element in _walk(model):
        definition = element.first("skillDefinition") or element.first("componentDefinition")
        holder = definition if definition is not None else element
        kind, source = holder.get("moc"), holder.get("path")
        if not source or element.tag in ("interfaces", "skillDefinition", "componentDefinition"):
            continue
        found = resolve(path.parent, source, holder, log)
        if found is None:
            continue
        if kind == "bt":
            policy = found
        elif element.tag == "plugin":
            plugins.append(found)
        elif kind == "fsm":
            nodes.append(found)
    library = library_for([*nodes, *plugins], interface_directories, log)
    return System(
        name=path.stem,
        path=path,
        nodes=read_machines(as_they_are(nodes), library, log),
        plugins=read_machines(as_they_are(plugins), library, log),
        policy=policy,
        library=library,
        sources=(path, *nodes, *plugins, *([policy] if policy else [])),
    )


def read_interface_list(path: Path, log: DiagnosticLog) -> dict[str, dict[str, str]]:
    """Interface id → function id → kind (``sync-service``, ``topic``…) of an INTERFACES.xml.

    A function whose kind the list does not say has the kind "".
    """
    root = read_xml(path, log)
    found: dict[str, dict[str, str]] = {}
    if root is not None and root.tag != "interfaces":
        what = "not an interface list"
        log.error("unknown-tag", root.position, root.tag, what, "its root is <interfaces>")
        return found
    for interface in root.all("interface") if root is not None else ():
        functions = found.setdefault(require(interface, "id", log), {})
        for function in interface.all("function"):
            protocol = function.first("protocol")
            data = protocol.first("ROS2data") if protocol is not None else None
            kind = data.first("interface") if data is not None else None
            functions[require(function, "id", log)] = kind.get("type") if kind is not None else ""
            if kind is not None and kind.get("type") not in _CALL_KINDS:
                what = f"unknown kind `{kind.get('type')}`"
                hint = nearest(kind.get("type"), _CALL_KINDS)
                log.error("bad-interface", kind.at("type"), "interface", what, hint)
    return found


def cross_check(system: System, declared: dict[str, dict[str, str]], log: DiagnosticLog) -> None:
    """Warn where models, full model and interface list say different things.

    Rules, all warnings: ``undeclared-function`` (a node uses a channel that the list does not have),
    ``function-kind`` (it uses a topic as a service, say), ``undeclared-list-entry`` (the full model
    names an interface that the list does not have).
    """
    if not declared:  # an empty list, or one whose faults are reported
        return
    for element in _referring(system.path):
        if element.get("interface") not in declared:
            what = f"the interface list does not declare `{element.get('interface')}`"
            hint = nearest(element.get("interface"), declared)
            log.warning("undeclared-list-entry", element.at("interface"), element.tag, what, hint)
    kinds: dict[str, set[str]] = {}
    for functions in declared.values():
        for name, kind in functions.items():
            kinds.setdefault(name, set()).add(_CALL_KINDS.get(kind, ""))
    for node in system.nodes:
        for interface in node.interfaces:
            last = (interface.channel or "").rpartition("/")[2]
            if not interface.type_name or last in ("tick", "halt"):
                continue
            used = _USES[interface.kind]
            if last not in kinds:
                log.warning(
                    "undeclared-function",
                    interface.position,
                    "",
                    f"{node.name} uses {interface.channel}, which the interface list does not declare",
                    nearest(last, kinds),
                )
            elif not {used, ""} & kinds[last]:
                log.warning(
                    "function-kind",
                    interface.position,
                    "",
                    f"{node.name} uses {interface.channel} as {_A[used]}",
                    f"the interface list declares {last} as {_A[min(kinds[last])]}",
                )


def _referring(path: Path) -> list[Element]:
    """The elements of the full model at ``path`` that name an entry of the interface list."""
    root = read_xml(path, DiagnosticLog()) if path.is_file() else None  # its faults are reported
    if root is None or root.tag != "specification":
        return []
    return [
        element
        for element in _walk(root)
        if element.tag in ("skillDeclaration", "componentDeclaration") and element.get("interface")
    ]


def _walk(element: Element) -> list[Element]:
    found = []
    for child in element.children:
        found += [child, *_walk(child)]
    return found
