"""What a tree remembers from tick to tick, and what of it cannot be observed."""

from __future__ import annotations

from collections.abc import Iterable
from collections.abc import Set as AbstractSet

import msgspec

from m2c.model.machine import InterfaceKind, Machine
from m2c.model.xml_writing import read_back
from m2c.policy.program import Policy
from m2c.policy.tree import CONDITIONS, TIMED

_PLAIN = {
    *("root", "BehaviorTree", "SubTree", "Sequence", "ReactiveSequence", "Fallback"),
    *("ReactiveFallback", "IfThenElse", "Inverter", "ForceSuccess", "ForceFailure"),
    *("AlwaysSuccess", "AlwaysFailure"),
}
"""Nodes that remember nothing but which of their children is RUNNING.

``IfThenElse`` is one only with three children: with two, it does not reset a condition that has
failed, which then fails again and again without being ticked.
"""


_FORGETS = {
    *("Parallel", "ParallelAll", "WhileDoElse", "AsyncSequence", "AsyncFallback"),
    *("Repeat", "RetryUntilSuccessful", "KeepRunningUntilFailure"),
}
"""Nodes that remember more while they are RUNNING, and nothing once they have ended."""

_PLAIN_WAITS = frozenset(TIMED)
"""Of the nodes that m2c itself runs, those that remember only since when they wait."""
_NEVER_FORGETS = frozenset({"RoundRobin", "RecoveryNode", "PersistentSequence"})
"""Of these, those that may remember something once they have ended."""


class Shape(msgspec.Struct, frozen=True):
    """What kind of tree it is.

    Attributes:
        plain: all that it remembers is which leaf is RUNNING (with the timed nodes above it): its
            nodes keep the place of a RUNNING child and nothing else, and at most one child of each
            runs. So there are few memories, and each can be reached in one tick of a fresh tree. And it
            calls skills: of a tree of plugins only nothing but its ticks can be observed.
        is_open: some leaf's status cannot be observed: a plugin or the clock answers.
        forgets: once its tick has ended with SUCCESS or FAILURE, it remembers nothing.
        hidden: channels that plugins call from inside the policy.
        strangers: whether plugins may call channels that are not known.
        unchecked: why the policy cannot be checked; "" if it can.
        unchecked_at: the leaf for which it cannot, by its id.
    """

    plain: bool
    is_open: bool
    hidden: frozenset[str]
    strangers: bool
    forgets: bool
    unchecked: str = ""
    unchecked_at: str = ""


def shape_of(policy: Policy, plugins: Iterable[Machine] = ()) -> Shape:
    """The :class:`Shape` of ``policy``; ``plugins`` are the machines that run leaves of it."""
    machines = {plugin.name: plugin for plugin in plugins}
    hidden: set[str] = set()
    strangers = False
    unchecked = unchecked_at = ""
    own = {leaf.built_in for leaf in policy.leaves if leaf.built_in}
    calls_skills = any(not leaf.plugin for leaf in policy.leaves)
    plain = calls_skills and own <= _PLAIN_WAITS and _has_only(policy, _PLAIN)
    for leaf in policy.leaves:
        if not leaf.plugin:
            continue
        hidden |= {leaf.tick, leaf.halt}
        machine = machines.get(leaf.plugin)
        strangers |= machine is None
        values = {port.key: str(port.value) for port in leaf.inputs}
        for interface in machine.interfaces if machine is not None else ():
            if interface.kind in (InterfaceKind.CLIENT, InterfaceKind.ACTION_CLIENT):
                hidden.add(interface.channel or values.get(interface.port or "", ""))
        if leaf.children:
            unchecked_at = leaf.id
            unchecked = (
                f"the plugin {leaf.plugin} decides, unobserved, which of its children it ticks"
            )
    hidden.discard("")
    is_open = any(leaf.plugin or leaf.timed or leaf.tick in hidden for leaf in policy.leaves)
    forgets = not own & _NEVER_FORGETS and _has_only(policy, _PLAIN | _FORGETS)
    return Shape(plain, is_open, frozenset(hidden), strangers, forgets, unchecked, unchecked_at)


def _has_only(policy: Policy, nodes: AbstractSet[str]) -> bool:
    """Whether ``policy`` has no other nodes than ``nodes``, and none that reads the blackboard."""
    known = nodes | {leaf.id for leaf in policy.leaves}
    return all(
        element.tag in known
        and not any(key in CONDITIONS for key in element.attrib)
        and (element.tag != "IfThenElse" or len(element) == 3)
        and not (element.tag in _FORGETS and any("{" in value for value in element.attrib.values()))
        for element in read_back(policy.xml).iter()
    )
