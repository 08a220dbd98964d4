"""The middleware that nodes run on: one interface, and the transports that implement it.

The names in ``__all__`` are the interface; everything else may change. A node's connection is a
:class:`Transport`: on Zenoh or ROS 2 from :func:`connect`, in one process on virtual time from a
:class:`SimulatedWorld`:

>>> from transports import SimulatedWorld
>>> world = SimulatedWorld(seed=1)
>>> node = world.connect("listener")
>>> times = []
>>> timer = node.every(0.5, lambda: times.append(node.now_ns()))
>>> world.run_for(2.0)
>>> [later - earlier for earlier, later in zip(times, times[1:])]
[500000000, 500000000, 500000000]
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from transports.interface import (
        Action,
        ActionClient,
        Answer,
        CallOutcome,
        CallResult,
        Client,
        Completion,
        Connection,
        GoalEvents,
        GoalHandle,
        GoalStatus,
        Listener,
        Message,
        Observation,
        ObservationKind,
        Publisher,
        Reliability,
        Request,
        Service,
        Tap,
        Timer,
        Topic,
        Transport,
        TransportError,
        TransportFactory,
    )
    from transports.registry import available, connect
    from transports.simulated.conditions import Conditions
    from transports.simulated.world import SimulatedWorld

__all__ = [
    "Action",
    "ActionClient",
    "Answer",
    "CallOutcome",
    "CallResult",
    "Client",
    "Completion",
    "Conditions",
    "Connection",
    "GoalEvents",
    "GoalHandle",
    "GoalStatus",
    "Listener",
    "Message",
    "Observation",
    "ObservationKind",
    "Publisher",
    "Reliability",
    "Request",
    "Service",
    "SimulatedWorld",
    "Tap",
    "Timer",
    "Topic",
    "Transport",
    "TransportError",
    "TransportFactory",
    "available",
    "connect",
]

_HOMES = {
    "Conditions": "transports.simulated.conditions",
    "SimulatedWorld": "transports.simulated.world",
    "available": "transports.registry",
    "connect": "transports.registry",
}
"""Where a name is defined that is not in ``transports.interface``. It is imported when it is first used:
the command line stays quick."""


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES.get(name, "transports.interface")), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
