"""Routes through the man in the middle: the monitored name of a service, as MOON has it.

The monitor serves ``/name_mon`` and calls ``/name``. So whoever is to be heard has to be told the other
name: the policy, and each monitored skill for what it calls. Nothing else of a model changes.
"""

from __future__ import annotations

import msgspec

from m2c.model.machine import InterfaceKind, Machine
from m2c.model.system import System

SUFFIX = "_mon"
MONITORED = ("AlarmSkill", "BatteryLevelSkill", "IsPoiDone1Skill", "SetPoi1Skill")
"""The skills that the paper monitors."""


def rerouted(channel: str) -> str:
    """The monitored name of a service."""
    return channel + SUFFIX


def rerouted_machine(machine: Machine) -> Machine:
    """The machine, calling its services by way of the monitor."""
    interfaces = tuple(
        msgspec.structs.replace(item, channel=rerouted(item.channel))
        if item.kind is InterfaceKind.CLIENT
        else item
        for item in machine.interfaces
    )
    return msgspec.structs.replace(machine, interfaces=interfaces)


def rerouted_system(system: System) -> System:
    """The system with its monitored skills rerouted."""
    nodes = tuple(
        rerouted_machine(machine) if machine.name in MONITORED else machine
        for machine in system.nodes
    )
    return msgspec.structs.replace(system, nodes=nodes)
