"""A policy ready to run: XML for BehaviorTree.CPP 4, and how each of its leaves is ticked.

This is what a generated policy package holds, so that running it needs no model.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from pathlib import Path

import msgspec

from m2c.diagnostics import DiagnosticLog
from m2c.language.datatypes import Structure
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import CHANNEL_KINDS
from m2c.model.naming import ANYWHERE, Naming, check_channel
from m2c.model.system import System
from m2c.policy.bound import BoundLeaf
from m2c.policy.entries import check_entries
from m2c.policy.entry_types import check_entry_types
from m2c.policy.forwarding import only_forwards
from m2c.policy.leaf_entries import check_leaf_entries
from m2c.policy.leaves import bind_leaves
from m2c.policy.normalise import normalised
from m2c.policy.plugins import PortValue, has_children
from m2c.policy.reader import read_policy_file
from m2c.policy.refusal import check_loading
from m2c.policy.tree import LeafKind


class Leaf(msgspec.Struct, frozen=True, kw_only=True):
    """A leaf that a skill (or a plugin) serves.

    Attributes:
        id: the name of its element in the policy's XML.
        name: what people call it.
        action: whether it may be RUNNING.
        tick, tick_type, tick_request, tick_response: its tick service; "" where only a plugin knows.
        halt, halt_type, halt_request, halt_response: the skill's halt service; "" if it has none.
        plugin: name of the plugin machine that runs the leaf; "" if the runner calls the service.
        timed: ``Sleep`` or another node that asks the clock (``m2c.policy.tree.WAITING``); else "".
        control: another node that m2c itself runs (``m2c.policy.controls``); else "".
        kept: whether a node that m2c runs goes on after it has ended, until the one around it ends.
        inputs, outputs: the plugin's ports.
        children: how many children the plugin ticks, each a tree of its own in the XML (see
            ``m2c.policy.normalise``); 0 for a leaf.
    """

    id: str
    name: str
    action: bool
    tick: str = ""
    tick_type: str = ""
    tick_request: Structure | None = None
    tick_response: Structure | None = None
    halt: str = ""
    halt_type: str = ""
    halt_request: Structure | None = None
    halt_response: Structure | None = None
    plugin: str = ""
    timed: str = ""
    control: str = ""
    kept: bool = False
    inputs: tuple[PortValue, ...] = ()
    outputs: tuple[PortValue, ...] = ()
    children: int = 0

    @property
    def built_in(self) -> str:
        """The node that m2c itself runs; "" for what a skill or a plugin answers."""
        return self.timed or self.control


class Policy(msgspec.Struct, frozen=True):
    """A behaviour tree ready to run; ``main`` is the tree of ``xml`` that is executed.

    ``tick_if_not_running``: whether it is ticked again after it has ended.
    """

    name: str
    main: str
    xml: str
    leaves: tuple[Leaf, ...]
    tick_rate_hz: float = 1.0
    tick_if_not_running: bool = True


def read_policy(
    path: Path, system: System, log: DiagnosticLog, naming: Naming = ANYWHERE
) -> Policy | None:
    """Read the policy in ``path`` and bind its leaves to the machines of ``system``.

    Args:
        path: the policy's XML file.
        system: whose machines serve its leaves.
        log: where findings go.
        naming: the transports that must take the channels that the policy names.

    Returns:
        The policy, or None after an error (rules: see ``read_policy_file``, ``check_entries`` and
        ``bind_leaves``; ``refused-policy``: what BehaviorTree.CPP finds, as a script that does not parse).
    """
    own = DiagnosticLog()
    plugins = {plugin.name: has_children(plugin) for plugin in system.plugins}
    file = read_policy_file(path, own, plugins)
    policy = None
    if file is not None:
        check_entries(file, own)
        bound = bind_leaves(file, system, own)
        _check_channels(bound.values(), system, naming, own)
        check_leaf_entries(file, bound, own)
        check_entry_types(file, bound, own)
        if not own.has_errors:
            direct = {plugin.name for plugin in system.plugins if only_forwards(plugin)}
            leaves = {leaf.name: _runnable(leaf, system.library, direct) for leaf in bound.values()}
            xml = normalised(file, bound)
            policy = Policy(
                path.stem,
                file.main,
                xml,
                tuple(leaves.values()),
                system.tick_rate_hz,
                system.tick_if_not_running,
            )
            check_loading(file, bound, own)
            if own.has_errors:
                policy = None
    log.diagnostics += own.diagnostics
    return policy


def _check_channels(
    leaves: Iterable[BoundLeaf], system: System, naming: Naming, log: DiagnosticLog
) -> None:
    """Check the names of channels that only the policy has: addresses and ports of its leaves."""
    machines = (*system.nodes, *system.plugins)
    known = {interface.channel for machine in machines for interface in machine.interfaces}
    of_port = {
        (plugin.name, interface.port): CHANNEL_KINDS[interface.kind]
        for plugin in system.plugins
        for interface in plugin.interfaces
        if interface.port and interface.kind in CHANNEL_KINDS
    }
    for leaf in leaves:
        named = [("service", leaf.tick), ("service", leaf.halt)]
        named += [
            (of_port[leaf.plugin, port.key], str(port.value))
            for port in leaf.inputs
            if (leaf.plugin, port.key) in of_port
        ]
        for kind, channel in dict.fromkeys(named):
            if channel and channel not in known:
                check_channel(kind, channel, leaf.position, "", naming, log)


def _runnable(leaf: BoundLeaf, library: InterfaceLibrary, direct: Collection[str]) -> Leaf:
    tick = library.service(leaf.tick_type) if leaf.tick_type else None
    halt = library.service(leaf.halt_type) if leaf.halt_type else None
    return Leaf(
        id=leaf.name,
        name=leaf.name,
        action=leaf.kind is LeafKind.ACTION,
        tick=leaf.tick,
        tick_type=leaf.tick_type,
        tick_request=tick.request if tick is not None else None,
        tick_response=tick.response if tick is not None else None,
        halt=leaf.halt,
        halt_type=leaf.halt_type,
        halt_request=halt.request if halt is not None else None,
        halt_response=halt.response if halt is not None else None,
        plugin="" if tick is not None and leaf.plugin in direct else leaf.plugin,
        timed=leaf.timed,
        control=leaf.control,
        kept=leaf.kept,
        inputs=leaf.inputs,
        outputs=leaf.outputs,
        children=leaf.children,
    )
