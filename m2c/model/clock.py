"""The topic ``/clock`` of systems whose models take it for granted, as AS2FM's do.

It carries ``builtin_interfaces/msg/Time``: the time since the system began, ten times a second. The node
that publishes it is made from a model as any other: it is generated, run, simulated and monitored as one.
ROS 2's own ``/clock`` (``rosgraph_msgs/msg/Clock``) is a simulator's, and nothing is added for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec

from m2c.diagnostics import DiagnosticLog
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import InterfaceKind, Machine
from m2c.model.reader import read_machine

_CHANNEL = "/clock"
_TYPE = "builtin_interfaces/msg/Time"
_MODEL = Path(__file__).parents[1] / "models" / "system_clock.ascxml"


def clock_for(
    machines: Sequence[Machine], library: InterfaceLibrary, log: DiagnosticLog
) -> Machine | None:
    """The node that publishes ``/clock``, if one of ``machines`` subscribes to it and none publishes it.

    Args:
        machines: all of the system.
        library: its types.
        log: where the note ``provided-topic`` goes.
    """
    ends = [end for machine in machines for end in machine.interfaces if end.channel == _CHANNEL]
    takers = [
        end for end in ends if end.kind is InterfaceKind.SUBSCRIBER and end.type_name == _TYPE
    ]
    if not takers or any(end.kind is InterfaceKind.PUBLISHER for end in ends):
        return None
    clock = read_machine(_MODEL, log, library)
    assert clock is not None
    taken = {machine.name for machine in machines}
    while clock.name in taken:
        clock = msgspec.structs.replace(clock, name=f"{clock.name}_")
    what = f"no model publishes {_CHANNEL}: a node `{clock.name}` is added, which does"
    hint = "it has the time since the start, ten times a second"
    log.note("provided-topic", takers[0].position, "", what, hint)
    return clock
