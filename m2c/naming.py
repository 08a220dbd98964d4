"""Which names the transport of a command line takes."""

from __future__ import annotations

from m2c.model.naming import Naming
from m2c.terminal import fail
from transports.interface import TransportError
from transports.registry import available, name_rules


def naming_for(transport: str | None) -> Naming:
    """What ``transport`` takes; without one, what each does. Ends the process if it is not installed."""
    if transport is not None and transport not in available():
        known = ", ".join(available())
        fail(f"no transport `{transport}` is installed; installed: {known}")
    try:
        rules = name_rules()
    except TransportError as error:
        fail(str(error))
    if transport is None:
        return Naming(rules)
    return Naming({name: rules[name] for name in rules if name == transport}, chosen=True)
