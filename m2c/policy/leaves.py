"""What each leaf of a policy is and whom it ticks, decided by the declarations of the system.

The type of the service that answers a leaf's ticks says whether it is a condition or an action, and
the interfaces that the machines declare say which services those are: names of services are
compared whole, never searched for ``tick`` or ``halt``.
"""

from __future__ import annotations

import re

import msgspec

from m2c.model.datatypes import is_integer
from m2c.model.diagnostics import DiagnosticLog, Position
from m2c.model.interfaces import ServiceType
from m2c.model.machine import EventKind, Interface, InterfaceKind, Machine
from m2c.model.system import System
from m2c.model.typing import nearest
from m2c.policy.tree import BUILTINS, LeafKind, LeafNode, PolicyFile

_TICK_KINDS = {"TickCondition": LeafKind.CONDITION, "TickAction": LeafKind.ACTION}
"""Last part of a tick service's type name (bt_interfaces and its variants)."""
_TICK_TYPES = {kind: name for name, kind in _TICK_KINDS.items()}
_HALT_TYPE = "HaltAction"
_BY_NAME = "ROS2SERVICE"
_MONITOR_SUFFIX = "_mon"
_TICK_PORTS = ("service_name", "service_name_tick")
_HALT_PORT = "service_name_halt"
_REFERENCE = re.compile(r"\{.*\}")


class BoundLeaf(msgspec.Struct, frozen=True, kw_only=True):
    """A leaf with everything that running it takes.

    Attributes:
        name: unique in the policy, and valid as an XML name: what the leaf is registered as.
        tick, tick_type: the service that answers ticks; empty if only the plugin knows.
        halt, halt_type: the service that the skill serves for halts; empty if it serves none.
        node: the node that serves ``tick``; empty if none of the system does.
        plugin: the plugin that ticks it; empty if the runner calls the service itself.
        ports: the plugin's input ports.
    """

    name: str
    kind: LeafKind
    position: Position
    tick: str = ""
    tick_type: str = ""
    halt: str = ""
    halt_type: str = ""
    node: str = ""
    plugin: str = ""
    ports: tuple[tuple[str, str], ...] = ()


def bind_leaves(
    policy: PolicyFile, system: System, log: DiagnosticLog
) -> dict[Position, BoundLeaf]:
    """The :class:`BoundLeaf` for each leaf of ``policy``, by the position of its element.

    Rules reported: ``leaf-address``, ``leaf-type``, ``leaf-kind``, ``leaf-port``, ``unserved-leaf``,
    ``monitored-leaf``. Leaves with errors are missing from the result. Elements that say the same
    thing (one skill used in two places) share one BoundLeaf.
    """
    binder = _Binder(system, log)
    found: dict[Position, BoundLeaf] = {}
    taken: dict[str, BoundLeaf] = {}
    for node in policy.leaves():
        leaf = binder.bind(node)
        if leaf is None:
            continue
        wanted = _xml_name(leaf.name)
        number = 1
        name = wanted
        while name in BUILTINS or (name in taken and not _same(taken[name], leaf)):
            number += 1
            name = f"{wanted}_{number}"
        leaf = taken.setdefault(name, msgspec.structs.replace(leaf, name=name))
        found[node.position] = leaf
    return found


def _same(one: BoundLeaf, other: BoundLeaf) -> bool:
    return one == msgspec.structs.replace(other, name=one.name, position=one.position)


def _xml_name(name: str) -> str:
    safe = re.sub(r"\W", "_", name, flags=re.ASCII)
    return safe if safe[:1].isalpha() else f"Leaf_{safe}"


class _Binder:
    def __init__(self, system: System, log: DiagnosticLog) -> None:
        self._system = system
        self._log = log
        self._plugins = {plugin.name: plugin for plugin in system.plugins}
        self._servers: dict[str, tuple[Machine, Interface]] = {
            interface.channel: (node, interface)
            for node in system.nodes
            for interface in node.interfaces
            if interface.kind is InterfaceKind.SERVER and interface.channel
        }

    def bind(self, node: LeafNode) -> BoundLeaf | None:
        for key, value in node.attributes:
            if _REFERENCE.search(value):
                what = f"`{key}` is the blackboard entry `{value}`"
                hint = "a leaf's address and ports are written out"
                self._log.error("leaf-port", node.position, node.element, what, hint)
                return None
        plugin = self._plugins.get(node.id)
        tick = self._tick_channel(node)
        if plugin is not None:
            return self._bind_plugin(node, plugin, tick)
        if not tick:
            what = f"the leaf `{node.name}` has no address"
            hint = f'write service_name="/…/tick", or interface="{_BY_NAME}"'
            self._log.error("leaf-address", node.position, node.element, what, hint)
            return None
        server = self._servers.get(tick)
        if server is None:
            self._unserved(node, tick)
            kind = node.kind or LeafKind.ACTION
            kind_type = self._type_for(kind)
            if kind_type is None:
                what = f"the type of {tick} is unknown"
                hint = f"no interface package declares a service {_TICK_TYPES[kind]}"
                self._log.error("leaf-type", node.position, node.element, what, hint)
                return None
            halt, halt_type = self._halt(node, None, tick)
            return BoundLeaf(
                name=node.name,
                kind=kind,
                position=node.position,
                tick=tick,
                tick_type=kind_type,
                halt=halt,
                halt_type=halt_type,
            )
        machine, interface = server
        if not self._has_status(interface.type_name):
            what = f"{tick} has type {interface.type_name}, which cannot answer a tick"
            hint = "its response needs an integer field `status`"
            self._log.error("leaf-type", node.position, node.element, what, hint)
            return None
        halt, halt_type = self._halt(node, machine, tick)
        return BoundLeaf(
            name=node.name,
            kind=self._kind(node, interface.type_name),
            position=node.position,
            tick=tick,
            tick_type=interface.type_name,
            halt=halt,
            halt_type=halt_type,
            node=machine.name,
        )

    def _bind_plugin(self, node: LeafNode, plugin: Machine, tick: str) -> BoundLeaf | None:
        children = {EventKind.BT_CHILD_STATUS, EventKind.BT_CHILD_HALTED}
        events = {
            transition.event.kind
            for state in plugin.states
            for transition in state.transitions
            if transition.event is not None
        }
        if events & children:
            what = f"the plugin `{plugin.name}` ticks children; plugins are leaves here"
            self._log.error("leaf-type", node.position, node.element, what)
            return None
        ports = dict(node.attributes)
        machine = self._servers[tick][0] if tick in self._servers else None
        halt, halt_type = self._halt(node, machine, tick)
        for key in _TICK_PORTS:
            if tick:
                ports[key] = tick
        if halt:
            ports[_HALT_PORT] = halt
        declared = [port.key for port in plugin.ports if not port.output]
        for key in declared:
            if key not in ports:
                what = f"the port `{key}` of `{plugin.name}` is not given"
                self._log.error("leaf-port", node.position, node.element, what, f'write {key}="…"')
                return None
        used = any(key in declared for key in _TICK_PORTS)
        if used and tick not in self._servers:
            self._unserved(node, tick)
        interface = self._servers[tick][1] if used and tick in self._servers else None
        client = next(
            (
                i
                for i in plugin.interfaces
                if i.kind is InterfaceKind.CLIENT and i.port in _TICK_PORTS
            ),
            None,
        )
        tick_type = interface.type_name if interface else client.type_name if client else ""
        if interface is not None and client is not None and interface.type_name != client.type_name:
            what = f"{tick} is served as {interface.type_name}"
            hint = f"`{plugin.name}` calls it as {client.type_name}"
            self._log.error("leaf-type", node.position, node.element, what, hint)
            return None
        return BoundLeaf(
            name=node.name,
            kind=self._kind(node, tick_type),
            position=node.position,
            tick=tick if used else "",
            tick_type=tick_type if used else "",
            halt=halt,
            halt_type=halt_type,
            node=machine.name if machine is not None else "",
            plugin=plugin.name,
            ports=tuple((key, ports[key]) for key in declared),
        )

    def _tick_channel(self, node: LeafNode) -> str:
        for key in _TICK_PORTS:
            if node.get(key):
                return self._channel(node, node.get(key))
        if node.get("interface") == _BY_NAME:
            name = node.name.removesuffix(_MONITOR_SUFFIX)
            return f"/{name}Skill/tick"
        return ""

    def _channel(self, node: LeafNode, written: str) -> str:
        channel = written if written.startswith("/") else f"/{written}"
        if channel.endswith(_MONITOR_SUFFIX) and channel not in self._servers:
            what = f"the suffix `{_MONITOR_SUFFIX}` of {channel} is ignored"
            hint = "moon listens without standing in between"
            self._log.note("monitored-leaf", node.position, node.element, what, hint)
            return channel.removesuffix(_MONITOR_SUFFIX)
        return channel

    def _halt(self, node: LeafNode, machine: Machine | None, tick: str) -> tuple[str, str]:
        """The service for halts: the one written, else the one the tick's server declares."""
        written = node.get(_HALT_PORT)
        if written:
            channel = self._channel(node, written)
            server = self._servers.get(channel)
            if server is None:
                self._unserved(node, channel)
                return "", ""
            return channel, server[1].type_name
        if machine is None:
            return "", ""
        halts = [
            interface
            for interface in machine.interfaces
            if interface.kind is InterfaceKind.SERVER
            and interface.channel
            and _last(interface.type_name) == _HALT_TYPE
        ]
        ticks = [
            interface
            for interface in machine.interfaces
            if interface.kind is InterfaceKind.SERVER and _last(interface.type_name) in _TICK_KINDS
        ]
        if len(ticks) > 1:  # several skills in one machine: the halt beside this tick
            folder = tick.rpartition("/")[0]
            halts = [halt for halt in halts if (halt.channel or "").rpartition("/")[0] == folder]
        if not halts:
            return "", ""
        return halts[0].channel or "", halts[0].type_name

    def _kind(self, node: LeafNode, tick_type: str) -> LeafKind:
        by_type = _TICK_KINDS.get(_last(tick_type))
        if by_type is None:
            if node.kind is not None:
                return node.kind
            return LeafKind.ACTION
        if node.kind is not None and node.kind is not by_type:
            what = f"`{node.name}` is written as {node.kind}, but its tick has type {tick_type}"
            hint = f"it is run as {by_type}"
            self._log.warning("leaf-kind", node.position, node.element, what, hint)
        return by_type

    def _has_status(self, type_name: str) -> bool:
        service = self._service(type_name)
        status = service.response.field("status") if service is not None else None
        return status is not None and is_integer(status)

    def _service(self, type_name: str) -> ServiceType | None:
        try:
            return self._system.library.service(type_name)
        except KeyError:
            return None

    def _type_for(self, kind: LeafKind) -> str | None:
        wanted = _TICK_TYPES[kind]
        names = sorted(name for name in self._system.library.names("srv") if _last(name) == wanted)
        return names[0] if names else None

    def _unserved(self, node: LeafNode, channel: str) -> None:
        what = f"no node serves {channel}: the leaf `{node.name}` will fail"
        hint = nearest(channel, self._servers)
        self._log.warning("unserved-leaf", node.position, node.element, what, hint)


def _last(type_name: str) -> str:
    return type_name.rpartition("/")[2]
