"""``<deployment>``: which nodes of a system share a process, on which host it runs, and how urgent it is."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import Protocol

import msgspec

from m2c.diagnostics import DiagnosticLog
from m2c.model.structure import check_attributes, require
from m2c.model.xml import Element, read_xml
from m2c.suggestions import first_of, nearest

POLICY = "policy"
"""What the policy is called where nodes are named."""
ROOT = "deployment"
_ATTRIBUTES = {"process": ("name", "host", "priority"), "node": ("name",)}
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,62}")
"""Of a process and a host: it becomes the name of files, units and certificates."""
_PRIORITIES = range(-20, 20)
"""Nice values (setpriority(2)): the lower, the more urgent."""


class Process(msgspec.Struct, frozen=True, kw_only=True):
    """One process of a system.

    Attributes:
        name: of the process.
        nodes: the nodes that share it, in the order of the file; the policy is called ``policy``.
        host: where it runs; empty if the deployment does not say.
        priority: its nice value, -20 (most urgent) to 19; None leaves it as it is.
    """

    name: str
    nodes: tuple[str, ...]
    host: str = ""
    priority: int | None = None


def hosts_of(processes: Sequence[Process]) -> list[str]:
    """The hosts that ``processes`` run on, in the order of the file."""
    return list(dict.fromkeys(process.host for process in processes if process.host))


class _Node(Protocol):
    @property
    def name(self) -> str: ...


def names_in_deployment(nodes: Iterable[_Node], has_policy: bool) -> list[str]:
    """Who has a process: each node, and the policy if there is one."""
    return [*(node.name for node in nodes), *([POLICY] if has_policy else [])]


def read_deployment_file(
    path: Path, names: Sequence[str], log: DiagnosticLog
) -> tuple[Process, ...]:
    """What the file at ``path`` says, whose root is ``<deployment>``; see :func:`read_deployment`."""
    root = read_xml(path, log)
    if root is None:
        return ()
    if root.tag != ROOT:
        what, hint = "not a deployment", f"the root is <{ROOT}>"
        log.error("unknown-tag", root.position, root.tag, what, hint)
        return ()
    return read_deployment(root, names, log)


def read_deployment(
    element: Element, names: Sequence[str], log: DiagnosticLog
) -> tuple[Process, ...]:
    """The processes that ``element`` describes.

    Args:
        element: ``<deployment>``.
        names: of all nodes of the system, and ``policy`` if it has one: each has one process.
        log: where ``unknown-tag``, ``unknown-attribute``, ``missing-attribute`` and ``bad-deployment`` go.
    """
    found: list[Process] = []
    written: list[Element] = []
    first: dict[str, Element] = {}
    for child in element.children:
        if not _is_known(child, ROOT, "process", log):
            continue
        name = _named(child, "name", log)
        if name in {process.name for process in found}:
            log.error(
                "bad-deployment", child.at("name"), child.tag, f"two processes are named `{name}`"
            )
        written.append(child)
        found.append(
            Process(
                name=name,
                nodes=_nodes(child, names, first, log),
                host=_named(child, "host", log) if child.get("host") else "",
                priority=_priority(child, log),
            )
        )
    if forgotten := [name for name in names if name not in first]:
        what = f"it gives no process to {first_of(forgotten)}"
        hint = "each node, and the policy, has one: <process><node name=…/></process>"
        log.error("bad-deployment", element.position, element.tag, what, hint)
    hosts = hosts_of(found)
    for process, child in zip(found, written, strict=True):
        if hosts and not process.host:
            what = f"the process `{process.name}` has no host, and others have"
            log.error(
                "bad-deployment", child.position, child.tag, what, f"hosts are {first_of(hosts)}"
            )
    return tuple(found)


def _is_known(element: Element, parent: str, tag: str, log: DiagnosticLog) -> bool:
    if element.tag != tag:
        what = f"not an element of <{parent}>"
        log.error("unknown-tag", element.position, element.tag, what, f"use <{tag}>")
        return False
    check_attributes(element, _ATTRIBUTES[tag], log)
    return True


def _named(element: Element, attribute: str, log: DiagnosticLog) -> str:
    name = require(element, attribute, log)
    if name and _NAME.fullmatch(name) is None:
        hint = "letters, digits, `_`, `-` and `.`, at most 63, a letter or digit first"
        log.error(
            "bad-deployment", element.at(attribute), element.tag, f"`{name}` is no name", hint
        )
    return name


def _nodes(
    process: Element, names: Collection[str], first: dict[str, Element], log: DiagnosticLog
) -> tuple[str, ...]:
    nodes = []
    for child in process.children:
        if not _is_known(child, "process", "node", log):
            continue
        name = require(child, "name", log)
        if name in first:
            what = f"`{name}` has two processes"
            log.error(
                "bad-deployment",
                child.at("name"),
                child.tag,
                what,
                f"also at {first[name].position}",
            )
        elif name and name not in names:
            what = f"the system has no node `{name}`"
            log.error(
                "bad-deployment", child.at("name"), child.tag, what, nearest(name, sorted(names))
            )
        elif name:
            first[name] = child
            nodes.append(name)
    if not process.children:
        what = "a process without nodes"
        log.error(
            "bad-deployment", process.position, process.tag, what, "name some: <node name=…/>"
        )
    return tuple(nodes)


def _priority(element: Element, log: DiagnosticLog) -> int | None:
    written = element.get("priority")
    if not written:
        return None
    if re.fullmatch(r"-?[0-9]{1,2}", written) is None or int(written) not in _PRIORITIES:
        hint = "a nice value from -20, the most urgent, to 19"
        what = f"`{written}` is no priority"
        log.error("bad-deployment", element.at("priority"), element.tag, what, hint)
        return None
    return int(written)
