"""Generated code against the oracle's interpreter, step by step: both are given the same inputs.

After each input both must be in the same state with the same data, must have sent the same, in the same
order, and started and cancelled the same delays. The interpreter is asked three times: with all values
known, with values that may be unknown, and with nothing known of the data before; of the last two, one
of the outcomes must be what the generated code did.

Half of the systems are marked (``tests.campaign.marks``): there it shows, too, which statement failed and when
its error was processed.

``python -m tests.campaign.differential FIRST COUNT`` compares the machines of so many systems.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

import msgspec

from m2c.codegen.context import MachineContext
from m2c.codegen.names import machine_class
from m2c.codegen.ports import PortNames
from m2c.language.values import zero
from m2c.model.machine import ActionThread, Event, EventKind, Machine, OutputKind, Raise
from m2c.model.scopes import event_data_type, readable_ports
from m2c.model.system import System
from m2c.model.walk import events_of, statements_of
from m2c.runtime.machine import EndlessLoopError
from m2c.simulation.program import compile_node
from moon.oracle.program import MachineProgram
from moon.oracle.steps import Delayed, Output, Step, TooOpenError
from moon.oracle.unknowns import Unknown
from tests.campaign.marks import in_blocks, looped, marked
from tests.campaign.plans import read
from tests.campaign.systems import SIZES, make, write
from tests.codegen.harness import Recorder
from tests.mutation.exercise import Values

STEPS = 40
"""Inputs for each machine."""

_SCHEDULED = ("start_delay", "stop_delay", "send_self", "cancel_send")
_SAID = ("log", "fault")


class Input(msgspec.Struct, frozen=True):
    """An event, its message and its parts."""

    event: Event
    message: msgspec.Struct | None = None
    parts: dict[str, Any] = {}


class Done(msgspec.Struct, frozen=True):
    """What one step did, as both sides can say it.

    Attributes:
        state: by its name.
        data: of the variables that make a difference.
        sent: outputs in order: the method, its arguments and its message.
        scheduled: delays started and cancelled, in order.
    """

    state: str
    data: dict[str, Any]
    sent: tuple[Any, ...] = ()
    scheduled: tuple[Any, ...] = ()


class Difference(msgspec.Struct, frozen=True):
    """Where the two sides part."""

    machine: str
    before: Done
    input: Input | None
    generated: Done | str
    interpreted: tuple[Done, ...] | str

    def __str__(self) -> str:
        return "\n".join(
            (
                f"{self.machine}: in {self.before.state} with {self.before.data}",
                f"  given       {self.input or 'its start'}",
                f"  generated   {self.generated}",
                *(f"  interpreted {item}" for item in self._interpreted()),
            )
        )

    def _interpreted(self) -> tuple[object, ...]:
        found = self.interpreted
        return (found,) if isinstance(found, str) else found


def differences(system: System, seed: int, steps: int = STEPS) -> Iterator[Difference]:
    """Where generated code and interpreter differ, of each machine, plugin and thread the first."""
    for machine in (*system.nodes, *system.plugins):
        parts: list[ActionThread | None] = [None, *machine.threads]
        for thread in parts:
            found = _Pair(machine, thread, system, seed).first_difference(steps)
            if found is not None:
                yield found


class _Pair:
    """Both implementations of one machine, or of one of its threads."""

    def __init__(
        self, machine: Machine, thread: ActionThread | None, system: System, seed: int
    ) -> None:
        self._model = machine if thread is None else thread.machine
        self._owner = machine
        self._library = system.library
        self._name = machine.name if thread is None else f"{machine.name}, thread"
        self._draw = Random(f"{seed} {self._name}")
        self._values = Values([self._model], self._draw)
        self._names = PortNames(machine, system.library)
        self._context = MachineContext(self._model, system.library, self._names, {}, "")
        self._program = MachineProgram(self._model, system.library, machine)
        self._ports = {key: zero(kind) for key, kind in readable_ports(machine).items()}
        self._recorder = Recorder()
        self._events = events_of(self._model)
        node = compile_node(machine, system)
        self._classes = _globals(node)
        name = machine_class(machine.name)
        if thread is not None:
            index = machine.threads.index(thread)
            name += "Thread" if not index else f"Thread{index + 1}"
        self._it = self._made(self._classes[name], thread is not None)

    def _made(self, made: Any, is_thread: bool) -> Any:
        """The generated machine, with ports and random values of this test."""
        arguments: list[Any] = [self._recorder]
        wanted = made.__init__.__annotations__
        if "ports" in wanted:
            arguments.append(self._ports)
        if is_thread:
            arguments.append(0)
        if "random" in wanted:
            arguments.append(self._draw.random)
        return made(*arguments)

    # -- the comparison ---------------------------------------------------------------------------

    def first_difference(self, steps: int) -> Difference | None:
        """The first, in a run of ``steps`` inputs."""
        before = Done("", {})
        given: Input | None = None
        for _ in range(steps + 1):
            old = self._all_data() if given is not None else {}
            made = self._generated(given)
            if isinstance(made, str):
                return Difference(self._name, before, given, made, "")
            for found in self._interpreted(before.state, old, given):
                if not any(allows(item, made) for item in found):
                    return Difference(self._name, before, given, made, found)
            before = msgspec.structs.replace(made, sent=(), scheduled=())
            if not self._events:
                return None
            given = self._input(before.state)
        return None

    def _input(self, state: str) -> Input:
        """What may come next: the state takes it, most often."""
        draw = self._draw
        handled = [
            item for item in self._events if self._program.handles(self._index(state), _key(item))
        ]
        event = draw.choice(handled if handled and draw.random() < 0.9 else self._events)
        if event.kind is EventKind.INTERNAL:
            sent = [item.event for item in statements_of(self._model) if isinstance(item, Raise)]
            name = event.name.removesuffix("*").removesuffix(".")
            event = Event(event.kind, draw.choice([name, *sent]) or "some")
        kind = event_data_type(event, self._owner, self._library)
        port = self._names.event(event)
        numbers = {"goal_id": draw.randint(0, 3), "thread_id": draw.randint(0, 1), "code": 4}
        parts = {name: numbers[name] for name, _ in port.parameters if name in numbers}
        if event.kind is EventKind.BT_CHILD_STATUS:
            parts["status"] = draw.choice(("SUCCESS", "FAILURE", "RUNNING"))
        for key, value in self._ports.items():
            if isinstance(value, int) and not isinstance(value, bool):
                self._ports[key] = draw.randint(0, 4)
        return Input(event, None if kind is None else self._values.message(kind), parts)

    def _index(self, state: str) -> int:
        return next(n for n, item in enumerate(self._model.states) if item.name == state)

    # -- generated code ---------------------------------------------------------------------------

    def _generated(self, given: Input | None) -> Done | str:
        self._recorder.sent.clear()
        try:
            self._run(given)
        except EndlessLoopError:
            pass  # the node reports it, and lives
        except Exception as error:  # whatever it raises ends its node
            return f"{type(error).__name__}: {error}"
        heard = [
            (item[0], *(plain(value) for value in item[1:] if not callable(value)))
            for item in self._recorder.sent
        ]
        return Done(
            self._it.state.value,
            {name: value for name, value in self._all_data().items() if self._is_live(name)},
            tuple(item for item in heard if item[0] not in (*_SCHEDULED, *_SAID)),
            tuple(item for item in heard if item[0] in _SCHEDULED),
        )

    def _run(self, given: Input | None) -> None:
        if given is None:
            self._it.start()
            return
        port = self._names.event(given.event)
        method = getattr(self._it, port.method, None)
        if method is None:
            return
        if given.event.kind is EventKind.INTERNAL:
            method(given.event.name, None)
        elif given.event.kind is EventKind.AFTER:
            method(given.event.name)
        else:
            arguments = list(given.parts.values())
            if given.message is not None:
                wanted = self._classes[method.__annotations__[port.data_name]]
                packed = msgspec.msgpack.encode(given.message)
                arguments.insert(0, msgspec.msgpack.decode(packed, type=wanted))
            method(*arguments)

    def _is_live(self, name: str) -> bool:
        return name in self._program.live

    def _all_data(self) -> dict[str, Any]:
        return {
            data.name: plain(getattr(self._it, self._context.attribute(data.name)))
            for data in self._model.data
        }

    # -- the interpreter --------------------------------------------------------------------------

    def _interpreted(
        self, state: str, old: Mapping[str, Any], given: Input | None
    ) -> Iterator[tuple[Done, ...]]:
        program = self._program
        if given is None:
            yield self._outcomes(program.start(program.initial_data()))
            return
        known = tuple(old[name] for name in program.names)
        parts = {**given.parts, **{f"port:{key}": value for key, value in self._ports.items()}}
        parts["name"] = given.event.name
        message = None if given.message is None else plain(given.message)
        wanted = [(known, True), (program.unknown_data(), True)]
        if not program.draws:
            wanted.insert(0, (known, False))
        for data, symbolic in wanted:
            arguments = (self._index(state), data, _key(given.event), message, parts, symbolic)
            try:
                found = self._outcomes(iter(program.take(*arguments)))
            except TooOpenError:
                continue
            yield found

    def _outcomes(self, steps: Iterator[tuple[bool, Step]]) -> tuple[Done, ...]:
        return tuple(
            Done(
                self._model.states[step.state].name,
                {
                    name: plain(value)
                    for name, value in zip(self._program.names, step.data, strict=True)
                    if self._is_live(name)
                },
                tuple(self._output(item) for item in step.outputs),
                tuple(_delay(item) for item in step.scheduled if not isinstance(item, Output)),
            )
            for _, step in steps
        )

    def _output(self, output: Any) -> tuple[Any, ...]:
        kind = output.kind
        interface = output.interface
        port = self._names.output(kind, interface)
        fields = output.fields or {}
        given = {
            "goal_id": output.goal if output.goal is not None else 0,
            "thread_id": output.thread if output.thread is not None else 0,
            "key": interface,
            "child": int(interface) if interface.isdigit() else None,
            **fields,
        }
        if kind is OutputKind.SEND_CANCEL:
            given["goal_id"] = output.goal
        arguments = [plain(given[name]) for name, _ in port.parameters]
        if port.data is not None:
            arguments.append(plain(fields))
        return (port.method, *arguments)


def _globals(node: Any) -> dict[str, Any]:
    """What a generated package's module ``node`` knows, and what it imported."""
    return {**node.__init__.__globals__}


def _key(event: Event) -> tuple[EventKind, str]:
    return event.kind, event.name


def _delay(item: Any) -> tuple[Any, ...]:
    if not isinstance(item, Delayed):
        return ("cancelled", item)
    if item.event[0] is EventKind.AFTER:
        return ("start_delay", item.event[1], item.delay_s)
    return ("send_self", item.event[1], plain(item.data), item.delay_s, item.id)


def plain(value: Any) -> Any:
    """A value as numbers, texts, lists and maps."""
    match value:
        case Unknown():
            return value
        case msgspec.Struct():
            return {name: plain(getattr(value, name)) for name in value.__struct_fields__}
        case list() | tuple():
            return [plain(item) for item in value]
        case dict():
            return {key: plain(item) for key, item in value.items()}
        case _:
            return value


def allows(interpreted: Any, generated: Any) -> bool:
    """Whether the outcome of the interpreter is, or may turn out to be, what the generated code did."""
    match interpreted:
        case Unknown():
            return interpreted.anything or interpreted.allows(generated) or generated != generated
        case Done():
            return all(
                allows(getattr(interpreted, name), getattr(generated, name))
                for name in interpreted.__struct_fields__
            )
        case tuple() | list():
            return (
                isinstance(generated, list | tuple)
                and len(interpreted) == len(generated)
                and all(map(allows, interpreted, generated))
            )
        case dict():
            return (
                isinstance(generated, dict)
                and interpreted.keys() == generated.keys()
                and all(allows(item, generated[key]) for key, item in interpreted.items())
            )
        case "cancelled":
            return generated in ("stop_delay", "cancel_send")
        case float() if interpreted != interpreted:
            return isinstance(generated, float) and generated != generated
        case _:
            return (type(interpreted) is type(generated) and interpreted == generated) or (
                _is_number(interpreted) and _is_number(generated) and interpreted == generated
            )


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def differences_of(seed: int, size: int, folder: Path) -> list[Difference]:
    """Those of the system of a seed, half of which are marked; half have several blocks, some loops."""
    plan = make(seed, size)
    plan = in_blocks(plan) if seed % 4 in (1, 2) else plan
    plan = looped(plan) if seed % 5 == 3 else plan
    path = write(marked(plan) if seed % 2 else plan, folder)
    return list(differences(read(path), seed))


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Compare generated code with the interpreter.")
    parser.add_argument("first", type=int)
    parser.add_argument("count", type=int)
    chosen = parser.parse_args()
    different = 0
    for seed in range(chosen.first, chosen.first + chosen.count):
        with TemporaryDirectory() as folder:
            found = differences_of(seed, SIZES[seed % len(SIZES)], Path(folder))
        different += bool(found)
        for item in found:
            print(f"seed {seed}: {item}", flush=True)
    print(f"{chosen.count} systems from seed {chosen.first}, {different} with a difference")
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
