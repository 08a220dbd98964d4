"""What a leaf of a policy is, once it is bound to the declarations of its system."""

from __future__ import annotations

import msgspec

from m2c.diagnostics import Position
from m2c.policy.plugins import PortValue
from m2c.policy.tree import LeafKind


class BoundLeaf(msgspec.Struct, frozen=True, kw_only=True):
    """A leaf with everything that running it takes.

    Attributes:
        name: unique in the policy, and valid as an XML name: what the leaf is registered as.
        tick, tick_type: the service that answers ticks; empty if only the plugin knows.
        halt, halt_type: the service that the skill serves for halts; empty if it serves none.
        node: the node that serves ``tick``; empty if none of the system does.
        plugin: the plugin that ticks it; empty if the runner calls the service itself.
        timed, control, kept: of a node that m2c itself runs; see ``m2c.policy.program.Leaf``.
        inputs, outputs: the plugin's ports.
        children: how many children the plugin ticks; 0 for a leaf.
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
    timed: str = ""
    control: str = ""
    kept: bool = False
    inputs: tuple[PortValue, ...] = ()
    outputs: tuple[PortValue, ...] = ()
    children: int = 0


def child_tree(leaf: str, number: int | str) -> str:
    """The name of the tree that child ``number`` of ``leaf`` becomes; "": how all of them begin."""
    return f"{leaf}#{number}"
