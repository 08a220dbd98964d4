"""Partners that make a machine do what the tour alone does not: odd callers, odd answers.

They are made from a machine's interfaces. Numbers and texts are drawn from the machine's own constants
and their neighbours, so that both sides of every condition are reached.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator
from random import Random
from typing import Any

import msgspec

from m2c.language.datatypes import INTEGER_RANGES, Array, DataType, Primitive, Structure
from m2c.language.expressions import Literal, Unary
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import Interface, InterfaceKind, Machine
from m2c.runtime.messages import message_class
from transports.actions import CancelRequest, parts_of
from transports.interface import (
    Action,
    CallResult,
    GoalEvents,
    GoalHandle,
    GoalStatus,
    Request,
    Service,
    Topic,
)
from transports.simulated import SimulatedTransport, SimulatedWorld

CALLERS = 2
"""Nodes that call: one alone never asks again before it is answered."""

_PAUSES_S = (0.0, 0.0005, 0.003, 0.05, 0.25, 0.25, 0.6, 0.6, 1.3)
"""Between two things that a caller does: at once, within a call under way, far apart; seldom very
far, so that timers come to their end."""
_LONG_PAUSE_S = 4.0
_LONG_PAUSES = 0.03

_ANSWERS_AFTER_S = (0.0, 0.0, 0.001, 0.01, 0.08, 0.3, 1.0)
_NO_ANSWER = 0.01
_FAILED = 0.12
_UNANSWERED = 0.08
_LIVES_S = (2.0, 6.0, 15.0)
_DOWN_NS = 200_000_000


class Values:
    """Draws messages.

    Args:
        machines: whose constants are of interest.
        draw: the source of randomness.
    """

    def __init__(self, machines: Iterable[Machine], draw: Random) -> None:
        self._draw = draw
        integers = {0, 1, 2}
        fractions: set[float] = set()
        texts = {"", "a", "x"}
        for value in _literals(tuple(machines)):
            match value:
                case bool():
                    pass
                case int():
                    integers |= {value - 1, value, value + 1}
                case float():
                    fractions |= {value - 1, value, value + 1}
                case str():
                    texts.add(value)
        self._integers = sorted(integers)
        self._fractions = sorted(fractions.union(map(float, integers)))
        self._texts = sorted(texts)

    def message(self, structure: Structure) -> msgspec.Struct:
        """A message of the type ``structure``."""
        fields = {name: self._value(kind) for name, kind in structure.fields}
        return message_class(structure)(**fields)

    def _value(self, kind: DataType) -> Any:
        draw = self._draw
        match kind:
            case Primitive("bool"):
                return draw.random() < 0.6
            case Primitive("string"):
                return draw.choice(self._texts)
            case Primitive(name) if name in INTEGER_RANGES:
                low, high = INTEGER_RANGES[name]
                number = draw.choice(self._integers) if draw.random() < 0.8 else draw.randrange(101)
                return min(max(number, low), high)
            case Primitive():
                return draw.choice(self._fractions)
            case Structure():
                return self.message(kind)
            case Array(element, length, fixed):
                size = length if fixed and length is not None else draw.randrange(4)
                return [self._value(element) for _ in range(size)]


def _literals(value: Any) -> Iterator[Any]:
    """The values of all literals in ``value``; of ``-1`` it is -1."""
    match value:
        case Unary(operator="-", operand=Literal(value=int() | float() as number)):
            yield -number
        case tuple():
            for item in value:
                yield from _literals(item)
        case Literal():
            yield value.value
        case msgspec.Struct():
            for name in value.__struct_fields__:
                yield from _literals(getattr(value, name))


def service_of(interface: Interface, library: InterfaceLibrary) -> Service:
    """The service of a server or client."""
    found = library.service(interface.type_name)
    return Service(
        _channel(interface), found.name, message_class(found.request), message_class(found.response)
    )


def action_of(interface: Interface, library: InterfaceLibrary) -> Action:
    """The action of an action server or client."""
    found = library.action(interface.type_name)
    return Action(
        _channel(interface),
        found.name,
        message_class(found.goal),
        message_class(found.result),
        message_class(found.feedback),
    )


def _channel(interface: Interface) -> str:
    assert interface.channel is not None, interface.name
    return interface.channel


# -- callers --------------------------------------------------------------------------------------


def callers(
    world: SimulatedWorld,
    machine: Machine,
    library: InterfaceLibrary,
    topics: bool = True,
    number: int = CALLERS,
) -> None:
    """Nodes that call what ``machine`` serves, send it goals and (``topics``) publish to it."""
    for count in range(number):
        _Caller(world, machine, library, topics, count)


class _Caller:
    def __init__(
        self,
        world: SimulatedWorld,
        machine: Machine,
        library: InterfaceLibrary,
        topics: bool,
        number: int,
    ) -> None:
        self._draw = draw = Random(f"{world.seed}/caller/{number}")
        self._values = Values([machine], draw)
        self._node = node = SimulatedTransport(world, f"caller_{number}")
        self._acts: list[Callable[[], None]] = []
        for interface in machine.interfaces:
            if interface.kind is InterfaceKind.SERVER:
                self._acts.append(self._call(interface, library))
            elif interface.kind is InterfaceKind.ACTION_SERVER:
                self._acts.append(self._goal(interface, library))
            elif interface.kind is InterfaceKind.SUBSCRIBER and topics:
                self._acts.append(self._message(interface, library))
        node.announce()
        if self._acts:
            node.after(0.3 + draw.random(), self._act)

    def _act(self) -> None:
        draw = self._draw
        draw.choice(self._acts)()
        pause = draw.choice(_PAUSES_S) * (0.5 + draw.random())
        if draw.random() < _LONG_PAUSES:
            pause = _LONG_PAUSE_S
        self._node.after(pause, self._act)

    def _message(self, interface: Interface, library: InterfaceLibrary) -> Callable[[], None]:
        kind = library.message(interface.type_name)
        topic = Topic(_channel(interface), kind.name, message_class(kind))
        publisher = self._node.publisher(topic)
        return lambda: publisher.publish(self._values.message(kind))

    def _call(self, interface: Interface, library: InterfaceLibrary) -> Callable[[], None]:
        client = self._node.client(service_of(interface, library))
        kind = library.service(interface.type_name).request
        return lambda: client.call(self._values.message(kind), _forget_result)

    def _goal(self, interface: Interface, library: InterfaceLibrary) -> Callable[[], None]:
        client = self._node.action_client(action_of(interface, library))
        kind = library.action(interface.type_name).goal
        draw, node = self._draw, self._node
        events = GoalEvents(_forget, _forget, _forget, _forget, _forget)

        def send() -> None:
            goal_id = client.send_goal(self._values.message(kind), events)
            if draw.random() < 0.4:
                node.after(draw.choice((0.0, 0.2, 2.0)), lambda: client.cancel(goal_id))

        return send


def _forget(*_: object) -> None:
    """Callers do not mind how it ends."""


def _forget_result(_: CallResult) -> None:
    """Callers do not mind how it ends."""


# -- answerers ------------------------------------------------------------------------------------


def answerers(world: SimulatedWorld, machine: Machine, library: InterfaceLibrary) -> None:
    """A node that serves what ``machine`` calls: right, wrong, late, with an error, or not at all.

    One that serves actions dies now and then, and is there again soon: its goals are over then.
    """
    draw = Random(f"{world.seed}/answerer")

    def begin(_: object = None) -> None:
        node = SimulatedTransport(world, "answerer")
        _Answerer(node, machine, library, draw)
        if actions:
            node.after(draw.choice(_LIVES_S), lambda: end(node))

    def end(node: SimulatedTransport) -> None:
        node.close()
        world.schedule(_DOWN_NS, begin, None)

    actions = [
        action_of(interface, library)
        for interface in machine.interfaces
        if interface.kind is InterfaceKind.ACTION_CLIENT
    ]
    begin()
    for action in actions:
        _cancel_others(world, action)


class _Answerer:
    def __init__(
        self, node: SimulatedTransport, machine: Machine, library: InterfaceLibrary, draw: Random
    ) -> None:
        self._draw = draw
        self._values = Values([machine], self._draw)
        self._node = node
        for interface in machine.interfaces:
            if interface.kind is InterfaceKind.CLIENT:
                kind = library.service(interface.type_name).response
                node.serve(service_of(interface, library), self._answer(kind))
            elif interface.kind is InterfaceKind.ACTION_CLIENT:
                found, action = library.action(interface.type_name), action_of(interface, library)
                drive = _Drives(node, self._draw, self._values, found.feedback, found.result)
                node.serve_action(action, drive.goal, drive.cancel)
        node.announce()

    def _answer(self, kind: Structure) -> Callable[[Request], None]:
        draw, node = self._draw, self._node

        def handle(request: Request) -> None:
            chance = draw.random()
            if chance < _NO_ANSWER:
                return
            after = draw.choice(_ANSWERS_AFTER_S)
            if chance < _NO_ANSWER + _FAILED:
                node.after(after, lambda: request.fail("not today"))
            else:
                node.after(after, lambda: request.respond(self._values.message(kind)))

        return handle


def _cancel_others(world: SimulatedWorld, action: Action) -> None:
    """A node that now and then has all goals canceled, whoever sent them."""
    draw = Random(f"{world.seed}/meddler")
    node = SimulatedTransport(world, "meddler")
    client = node.client(parts_of(action).cancel_goal)

    def meddle() -> None:
        client.call(CancelRequest(), _forget_result)
        node.after(0.5 + 3 * draw.random(), meddle)

    node.announce()
    node.after(1.0, meddle)


class _Drives:
    """Goals that are accepted or not, and end in every way."""

    def __init__(
        self,
        node: SimulatedTransport,
        draw: Random,
        values: Values,
        feedback: Structure,
        result: Structure,
    ) -> None:
        self._node = node
        self._draw = draw
        self._values = values
        self._feedback = feedback
        self._result = result
        self._running: dict[str, GoalHandle] = {}

    def goal(self, handle: GoalHandle) -> None:
        """A goal has come."""
        chance = self._draw.random()
        if chance < _UNANSWERED:
            return
        accepted = chance < 0.75
        answer = functools.partial(self._accept, handle) if accepted else handle.reject
        self._node.after(self._draw.choice(_ANSWERS_AFTER_S), answer)

    def _accept(self, handle: GoalHandle) -> None:
        handle.accept()
        self._running[handle.goal_id] = handle
        self._go_on(handle, self._draw.randrange(6))

    def _go_on(self, handle: GoalHandle, steps: int) -> None:
        if handle.goal_id not in self._running:
            return
        if steps:
            handle.publish_feedback(self._values.message(self._feedback))
            pause = self._draw.choice((0.01, 0.1, 0.4))
            self._node.after(pause, lambda: self._go_on(handle, steps - 1))
        else:
            chance = self._draw.random()
            self._end(handle, GoalStatus.SUCCEEDED if chance < 0.6 else GoalStatus.ABORTED)

    def cancel(self, handle: GoalHandle) -> None:
        """A goal should be canceled: it is, or ends otherwise first."""
        chance = self._draw.random()
        if chance < 0.6:
            after = self._draw.choice(_ANSWERS_AFTER_S)
            self._node.after(after, lambda: self._end(handle, GoalStatus.CANCELED))
        elif chance < 0.8:
            self._end(handle, GoalStatus.ABORTED)

    def _end(self, handle: GoalHandle, status: GoalStatus) -> None:
        if self._running.pop(handle.goal_id, None) is None:
            return
        result = self._values.message(self._result)
        if status is GoalStatus.SUCCEEDED:
            handle.succeed(result)
        elif status is GoalStatus.CANCELED:
            handle.canceled(result)
        else:
            handle.abort(result)
