"""Finding a transport by name: entry points of group ``m2c.transports``."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from transports.descriptions import OWN, NameRule, described
from transports.interface import Connection, TransportError, TransportFactory
from transports.open_files import FOR_A_CONNECTION, allow_open_files

GROUP = "m2c.transports"
NAMES_GROUP = "m2c.transport_names"
"""Entry points of what a transport refuses; each is called as its transport is."""


def available() -> list[str]:
    """Names of the installed transports, sorted."""
    return sorted({point.name for point in entry_points(group=GROUP)})


def name_rules() -> dict[str, NameRule]:
    """What the transports refuse of names that others take, by transport, without connecting.

    Raises:
        TransportError: an installed rule cannot be loaded.
    """
    theirs = {point.name: _load(point) for point in entry_points(group=NAMES_GROUP)}
    own = {name: known.refused for name, known in OWN.items() if known.refused is not None}
    return {**own, **theirs}


def connect(transport: str, node: str, options: Mapping[str, str]) -> Connection:
    """Connect ``node`` by the transport called ``transport``.

    Args:
        transport: one of :func:`available`.
        node: the node's name, unique in the system.
        options: the transport's own options (``endpoint``, ``listen``, ``config``, …).

    Raises:
        TransportError: there is no such transport, or it cannot connect.
    """
    point = _point(transport)
    allow_open_files(FOR_A_CONNECTION)
    factory: TransportFactory = _load(point)
    return factory(node, options)


def loaded(transport: str) -> TransportFactory:
    """What connects nodes by the transport called ``transport``.

    Raises:
        TransportError: there is no such transport, or it cannot be loaded.
    """
    factory: TransportFactory = _load(_point(transport))
    return factory


def _point(transport: str) -> EntryPoint:
    found = [point for point in entry_points(group=GROUP) if point.name == transport]
    if not found:
        hint = f"installed: {', '.join(available()) or 'none'}"
        raise TransportError(f"no transport `{transport}` is installed; {hint}")
    return found[0]


def _load(point: EntryPoint) -> Any:
    distribution = point.dist.name if point.dist is not None else "an unknown distribution"
    try:
        return point.load()
    except (ImportError, AttributeError) as error:
        needs = described(point.name).needs
        raise TransportError(
            f"the transport `{point.name}` of {distribution} cannot be loaded: {error}"
            + (f"; {needs}" if needs else "")
        ) from error
