"""What is generated for one machine, as it is written to files."""

from __future__ import annotations

from m2c.codegen.draft import Draft
from m2c.codegen.nodes import node_program
from m2c.codegen.rendering import our_templates
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import Machine


def node_modules(machine: Machine, library: InterfaceLibrary, package: str) -> dict[str, str]:
    """``__init__``, ``interfaces``, ``machine`` and ``node`` of one machine."""
    draft = Draft(our_templates())
    draft.add_node("", node_program(machine, library, package))
    return draft.files()
