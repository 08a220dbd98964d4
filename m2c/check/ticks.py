"""Whether the services that answer ticks say what a behaviour tree understands.

``bt_interfaces`` may be the user's own, and may differ from the built-in one: what a status means may not.
"""

from __future__ import annotations

import re
from pathlib import Path

from m2c.diagnostics import DiagnosticLog, Position
from m2c.language.datatypes import is_integer
from m2c.model.interfaces import ServiceType
from m2c.model.machine import InterfaceKind
from m2c.model.system import System
from m2c.policy.forwarding import ANSWERS
from m2c.policy.leaves import TICK_KINDS

_CONTRACT = ", ".join(f"{name} is {number}" for name, number in ANSWERS.items())


def check_ticks(system: System, log: DiagnosticLog) -> None:
    """Report ``tick-contract`` for each type of a served tick that a policy would misunderstand."""
    served = {
        interface.type_name: interface.position
        for machine in system.nodes
        for interface in machine.interfaces
        if interface.kind is InterfaceKind.SERVER
        and interface.type_name.rpartition("/")[2] in TICK_KINDS
    }
    for name, position in served.items():
        try:
            service = system.library.service(name)
        except KeyError:
            continue  # reported where it is declared
        _check_response(service, system.library.file(name), position, log)


def _check_response(
    service: ServiceType, file: Path | None, position: Position, log: DiagnosticLog
) -> None:
    status = service.response.field("status")
    if status is None or not is_integer(status):
        at = _place(file, "status", position)
        what = f"the response of {service.name} has no integer field `status`"
        log.error("tick-contract", at, "", what, f"a policy reads it: {_CONTRACT}")
    for name, _, value in service.response.constants:
        means = next((word for word in ANSWERS if name in (word, f"SKILL_{word}")), None)
        if means is not None and value != ANSWERS[means]:
            what = f"`{name}` of {service.name} is {value}"
            hint = f"to a policy, {_CONTRACT}"
            log.error("tick-contract", _place(file, name, position), "", what, hint)


def _place(file: Path | None, name: str, otherwise: Position) -> Position:
    """Where the definition has the word ``name``; its first line if it has not."""
    if file is None:
        return otherwise
    for number, line in enumerate(file.read_text(errors="replace").splitlines(), 1):
        found = re.search(rf"\b{name}\b", line.partition("#")[0])
        if found is not None:
            return Position(str(file), number, found.start() + 1)
    return Position(str(file), 1, 1)
