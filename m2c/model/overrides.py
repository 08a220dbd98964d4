"""Values and channels of single nodes that a command line gives, over what the system file says."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import msgspec

from m2c.diagnostics import DiagnosticLog, Position
from m2c.language.parsing import parse_expression
from m2c.model.instances import Instance, Parameter, Remap
from m2c.model.loading import linked
from m2c.model.machine import Machine
from m2c.model.naming import absolute
from m2c.model.system import System
from m2c.suggestions import nearest

PARAMETER, REMAP = "--param", "--remap"


def overridden(
    system: System, parameters: Sequence[str], remaps: Sequence[str], log: DiagnosticLog
) -> System:
    """``system`` with what is said of its nodes and plugins.

    Args:
        system: as it was read.
        parameters: ``NODE.NAME=EXPRESSION``: what a variable begins with.
        remaps: ``NODE:CHANNEL:=CHANNEL``: the channel that takes the place of one of the node's.
        log: where ``bad-override`` and ``unknown-parameter`` go, and faults of an expression.
    """
    if not parameters and not remaps:
        return system
    given: dict[str, Instance] = {}
    known = [machine.name for machine in (*system.nodes, *system.plugins)]
    for text in parameters:
        _note(given, _parameter(text, known, log))
    for text in remaps:
        _note(given, _remap(text, known, log))

    def made(machine: Machine) -> Machine:
        return given[machine.name].of(machine, log) if machine.name in given else machine

    changed = msgspec.structs.replace(
        system, nodes=tuple(map(made, system.nodes)), plugins=tuple(map(made, system.plugins))
    )
    return linked(changed, log)


_Said = tuple[str, Callable[[Instance], Instance]]
"""A node, and what is said of it."""


def _note(given: dict[str, Instance], said: _Said | None) -> None:
    if said is not None:
        node, add = said
        given[node] = add(given.get(node) or Instance())


def _parameter(text: str, known: Sequence[str], log: DiagnosticLog) -> _Said | None:
    place, equals, expression = text.partition("=")
    node, dot, name = place.rpartition(".")
    if not (equals and dot and node and name and expression):
        _refuse(PARAMETER, text, "expected NODE.NAME=EXPRESSION, like GoTo.poi=3", log)
        return None
    if not _is_known(node, known, PARAMETER, text, log):
        return None
    at = _at(PARAMETER, text, len(place) + 1)
    value = parse_expression(expression, at, "", log)
    if value is None:
        return None
    one = Parameter(name, expression, value, _at(PARAMETER, text, len(node) + 1))
    return node, lambda so_far: msgspec.structs.replace(
        so_far, parameters=(*(item for item in so_far.parameters if item.name != name), one)
    )


def _remap(text: str, known: Sequence[str], log: DiagnosticLog) -> _Said | None:
    node, colon, channels = text.partition(":")
    channel, equals, by = channels.partition(":=")
    if not (colon and equals and node and channel and by):
        _refuse(REMAP, text, "expected NODE:CHANNEL:=CHANNEL, like GoTo:/goal:=/dock", log)
        return None
    if not _is_known(node, known, REMAP, text, log):
        return None
    one = Remap(absolute(channel), absolute(by), _at(REMAP, text, len(node) + 1))
    return node, lambda so_far: msgspec.structs.replace(
        so_far, remaps=(*(item for item in so_far.remaps if item.channel != one.channel), one)
    )


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
