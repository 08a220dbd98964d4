"""Routes through the man in the middle: the monitored name of a service, as MOON has it.

The monitor serves ``/name_mon`` and calls ``/name``. So whoever is to be heard has to be told the other
name: the policy, and each monitored skill for what it calls. Nothing else of a model changes.
"""

from __future__ import annotations

from msgspec.structs import replace

from m2c.model.machine import InterfaceKind, Machine
from m2c.model.system import System

MONITORED = ("AlarmSkill", "BatteryLevelSkill", "IsPoiDone1Skill", "SetPoi1Skill")
"""The skills that the paper monitors."""


def rerouted(channel: str) -> str:
    """The monitored name of a service."""
    return f"{channel}_mon"


def rerouted_system(system: System) -> System:
    """The system, whose monitored skills call their services by way of the monitor."""
    return replace(
        system,
        nodes=tuple(_calling(node) if node.name in MONITORED else node for node in system.nodes),
    )


def _calling(machine: Machine) -> Machine:
    """The machine, with the monitored names of what it calls."""
    interfaces = (
        replace(item, channel=rerouted(str(item.channel)))
        if item.kind is InterfaceKind.CLIENT
        else item
        for item in machine.interfaces
    )
    return replace(machine, interfaces=tuple(interfaces))
