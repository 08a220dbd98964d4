"""What watches a system that runs in this process: entry points of group ``m2c.observers``.

``--monitor`` and ``--record`` are moon's, and m2c does not know moon. On a middleware they are processes; of
a system in virtual time they are loaded by name, and called with the words of their command line.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.metadata import entry_points

from m2c.launch.description import LaunchError
from transports.interface import Connection

GROUP = "m2c.observers"

Drive = Callable[[Callable[[], bool]], None]
"""Runs the system to its end, or until the argument holds. The observer calls it when it listens."""
Observer = Callable[[Sequence[str], Connection, Drive], int]
"""Called with its options, a connection of its own and the system; its exit code."""


def observer(name: str) -> Observer:
    """The observer called ``name``, ``monitor`` or ``record``.

    Raises:
        LaunchError: none of that name is installed.
    """
    found = [point for point in entry_points(group=GROUP) if point.name == name]
    if not found:
        raise LaunchError(f"--{name}: no observer `{name}` is installed; install moon again")
    loaded: Observer = found[0].load()
    return loaded
