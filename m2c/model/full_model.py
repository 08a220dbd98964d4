"""The earlier tool's full-model files (root ``specification``) and its interface list.

Two shapes are in use: ``skillList``/``componentList`` with declarations and definitions, and the
newer ``skills``/``components``/``plugins`` with one element each.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from m2c.model.diagnostics import DiagnosticLog
from m2c.model.system import System, library_for, read_machines, resolve
from m2c.model.typing import nearest
from m2c.model.xml import Element, read_xml

_CALL_KINDS = ("sync-service", "async-service", "topic", "action")


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
        nodes=read_machines(nodes, library, log),
        plugins=read_machines(plugins, library, log),
        policy=policy,
        library=library,
        sources=(path, *nodes, *plugins, *([policy] if policy else [])),
    )


def read_interface_list(path: Path, log: DiagnosticLog) -> dict[str, dict[str, str]]:
    """Interface id → function id → kind (``sync-service``, ``topic``…) of an INTERFACES.xml."""
    root = read_xml(path, log)
    found: dict[str, dict[str, str]] = {}
    for interface in root.all("interface") if root is not None else ():
        functions = found.setdefault(interface.get("id"), {})
        for function in interface.all("function"):
            protocol = function.first("protocol")
            data = protocol.first("ROS2data") if protocol is not None else None
            kind = data.first("interface") if data is not None else None
            functions[function.get("id")] = kind.get("type") if kind is not None else ""
            if kind is not None and kind.get("type") not in _CALL_KINDS:
                what = f"unknown kind `{kind.get('type')}`"
                hint = nearest(kind.get("type"), _CALL_KINDS)
                log.error("bad-interface", kind.position, "interface", what, hint)
    return found


def cross_check(system: System, declared: dict[str, dict[str, str]], log: DiagnosticLog) -> None:
    """Warn of every channel that a node uses and the interface list does not declare."""
    functions = {name for group in declared.values() for name in group}
    for node in system.nodes:
        for interface in node.interfaces:
            last = (interface.channel or "").rpartition("/")[2]
            if not interface.type_name or last in functions or last in ("tick", "halt"):
                continue
            log.warning(
                "undeclared-function",
                interface.position,
                "",
                f"{node.name} uses {interface.channel}, which the interface list does not declare",
                nearest(last, functions),
            )


def _walk(element: Element) -> list[Element]:
    found = []
    for child in element.children:
        found += [child, *_walk(child)]
    return found
