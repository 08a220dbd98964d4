"""Across machines: who serves what, who publishes what, and do they agree on types."""

from __future__ import annotations

import msgspec

from m2c.check.flow import check_flow
from m2c.check.names import check_names
from m2c.check.packages import check_packages
from m2c.check.ticks import check_ticks
from m2c.check.types import check_types
from m2c.diagnostics import DiagnosticLog
from m2c.model.machine import CHANNEL_KINDS, Interface, InterfaceKind, Machine
from m2c.model.naming import ANYWHERE, Naming
from m2c.model.system import System
from m2c.policy.strangers import EXPLICIT
from m2c.policy.tree import BUILTINS, CONTROLS
from m2c.suggestions import nearest, nearly_the_same

_COUNTERPARTS = {
    InterfaceKind.CLIENT: (InterfaceKind.SERVER, "calls", "serves"),
    InterfaceKind.ACTION_CLIENT: (InterfaceKind.ACTION_SERVER, "sends goals to", "serves"),
    InterfaceKind.SUBSCRIBER: (InterfaceKind.PUBLISHER, "subscribes to", "publishes"),
}
_OF_THE_LIBRARY = {*BUILTINS, "SubTree", *EXPLICIT} - {*CONTROLS}
"""Names that no plugin has. Nav2's own nodes are plugins there, too, so a system may bring its own."""
_POLICY_NODE = "policy"


class _End(msgspec.Struct, frozen=True):
    """One end of a channel, and the machine that declares it."""

    machine: Machine
    interface: Interface
    channel: str


def check_system(system: System, log: DiagnosticLog, naming: Naming = ANYWHERE) -> None:
    """Check every machine of ``system``, and what they say of each other's channels.

    Rules across machines: ``duplicate-node``, ``duplicate-server``, ``type-disagreement``, those of
    :func:`m2c.check.names.check_names`, :func:`m2c.check.ticks.check_ticks` and, where nodes need them,
    :func:`m2c.check.packages.check_packages`, and the warning ``nobody-serves``. A policy makes a system a
    whole one: every channel needs its other end. Without one (some models, a folder of them) the
    other end may be elsewhere, so only a near miss is reported: nobody has the other end, but
    somebody that of a name almost the same. Where ``log`` has errors already (a model that was not
    read), nobody is said to be missing. ``naming`` are the transports that must take the names.
    """
    check_names(system, log, naming)
    check_ticks(system, log)
    if naming.needs_packages:
        check_packages(system, log)
    incomplete = log.has_errors  # a machine may be missing, or a channel be called otherwise
    for machine in [*system.nodes, *system.plugins]:
        if check_types(machine, system.library, log):
            check_flow(machine, log)
    _check_unique(system.nodes, "node", log)
    _check_unique(system.plugins, "plugin", log)
    _check_policy_node(system, log)
    _check_names_in_trees(system.plugins, log)
    ends = [
        _End(machine, interface, interface.channel)
        for machine in [*system.nodes, *system.plugins]
        for interface in machine.interfaces
        if interface.channel and interface.kind is not InterfaceKind.TIMER
    ]
    _check_ends(ends, log)
    if not incomplete:
        _check_counterparts(ends, _named_by_ports(system), system.policy is not None, log)
    # of several instances of one model the same is found
    log.diagnostics[:] = dict.fromkeys(log.diagnostics)


def _check_policy_node(system: System, log: DiagnosticLog) -> None:
    """The policy runs as a node, too."""
    node = system.node(_POLICY_NODE)
    if system.policy is not None and node is not None:
        text = f"the node that ticks the policy is called `{_POLICY_NODE}`, too"
        log.error("duplicate-node", *node.name_place, text, "give the machine another name")


def _check_names_in_trees(plugins: tuple[Machine, ...], log: DiagnosticLog) -> None:
    """BehaviorTree.CPP registers no second node of a name."""
    for plugin in plugins:
        if plugin.name in _OF_THE_LIBRARY:
            text = f"BehaviorTree.CPP has a node called `{plugin.name}`"
            hint = "give it another name, here and in the tree"
            log.error("duplicate-node", *plugin.name_place, text, hint)


def _check_unique(machines: tuple[Machine, ...], what: str, log: DiagnosticLog) -> None:
    seen: dict[str, Machine] = {}
    for machine in machines:
        first = seen.setdefault(machine.name, machine)
        if first is not machine:
            text = f"a second {what} is called `{machine.name}`"
            hint = f"the first is {first.named_at or first.position.file}"
            log.error("duplicate-node", *machine.name_place, text, hint)


def _check_ends(ends: list[_End], log: DiagnosticLog) -> None:
    types: dict[tuple[str, str], _End] = {}
    servers: dict[tuple[str, str], _End] = {}
    for end in ends:
        interface = end.interface
        channel = (CHANNEL_KINDS[interface.kind], end.channel)
        first = types.setdefault(channel, end)
        if first.interface.type_name != interface.type_name:
            log.error(
                "type-disagreement",
                interface.position,
                "",
                f"{end.machine.name} declares {end.channel} as {interface.type_name}, "
                f"{first.machine.name} as {first.interface.type_name}",
                "both ends of a channel have one type",
            )
        if interface.kind in (InterfaceKind.SERVER, InterfaceKind.ACTION_SERVER):
            server = servers.setdefault(channel, end)
            if server.machine is not end.machine:
                log.error(
                    "duplicate-server",
                    interface.position,
                    "",
                    f"{end.machine.name} and {server.machine.name} both serve {end.channel}",
                    "a service has one server",
                )


def _named_by_ports(system: System) -> set[tuple[InterfaceKind, str]]:
    """Kind and type of the ends whose channels only the policy names."""
    return {
        (interface.kind, interface.type_name)
        for plugin in system.plugins
        for interface in plugin.interfaces
        if interface.channel is None
    }


def _check_counterparts(
    ends: list[_End],
    named_by_ports: set[tuple[InterfaceKind, str]],
    whole: bool,
    log: DiagnosticLog,
) -> None:
    for end in ends:
        if end.interface.kind not in _COUNTERPARTS:
            continue
        wanted, does, lacking = _COUNTERPARTS[end.interface.kind]
        others = [other for other in ends if other.interface.kind is wanted]
        if any(other.channel == end.channel for other in others):
            continue
        if (wanted, end.interface.type_name) in named_by_ports:
            continue  # it may be this one
        near = [
            other.channel
            for other in others
            if other.interface.type_name == end.interface.type_name
            and nearly_the_same(end.channel, other.channel)
        ]
        if whole or near:
            where = "of the system" if whole else "read here"
            what = f"{end.machine.name} {does} {end.channel}, which no node {where} {lacking}"
            hint = (
                f"did you mean {near[0]}?"
                if near
                else nearest(end.channel, (other.channel for other in others))
            )
            log.warning("nobody-serves", end.interface.position, "", what, hint)
