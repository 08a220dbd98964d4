"""Traces of a machine with something changed: what it did not do, or can have done all the same."""

from __future__ import annotations

from collections.abc import Callable
from random import Random

import msgspec

from m2c.model.machine import InterfaceKind, Machine
from tests.mutation import mutants
from tests.oracle.steps import Call
from tests.oracle.traces import LAST_STAMP_NS, MS, SENT, Trace, conforming, numbered, observation
from transports.interface import Observation, ObservationKind

Change = Callable[[Machine, list[Observation], int, Random], list[Observation]]


def _outputs(machine: Machine, heard: list[Observation]) -> list[int]:
    kinds = set(SENT.values())
    return [
        index
        for index, item in enumerate(heard)
        if item.source == machine.name and item.kind in kinds
    ]


def _others(machine: Machine, heard: list[Observation]) -> list[int]:
    outputs = set(_outputs(machine, heard))
    return [index for index in range(len(heard)) if index not in outputs]


def _altered(item: Observation, draw: Random) -> Observation:
    data = dict(item.data or {})
    if not data:
        return item
    name = draw.choice(sorted(data))
    if isinstance(data[name], bool):
        data[name] = not data[name]
    else:
        data[name] = (data[name] + draw.randint(1, 3)) % 4
    return msgspec.structs.replace(item, data=data)


def _moved(heard: list[Observation], index: int, end_ns: int, draw: Random) -> list[Observation]:
    latest_ns = min(end_ns - 1, LAST_STAMP_NS)
    shift_ns = draw.choice((-260, -150, -30, -2, 2, 30, 150, 260)) * MS + draw.randint(1, 90)
    stamp_ns = min(max(heard[index].stamp_ns + shift_ns, MS), latest_ns)
    taken = {item.stamp_ns for item in heard}
    while stamp_ns in taken:
        stamp_ns -= 1
    heard[index] = msgspec.structs.replace(heard[index], stamp_ns=stamp_ns, received_ns=stamp_ns)
    return heard


def _output_altered(
    machine: Machine, heard: list[Observation], _: int, draw: Random
) -> list[Observation]:
    if found := _outputs(machine, heard):
        index = draw.choice(found)
        heard[index] = _altered(heard[index], draw)
    return heard


def _output_dropped(
    machine: Machine, heard: list[Observation], _: int, draw: Random
) -> list[Observation]:
    if found := _outputs(machine, heard):
        del heard[draw.choice(found)]
    return heard


def _output_doubled(
    machine: Machine, heard: list[Observation], end_ns: int, draw: Random
) -> list[Observation]:
    if found := _outputs(machine, heard):
        heard.append(heard[draw.choice(found)])
        return _moved(heard, len(heard) - 1, end_ns, draw)
    return heard


def _outputs_swapped(
    machine: Machine, heard: list[Observation], _: int, draw: Random
) -> list[Observation]:
    found = _outputs(machine, heard)
    if len(found) >= 2:
        one, other = draw.sample(found, 2)
        stamps = heard[one].stamp_ns, heard[other].stamp_ns
        for index, stamp_ns in zip((other, one), stamps, strict=True):
            heard[index] = msgspec.structs.replace(
                heard[index], stamp_ns=stamp_ns, received_ns=stamp_ns
            )
    return heard


def _output_moved(
    machine: Machine, heard: list[Observation], end_ns: int, draw: Random
) -> list[Observation]:
    if found := _outputs(machine, heard):
        return _moved(heard, draw.choice(found), end_ns, draw)
    return heard


def _output_on_another_channel(
    machine: Machine, heard: list[Observation], _: int, draw: Random
) -> list[Observation]:
    channels = [
        item.channel or "" for item in machine.interfaces if item.kind is InterfaceKind.PUBLISHER
    ]
    found = [
        index for index in _outputs(machine, heard) if heard[index].kind is ObservationKind.MESSAGE
    ]
    if found and len(channels) > 1:
        index = draw.choice(found)
        other = next(name for name in channels if name != heard[index].channel)
        heard[index] = msgspec.structs.replace(heard[index], channel=other)
    return heard


def _output_from_nowhere(
    machine: Machine, heard: list[Observation], end_ns: int, draw: Random
) -> list[Observation]:
    for item in machine.interfaces:
        if item.kind is InterfaceKind.PUBLISHER and heard:
            data = {"data": draw.randint(0, 3)}
            stamp_ns = draw.choice(heard).stamp_ns
            made = observation(
                ObservationKind.MESSAGE, item.channel or "", data, stamp_ns, machine.name, Call()
            )
            return _moved([*heard, made], len(heard), end_ns, draw)
    return heard


def _input_altered(
    machine: Machine, heard: list[Observation], _: int, draw: Random
) -> list[Observation]:
    if found := _others(machine, heard):
        index = draw.choice(found)
        heard[index] = _altered(heard[index], draw)
    return heard


def _input_dropped(
    machine: Machine, heard: list[Observation], _: int, draw: Random
) -> list[Observation]:
    if found := _others(machine, heard):
        del heard[draw.choice(found)]
    return heard


def _input_moved(
    machine: Machine, heard: list[Observation], end_ns: int, draw: Random
) -> list[Observation]:
    if found := _others(machine, heard):
        return _moved(heard, draw.choice(found), end_ns, draw)
    return heard


def _message_doubled(
    machine: Machine, heard: list[Observation], end_ns: int, draw: Random
) -> list[Observation]:
    found = [
        index for index in _others(machine, heard) if heard[index].kind is ObservationKind.MESSAGE
    ]
    if found:
        heard.append(heard[draw.choice(found)])
        return _moved(heard, len(heard) - 1, end_ns, draw)
    return heard


CHANGES: tuple[Change, ...] = (
    _output_altered,
    _output_dropped,
    _output_doubled,
    _outputs_swapped,
    _output_moved,
    _output_on_another_channel,
    _output_from_nowhere,
    _input_altered,
    _input_dropped,
    _input_moved,
    _message_doubled,
)


def perturbed(machine: Machine, draw: Random) -> tuple[Trace, str]:
    """A trace that may or may not conform, and what was done to it."""
    if draw.random() < 0.35:
        found = list(mutants(machine))
        if found:
            mutant = draw.choice(found)
            return conforming(mutant.machine, draw), mutant.description
    trace = conforming(machine, draw)
    names: list[str] = []
    wanted = draw.choice((1, 1, 1, 2))
    for _ in range(4 * wanted):  # a change may find nothing to change
        change = draw.choice(CHANGES)
        heard = numbered(change(machine, list(trace.observations), trace.end_ns, draw))
        if heard != trace.observations:
            trace = Trace(heard, trace.end_ns)
            names.append(change.__name__.strip("_").replace("_", " "))
        if len(names) == wanted:
            break
    return trace, ", ".join(names) or "nothing found to change"
