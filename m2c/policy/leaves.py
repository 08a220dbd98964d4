"""What each leaf of a policy is and whom it ticks, decided by the declarations of the system.

The type of the service that answers a leaf's ticks says whether it is a condition or an action, and
the interfaces that the machines declare say which services those are: names of services are
compared whole, never searched for ``tick`` or ``halt``.
"""

from __future__ import annotations

import re

import msgspec

from m2c.diagnostics import DiagnosticLog, Position
from m2c.language.datatypes import is_integer
from m2c.language.expressions import Literal
from m2c.model.interfaces import ServiceType
from m2c.model.machine import Emit, Interface, InterfaceKind, Machine, OutputKind
from m2c.model.naming import absolute
from m2c.model.system import System
from m2c.model.walk import statements_of
from m2c.policy.bound import BoundLeaf, child_tree
from m2c.policy.nav2 import nav2_hint
from m2c.policy.own_nodes import bind_own, kept_children
from m2c.policy.plugins import check_children, port_values, referenced_entry
from m2c.policy.reader import bound_hint
from m2c.policy.tree import (
    ADDRESS,
    BUILTINS,
    CONTROLS,
    MARK,
    MARK_IGNORED,
    TIMED,
    LeafKind,
    LeafNode,
    PolicyFile,
    is_marked,
)
from m2c.suggestions import nearest

TICK_KINDS = {"TickCondition": LeafKind.CONDITION, "TickAction": LeafKind.ACTION}
"""Last part of a tick service's type name (bt_interfaces and its variants)."""
_TICK_TYPES = {kind: name for name, kind in TICK_KINDS.items()}
_HALT_TYPE = "HaltAction"
_BY_NAME = "ROS2SERVICE"
_MONITOR_SUFFIX = "_mon"
_TICK_PORTS = ("service_name", "service_name_tick")
_HALT_PORT = "service_name_halt"
_WORDS = (
    *("SubTree", "Action", "Condition", "Control", "Decorator"),
    *("BehaviorTree", "TreeNodesModel", "include", "root"),
)
"""Elements of a policy's file that no leaf can be called by."""


def bind_leaves(
    policy: PolicyFile, system: System, log: DiagnosticLog
) -> dict[Position, BoundLeaf]:
    """The :class:`BoundLeaf` for each leaf of ``policy``, by the position of its element.

    Rules reported: ``leaf-address``, ``leaf-type``, ``leaf-kind``, ``leaf-port``, ``child-count``,
    ``unserved-leaf``, ``monitored-leaf``, ``ignored-attribute``. Leaves with errors are missing from
    the result. Elements that say the same thing (one skill used in two places) share one BoundLeaf,
    unless they have children.
    """
    binder = _Binder(system, log)
    found: dict[Position, BoundLeaf] = {}
    taken: dict[str, BoundLeaf] = {}
    kept = kept_children(policy)
    trees = {tree.id for tree in policy.trees}
    for node in policy.leaves():
        leaf = binder.bind(node)
        if leaf is None:
            continue
        wanted = _xml_name(leaf.name)
        number = 1
        name = wanted
        while (
            name in BUILTINS
            or name in _WORDS
            or any(tree == name or tree.startswith(child_tree(name, "")) for tree in trees)
            or (name in taken and not _same(taken[name], leaf))
        ):
            number += 1
            name = f"{wanted}_{number}"
        is_kept = node.position in kept
        leaf = taken.setdefault(name, msgspec.structs.replace(leaf, name=name, kept=is_kept))
        found[node.position] = leaf
    return found


def _same(one: BoundLeaf, other: BoundLeaf) -> bool:
    renamed = msgspec.structs.replace(other, name=one.name, position=one.position)
    return one == renamed and not one.children


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
        plugin = self._plugins.get(node.id)
        if plugin is None and (node.id in TIMED or node.id in CONTROLS):
            return bind_own(node, self._log)
        addressed = [(key, value) for key, value in node.attributes if key in ADDRESS]
        if not self._are_written_out(node, addressed, "the address of a skill is written out"):
            return None
        tick = self._tick_channel(node)
        if plugin is not None:
            return self._bind_plugin(node, plugin, tick)
        if not tick:
            what = f"the leaf `{node.name}` has no address"
            of_nav2 = nav2_hint(node.id)
            hint = of_nav2 or (
                f'write service_name="/…/tick", or interface="{_BY_NAME}"; '
                f"else {bound_hint(node.id)}, or give the system a plugin of this name"
            )
            plugin_named = nearest(node.id, self._plugins)
            if plugin_named.startswith("did you mean") and not of_nav2:
                what += f", and no plugin is called `{node.id}`"
                hint = plugin_named
            self._log.error("leaf-address", node.position, node.element, what, hint)
            return None
        hint = f"a skill's tick carries no values; a plugin or a <leaf> called `{node.id}` could"
        carried = [(key, value) for key, value in node.attributes if key not in ADDRESS]
        if not self._are_written_out(node, carried, hint):
            return None
        for key, _ in carried:
            if not key.startswith("_"):
                what = f"`{key}` is ignored"
                self._log.warning("ignored-attribute", node.position, node.element, what, hint)
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

    def _are_written_out(
        self, node: LeafNode, attributes: list[tuple[str, str]], hint: str
    ) -> bool:
        """Whether none of ``attributes`` is an entry of the blackboard; the first that is one is an error."""
        for key, value in attributes:
            if referenced_entry(value, key):
                what = f"`{key}` is the blackboard entry `{value}`"
                self._log.error("leaf-port", node.position, node.element, what, hint)
                return False
        return True

    def _bind_plugin(self, node: LeafNode, plugin: Machine, tick: str) -> BoundLeaf | None:
        check_children(node, plugin, self._log)
        ports = dict(node.attributes)
        machine = self._servers[tick][0] if tick in self._servers else None
        halt, halt_type = self._halt(node, machine, tick)
        for key in _TICK_PORTS:
            if tick:
                ports[key] = tick
        if halt:
            ports[_HALT_PORT] = halt
        if is_marked(node.get(MARK)) and MARK not in {port.key for port in plugin.ports}:
            self._log.note("monitored-leaf", node.position, node.element, *MARK_IGNORED)
        values = port_values(node, plugin, ports, self._log)
        if values is None:
            return None
        inputs, outputs = values
        declared = [port.key for port in inputs]
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
            kind=self._plugin_kind(node, plugin, tick_type),
            position=node.position,
            tick=tick if used else "",
            tick_type=tick_type if used else "",
            halt=halt,
            halt_type=halt_type,
            node=machine.name if machine is not None else "",
            plugin=plugin.name,
            inputs=inputs,
            outputs=outputs,
            children=len(node.children),
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
        channel = absolute(written)
        if channel.endswith(_MONITOR_SUFFIX) and channel not in self._servers:
            what = f"the suffix `{_MONITOR_SUFFIX}` of {channel} is ignored"
            hint = "moon monitors passively"
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
            if interface.kind is InterfaceKind.SERVER and _last(interface.type_name) in TICK_KINDS
        ]
        if len(ticks) > 1:  # several skills in one machine: the halt beside this tick
            folder = tick.rpartition("/")[0]
            halts = [halt for halt in halts if (halt.channel or "").rpartition("/")[0] == folder]
        if not halts:
            return "", ""
        return halts[0].channel or "", halts[0].type_name

    def _kind(self, node: LeafNode, tick_type: str) -> LeafKind:
        if node.children:
            return LeafKind.ACTION
        by_type = TICK_KINDS.get(_last(tick_type))
        if by_type is None:
            if node.kind is not None:
                return node.kind
            return LeafKind.ACTION
        if node.kind is not None and node.kind is not by_type:
            what = f"`{node.name}` is written as {node.kind}, but its tick has type {tick_type}"
            hint = f"it is run as {by_type}"
            self._log.warning("leaf-kind", node.position, node.element, what, hint)
        return by_type

    def _plugin_kind(self, node: LeafNode, plugin: Machine, tick_type: str) -> LeafKind:
        kind = self._kind(node, tick_type)
        if kind is LeafKind.ACTION or _last(tick_type) in TICK_KINDS or not _may_run(plugin):
            return kind
        what = f"`{node.name}` is written as {kind}, but its plugin may answer RUNNING"
        hint = f"it is run as {LeafKind.ACTION}"
        self._log.warning("leaf-kind", node.position, node.element, what, hint)
        return LeafKind.ACTION

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
        of_nav2 = "" if node.id in self._plugins else nav2_hint(node.id)  # else it is bound already
        hint = of_nav2 or nearest(channel, self._servers)
        if channel == f"/{node.name}Skill/tick" and (own := f"/{node.name}/tick") in self._servers:
            hint = (
                f'did you mean {own}? call the node {node.name}Skill, or write service_name="{own}"'
            )
        self._log.warning("unserved-leaf", node.position, node.element, what, hint)


def _may_run(plugin: Machine) -> bool:
    """Whether ``plugin`` names RUNNING as its status somewhere."""
    return any(
        isinstance(item, Emit)
        and item.kind is OutputKind.BT_RETURN_STATUS
        and any(isinstance(it.value, Literal) and it.value.value == "RUNNING" for it in item.fields)
        for item in statements_of(plugin)
    )


def _last(type_name: str) -> str:
    return type_name.rpartition("/")[2]
