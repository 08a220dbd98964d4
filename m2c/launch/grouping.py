"""Which nodes of a system share a process."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Sequence

import msgspec

from m2c.launch.description import LaunchDescription, Package
from m2c.model.deployment import POLICY, Process, names_in_deployment


class Group(msgspec.Struct, frozen=True):
    """One process of a system.

    Attributes:
        name: the node's, if it has one; else of the process.
        nodes: the nodes that it runs.
        policy: the policy, if that runs here too.
        priority: its nice value; None leaves it as it is.
    """

    name: str
    nodes: tuple[Package, ...]
    policy: Package | None = None
    priority: int | None = None

    @property
    def packages(self) -> tuple[Package, ...]:
        """All that it runs."""
        return (*self.nodes, *([] if self.policy is None else [self.policy]))


def grouped(
    description: LaunchDescription, processes: int | None, apart: Collection[str] = ()
) -> tuple[Group, ...]:
    """Deal the nodes of ``description`` out to processes.

    The policy and the nodes that a tick calls share the first, as each call between processes costs several
    within one; the others follow in the order of the system, in parts of one size.

    Args:
        description: the nodes, and the policy.
        processes: how many at most, not counting those of ``apart``; None: each node has its own.
        apart: names of nodes (or of the policy) that have a process of their own.
    """
    if processes is None:
        apart = names_in_deployment(description.nodes, description.policy is not None)
    together, alone = _split(Group("", description.nodes, description.policy), apart)
    nodes, policy, count = together.nodes, together.policy, processes or 1
    dealt: list[tuple[tuple[Package, ...], Package | None]] = []
    if policy is not None:
        called = nodes if count == 1 else tuple(n for n in nodes if n.name in description.called)
        dealt = [(called, policy)]
        nodes, count = tuple(node for node in nodes if node not in called), count - 1
    dealt += [(part, None) for part in _parts(nodes, count)]
    groups = [
        Group(f"process {number}", part, ticking) for number, (part, ticking) in enumerate(dealt, 1)
    ]
    return (*(_named(group) for group in groups), *alone)


def deployed(
    description: LaunchDescription,
    deployment: Sequence[Process],
    host: str = "",
    apart: Collection[str] = (),
) -> tuple[Group, ...]:
    """The processes of ``deployment`` that run on ``host`` (empty: on any).

    Args:
        description: the nodes, and the policy; those that are not in it are left out.
        deployment: which share a process.
        host: one of those of the deployment.
        apart: names of nodes that have a process of their own.
    """
    nodes = {node.name: node for node in description.nodes}
    groups: list[Group] = []
    for process in deployment:
        if host and process.host != host:
            continue
        own = tuple(nodes[name] for name in process.nodes if name in nodes)
        policy = description.policy if POLICY in process.nodes else None
        together, alone = _split(Group(process.name, own, policy, process.priority), apart)
        groups += [*([together] if together.packages else []), *alone]
    return tuple(groups)


def _split(group: Group, apart: Collection[str]) -> tuple[Group, list[Group]]:
    """``group`` without those of ``apart``, which may leave it empty, and a group for each of these."""
    nodes = tuple(node for node in group.nodes if node.name not in apart)
    policy = group.policy
    alone = [
        Group(node.name, (node,), None, group.priority)
        for node in group.nodes
        if node.name in apart
    ]
    if policy is not None and policy.name in apart:
        alone.append(Group(policy.name, (), policy, group.priority))
        policy = None
    return msgspec.structs.replace(group, nodes=nodes, policy=policy), alone


def _named(group: Group) -> Group:
    packages = group.packages
    return msgspec.structs.replace(group, name=packages[0].name) if len(packages) == 1 else group


def _parts(nodes: Sequence[Package], count: int) -> list[tuple[Package, ...]]:
    """``nodes`` in at most ``count`` parts, none empty, whose sizes differ by one at most."""
    count = min(count, len(nodes))
    ends = [len(nodes) * number // count for number in range(count + 1)] if count else []
    return [tuple(nodes[begin:end]) for begin, end in itertools.pairwise(ends)]
