"""A node in a simulated world that is made for it: the transport ``simulated`` by its options."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from transports.interface import TransportError
from transports.options import refuse_unknown
from transports.simulated.conditions import Conditions
from transports.simulated.world import SimulatedTransport, SimulatedWorld


def _bounds(text: str) -> tuple[float, float]:
    least, _, most = text.partition("..")
    return float(least), float(most or least)


_CONDITIONS: Mapping[str, tuple[str, Callable[[str], Any]]] = {
    "delay": ("delay_s", _bounds),
    "loss": ("loss", float),
    "duplication": ("duplication", float),
}
"""The condition that an option sets, and what reads its text."""


def connect(node: str, options: Mapping[str, str]) -> SimulatedTransport:
    """The first node of a new world in this process; others join by ``connect(…).world.connect(name)``.

    Args:
        node: its name.
        options: ``seed`` (whole number), ``delay`` (seconds, ``0.001`` or ``0.001..0.05``), ``loss``
            and ``duplication`` (probabilities).

    Raises:
        TransportError: an option is unknown or wrong.
    """
    return SimulatedTransport(_world(options), node)


def _world(options: Mapping[str, str]) -> SimulatedWorld:
    refuse_unknown("simulated", options, ("seed", *_CONDITIONS))
    try:
        seed = int(options.get("seed", "0"))
        conditions = {
            field: read(options[option])
            for option, (field, read) in _CONDITIONS.items()
            if option in options
        }
        return SimulatedWorld(seed, Conditions(**conditions))
    except ValueError as error:
        raise TransportError(f"the simulated transport: {error}") from error
