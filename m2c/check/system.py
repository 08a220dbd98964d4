"""Across machines: who serves what, who publishes what, and do they agree on types."""

from __future__ import annotations

from m2c.check.flow import check_flow
from m2c.check.types import check_types
from m2c.model.diagnostics import DiagnosticLog
from m2c.model.machine import Interface, InterfaceKind, Machine
from m2c.model.system import System
from m2c.model.typing import nearest

_SERVERS = {
    InterfaceKind.CLIENT: (InterfaceKind.SERVER, "call", "serves"),
    InterfaceKind.ACTION_CLIENT: (InterfaceKind.ACTION_SERVER, "sends goals to", "serves"),
    InterfaceKind.SUBSCRIBER: (InterfaceKind.PUBLISHER, "subscribes to", "publishes"),
}

_NAMESPACES = {
    InterfaceKind.PUBLISHER: "topic",
    InterfaceKind.SUBSCRIBER: "topic",
    InterfaceKind.SERVER: "service",
    InterfaceKind.CLIENT: "service",
    InterfaceKind.ACTION_SERVER: "action",
    InterfaceKind.ACTION_CLIENT: "action",
}


def check_system(system: System, log: DiagnosticLog) -> None:
    """Check every machine of ``system``, and what they say of each other's channels.

    Rules across machines: ``duplicate-node``, ``duplicate-server``, ``type-disagreement``, and the
    warning ``nobody-serves`` (only where a policy makes the system a whole one).
    """
    for machine in [*system.nodes, *system.plugins]:
        if check_types(machine, system.library, log):
            check_flow(machine, log)
    ends = [
        (machine, interface)
        for machine in system.nodes
        for interface in machine.interfaces
        if interface.channel and interface.kind is not InterfaceKind.TIMER
    ]
    _check_names(system, log)
    _check_ends(ends, log)
    if system.policy is not None:
        _check_counterparts(ends, log)


def _check_names(system: System, log: DiagnosticLog) -> None:
    seen: dict[str, Machine] = {}
    for machine in system.nodes:
        first = seen.setdefault(machine.name, machine)
        if first is not machine:
            what = f"a second node is called `{machine.name}`"
            hint = f"the first is {first.position.file}"
            log.error("duplicate-node", machine.position, "scxml", what, hint)


def _check_ends(ends: list[tuple[Machine, Interface]], log: DiagnosticLog) -> None:
    types: dict[tuple[str, str | None], tuple[Machine, Interface]] = {}
    servers: dict[tuple[str, str | None], Machine] = {}
    for machine, interface in ends:
        # topics, services and actions have names of their own: /x may be one of each
        channel = (_NAMESPACES[interface.kind], interface.channel)
        owner, first = types.setdefault(channel, (machine, interface))
        if first.type_name != interface.type_name:
            log.error(
                "type-disagreement",
                interface.position,
                "",
                f"{machine.name} declares {interface.channel} as {interface.type_name}, {owner.name} "
                f"as {first.type_name}",
                "both ends of a channel have one type",
            )
        if interface.kind in (InterfaceKind.SERVER, InterfaceKind.ACTION_SERVER):
            server = servers.setdefault(channel, machine)
            if server is not machine:
                log.error(
                    "duplicate-server",
                    interface.position,
                    "",
                    f"{machine.name} and {server.name} both serve {interface.channel}",
                    "a service has one server",
                )


def _check_counterparts(ends: list[tuple[Machine, Interface]], log: DiagnosticLog) -> None:
    for machine, interface in ends:
        if interface.kind not in _SERVERS:
            continue
        wanted, verb, missing = _SERVERS[interface.kind]
        channels = [other.channel or "" for _, other in ends if other.kind is wanted]
        if interface.channel not in channels:
            does = "calls" if verb == "call" else verb
            what = (
                f"{machine.name} {does} {interface.channel}, which no node of the system {missing}"
            )
            hint = nearest(interface.channel or "", channels)
            log.warning("nobody-serves", interface.position, "", what, hint)
