"""Running a system on the simulated transport with its oracles, and somebody who asks everything."""

from __future__ import annotations

import logging
import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
import pytest

from m2c.model.machine import Interface, InterfaceKind
from m2c.model.system import System
from m2c.runtime.messages import message_class
from m2c.simulation.program import compile_system
from m2c.simulation.run import SimulatedRun
from moon.monitor.models import ModelMonitor
from moon.verdict import Outcome, Verdict
from tests.hostile.texts import MARK
from transports.interface import Action, GoalEvents, Service, Topic
from transports.simulated import SimulatedTransport, SimulatedWorld

SECONDS = 1.2
"""Of virtual time: every state of the models is entered."""


class Ran(msgspec.Struct):
    """What came of a run: verdicts against the models, what was logged, and how much was observed."""

    violations: list[Verdict]
    faults: list[str]
    logged: set[str]
    observations: int


def run(system: System) -> Ran:
    """Run ``system`` for :data:`SECONDS`, judged by the oracles of its models."""
    world = SimulatedWorld(1)
    monitor = ModelMonitor(system.nodes, system.library)
    verdicts: list[Verdict] = []
    count = 0

    def hear(observation: Any) -> None:
        nonlocal count
        count += 1
        verdicts.extend(monitor.feed(observation))

    records = _Records()
    root = logging.getLogger()
    level = root.level
    root.addHandler(records)
    root.setLevel(logging.INFO)
    try:
        for oracle in monitor.oracles.values():
            oracle.start(world.now_ns)
        listener = SimulatedTransport(world, "zq listener")
        listener.tap([], hear)
        listener.every(0.02, lambda: verdicts.extend(monitor.advance(world.now_ns)))
        running = SimulatedRun(compile_system(system), world)
        _ask_everything(world, system)
        running.run(SECONDS)
        verdicts.extend(monitor.advance(world.now_ns + 10**9))
    finally:
        root.removeHandler(records)
        root.setLevel(level)
        world.close()
    violations = [item for item in verdicts if item.outcome is Outcome.VIOLATED]
    return Ran(violations, records.faults, records.texts, count)


class _Records(logging.Handler):
    def __init__(self) -> None:
        super().__init__()
        self.texts: set[str] = set()
        self.faults: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.texts.add(record.getMessage())
        if record.levelno >= logging.ERROR:
            self.faults.append(record.getMessage())


def _ask_everything(world: SimulatedWorld, system: System) -> None:
    """A further node: publishes to each subscriber, calls each server, sends each a goal."""
    node = SimulatedTransport(world, "zq asking")
    for number, interface in enumerate(
        interface for machine in system.nodes for interface in machine.interfaces
    ):
        ask = _asking(node, system, interface)
        if ask is not None:
            for delay_s in (0.13, 0.47):
                node.after(delay_s + number * 0.011, ask)


def _asking(node: SimulatedTransport, system: System, interface: Interface) -> Any:
    channel, kind, library = interface.channel, interface.type_name, system.library
    if channel is None:
        return None
    match interface.kind:
        case InterfaceKind.SUBSCRIBER:
            message = message_class(library.message(kind))
            publisher = node.publisher(Topic(channel, kind, message))
            return lambda: publisher.publish(message())
        case InterfaceKind.SERVER:
            service = library.service(kind)
            request, response = message_class(service.request), message_class(service.response)
            client = node.client(Service(channel, kind, request, response))
            return lambda: client.call(request(), lambda _: None)
        case InterfaceKind.ACTION_SERVER:
            action = library.action(kind)
            parts = (message_class(part) for part in (action.goal, action.result, action.feedback))
            made = Action(channel, kind, *parts)
            goals = node.action_client(made)
            return lambda: goals.send_goal(made.goal(), _DEAF)
    return None


_DEAF = GoalEvents(*(lambda *_: None for _ in GoalEvents.__struct_fields__))


@contextmanager
def no_payload_runs() -> Iterator[None]:
    """Within, whatever starts a program for a payload fails."""
    with pytest.MonkeyPatch.context() as patch:
        for owner, name in ((os, "system"), (os, "popen"), (subprocess, "Popen")):
            patch.setattr(owner, name, _watched(getattr(owner, name)))
        yield


def _watched(real: Any) -> Any:
    def call(*arguments: Any, **options: Any) -> Any:
        assert MARK not in repr((arguments, options)), f"a payload ran: {arguments!r}"
        return real(*arguments, **options)

    return call
