"""Values and channels of single nodes that a command line gives, over what the system file says."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import msgspec

from m2c.changes import Changes
from m2c.diagnostics import DiagnosticLog, Position
from m2c.language.parsing import parse_expression
from m2c.model.instances import Instance, Parameter, Remap
from m2c.model.loading import linked
from m2c.model.machine import Machine
from m2c.model.naming import absolute
from m2c.model.system import System
from m2c.suggestions import nearest

PARAMETER, REMAP = "--param", "--remap"


def with_changes(system: System, changes: Changes, log: DiagnosticLog) -> System:
    """``system`` with what is said of its nodes and plugins, and of how its values convert.

    Args:
        system: as it was read.
        changes: its parameters are ``NODE.NAME=EXPRESSION``, its remaps ``NODE:CHANNEL:=CHANNEL``; of
            what is said twice the last counts.
        log: where ``bad-override`` and ``unknown-parameter`` go, and faults of an expression.
    """
    if changes.parameters or changes.remaps:
        system = _overridden(system, changes, log)
    return system.made_lenient() if changes.lenient else system


def _overridden(system: System, changes: Changes, log: DiagnosticLog) -> System:
    known = [machine.name for machine in (*system.nodes, *system.plugins)]
    parameters: dict[str, dict[str, Parameter]] = {}
    remaps: dict[str, dict[str, Remap]] = {}
    for text in changes.parameters:
        for node, value in _parameter(text, known, log):
            parameters.setdefault(node, {})[value.name] = value
    for text in changes.remaps:
        for node, remap in _remap(text, known, log):
            remaps.setdefault(node, {})[remap.channel] = remap

    def made(machine: Machine) -> Machine:
        values = tuple(parameters.get(machine.name, {}).values())
        channels = tuple(remaps.get(machine.name, {}).values())
        if not values and not channels:
            return machine
        return Instance(parameters=values, remaps=channels).of(machine, log)

    nodes, plugins = tuple(map(made, system.nodes)), tuple(map(made, system.plugins))
    return linked(msgspec.structs.replace(system, nodes=nodes, plugins=plugins), log)


def _parameter(
    text: str, known: Sequence[str], log: DiagnosticLog
) -> Iterator[tuple[str, Parameter]]:
    """What ``text`` says of which node; nothing after an error."""
    place, equals, expression = text.partition("=")
    node, dot, name = place.rpartition(".")
    if not (equals and dot and node and name and expression):
        _refuse(PARAMETER, text, "expected NODE.NAME=EXPRESSION, like GoTo.poi=3", log)
    elif _is_known(node, known, PARAMETER, text, log):
        value = parse_expression(expression, _at(PARAMETER, text, len(place) + 1), "", log)
        if value is not None:
            yield node, Parameter(name, expression, value, _at(PARAMETER, text, len(node) + 1))


def _remap(text: str, known: Sequence[str], log: DiagnosticLog) -> Iterator[tuple[str, Remap]]:
    """What ``text`` says of which node; nothing after an error."""
    node, colon, channels = text.partition(":")
    channel, equals, by = channels.partition(":=")
    if not (colon and equals and node and channel and by):
        _refuse(REMAP, text, "expected NODE:CHANNEL:=CHANNEL, like GoTo:/goal:=/dock", log)
    elif _is_known(node, known, REMAP, text, log):
        yield node, Remap(absolute(channel), absolute(by), _at(REMAP, text, len(node) + 1))


def _at(option: str, text: str, offset: int) -> Position:
    """The character of ``text`` at ``offset``, as messages name it."""
    return Position(f"{option} {text}", 1, offset + 1)


def _is_known(node: str, known: Sequence[str], option: str, text: str, log: DiagnosticLog) -> bool:
    if node not in known:
        _refuse(option, text, f"there is no node `{node}`; {nearest(node, known)}", log)
    return node in known


def _refuse(option: str, text: str, why: str, log: DiagnosticLog) -> None:
    what, _, hint = why.partition("; ")
    log.error("bad-override", _at(option, text, 0), "", what, hint)
