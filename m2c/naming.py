"""Which names the transport of a command line takes."""

from __future__ import annotations

from m2c.model.naming import Naming
from m2c.terminal import fail
from transports.descriptions import described
from transports.interface import TransportError
from transports.registry import available, name_rules


def naming_of(transport: str | None) -> Naming:
    """What ``transport`` takes; without one, what each does.

    Raises:
        TransportError: it is not installed, or an installed rule cannot be loaded.
    """
    if transport is not None and transport not in available():
        known = ", ".join(available())
        raise TransportError(f"no transport `{transport}` is installed; installed: {known}")
    rules = name_rules()
    if transport is None:
        return Naming(rules)
    return Naming(
        {name: rules[name] for name in {transport} & rules.keys()},
        chosen=True,
        needs_packages=described(transport).needs_packages,
    )


def naming_for(transport: str | None) -> Naming:
    """The same for a command: ends the process if ``transport`` is not installed."""
    try:
        return naming_of(transport)
    except TransportError as error:
        fail(str(error))
