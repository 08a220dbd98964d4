"""``machine.py`` of a generated package: the state machine as a class, without any transport."""

from __future__ import annotations

from collections.abc import Sequence

from m2c.codegen.context import MachineContext
from m2c.codegen.expressions import quoted
from m2c.codegen.interfaces import zero_text
from m2c.codegen.layout import INDENT, WIDTH, call, indent
from m2c.codegen.names import attribute
from m2c.codegen.ports import EventPort, PortNames, events_of
from m2c.codegen.statements import StatementWriter
from m2c.codegen.transitions import TransitionWriter
from m2c.model.datatypes import Array, DataType, Primitive, Structure, is_integer
from m2c.model.expressions import ObjectLiteral
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import Event, EventKind, Machine, Raise
from m2c.model.walk import statements_of


class MachineWriter:
    """Writes the class of one machine (or of one action thread)."""

    def __init__(
        self,
        machine: Machine,
        library: InterfaceLibrary,
        names: PortNames,
        class_of: dict[str, str],
        class_name: str,
        is_thread: bool = False,
    ) -> None:
        context = MachineContext(machine, library, names, class_of, class_name, is_thread)
        self._context = context
        self.class_name = class_name
        self._statements = StatementWriter(context)
        self._transitions = TransitionWriter(context, self._statements)
        self._events = events_of(machine)
        context.raises = self._can_raise()

    def lines(self) -> list[str]:
        """The enumeration of states and the machine class."""
        methods = self._methods()
        self._extras = self._extra_attributes(methods)
        return [
            *self._state_enumeration(),
            "",
            "",
            *self._class_head(),
            *self._constructor(),
            *methods,
        ]

    def _state_enumeration(self) -> list[str]:
        lines = [f"class {self._context.state_class}(Enum):"]
        lines += [f'{INDENT}"""The states of ``{self._context.machine.name}``."""', ""]
        for state in self._context.machine.states:
            lines.append(f"{INDENT}{self._context.state_names[state.name]} = {quoted(state.name)}")
        return lines

    def _class_head(self) -> list[str]:
        machine = self._context.machine
        lines = [
            f"class {self.class_name}:",
            f'{INDENT}"""The state machine ``{machine.name}``.',
            "",
        ]
        lines.append(
            f"{INDENT}One method per event, each a run to completion; what the machine sends"
        )
        lines.append(f"{INDENT}leaves through ``outputs``, in order.")
        lines += [f'{INDENT}"""', ""]
        constants = [data for data in machine.data if data.name in self._context.constants]
        compiler = self._context.compiler({})
        for data in constants:
            value = compiler.value(data.initial, data.type)
            lines.append(f"{INDENT}{attribute(data.name)}: Final = {value}")
        if constants:
            lines.append("")
        return lines

    def _extra_attributes(self, methods: Sequence[str]) -> list[str]:
        text = "\n".join(methods)
        extras = ["_outputs", "state"]
        if self._context.is_thread:
            extras.append("thread_id")
        if "self._random()" in text or self._initial_uses_random():
            extras.append("_random")
        if "self._ports[" in text or any(
            "PortInput" in repr(data.initial) for data in self._context.machine.data
        ):
            extras.append("_ports")
        if self._context.raises:
            extras.append("_internal")
        return extras

    def _initial_uses_random(self) -> bool:
        return any("function='random'" in repr(data.initial) for data in self._context.machine.data)

    def _constructor(self) -> list[str]:
        variables = [
            data for data in self._context.machine.data if data.name not in self._context.constants
        ]
        slots = sorted([*self._extras, *(attribute(data.name) for data in variables)])
        quoted_slots = [f'"{slot}"' for slot in slots]
        lines = call("__slots__ = ", quoted_slots, 1)
        if len(quoted_slots) == 1:
            lines = [f"{INDENT}__slots__ = ({quoted_slots[0]},)"]
        parameters = ["self", "outputs: Outputs"]
        if "_ports" in self._extras:
            parameters.append("ports: Mapping[str, Any]")
        if self._context.is_thread:
            parameters.append("thread_id: int")
        if "_random" in self._extras:
            parameters.append("random: Callable[[], float] = random.random")
        lines += ["", *call("def __init__", parameters, 1, " -> None:")]
        lines.append(f"{INDENT * 2}self._outputs = outputs")
        if "_ports" in self._extras:
            lines.append(f"{INDENT * 2}self._ports = ports")
        if self._context.is_thread:
            lines.append(f"{INDENT * 2}self.thread_id = thread_id")
        if "_random" in self._extras:
            lines.append(f"{INDENT * 2}self._random = random")
        if self._context.raises:
            lines.append(f"{INDENT * 2}self._internal: deque[tuple[str, Any]] = deque()")
        initial = self._context.state_text(self._context.machine.initial)
        lines.append(f"{INDENT * 2}self.state = {initial}")
        compiler = self._context.compiler({})
        for data in variables:
            value = compiler.value(data.initial, data.type)
            if isinstance(data.initial, ObjectLiteral) and not data.initial.entries:
                value = zero_text(data.type, self._context.class_of)
            annotation = self._annotation(data.type)
            lines.append(f"{INDENT * 2}self.{attribute(data.name)}: {annotation} = {value}")
        return lines

    def _annotation(self, kind: DataType) -> str:
        match kind:
            case Primitive("bool"):
                return "bool"
            case Primitive("string"):
                return "str"
            case Primitive("any") | Primitive("null"):
                return "Any"
            case Primitive() if is_integer(kind):
                return "int"
            case Primitive("number"):
                return "int | float"
            case Primitive():
                return "float"
            case Structure(name) if name:
                return self._context.class_of[name]
            case Array(element, _, _):
                return f"list[{self._annotation(element)}]"
            case _:
                return "dict[str, Any]"

    def _methods(self) -> list[str]:
        lines = self._start_method()
        grouped: dict[str, list[tuple[Event, EventPort]]] = {}
        for event in self._events:
            port = self._context.names.event(event)
            grouped.setdefault(port.method, []).append((event, port))
        for method, events in grouped.items():
            if method in ("on_event", "on_elapsed"):
                lines += self._named_event_method(method, [event for event, _ in events])
            else:
                lines += self._event_method(*events[0])
        for state in self._context.machine.states:
            lines += self._transitions.entry_method(state)
            lines += self._transitions.exit_method(state)
        if self._transitions.needs_settling:
            lines += self._transitions.settle_method()
        sends = any("self._outputs.send_self(" in line for line in lines)
        if (sends or self._context.raises) and "on_event" not in grouped:
            lines += self._named_event_method("on_event", [])
        return [*lines, *self._failure_methods(lines)]

    def _start_method(self) -> list[str]:
        state = self._context.machine.state(self._context.machine.initial)
        body = self._transitions.enter(state)
        if f"self.state = {self._context.state_text(state.name)}" in body:
            body.remove(f"self.state = {self._context.state_text(state.name)}")
        body += self._transitions.settle_call(state)
        return [
            "",
            f"{INDENT}def start(self) -> None:",
            f'{INDENT * 2}"""Enter the initial state, ``{state.name}``."""',
            *indent(body, 2),
        ]

    def _event_method(self, event: Event, port: EventPort) -> list[str]:
        parameters = ["self"]
        if port.data is not None:
            parameters.append(f"{port.data_name}: {self._context.class_of[port.data.name]}")
        parameters += [f"{name}: {kind}" for name, kind in port.parameters]
        says = event.kind in _SAYS_WHETHER_TAKEN
        result = "bool" if says else "None"
        lines = ["", *call(f"def {port.method}", parameters, 1, f" -> {result}:")]
        channel = self._context.names.channel(event.name, event.kind)
        doc = _EVENT_DOCS[event.kind].format(name=channel)
        lines += self._event_doc(doc, says)
        return [*lines, *indent(self._transitions.dispatch([event], port, says), 2)]

    def _event_doc(self, doc: str, says: bool) -> list[str]:
        """The doc string of an event's method, in two paragraphs if one line is too short."""
        margin = INDENT * 2
        answer = "Returns whether the state takes it."
        line = f'{margin}"""{doc} {answer}"""' if says else f'{margin}"""{doc}"""'
        if not says or len(line) <= WIDTH:
            return [line]
        return [f'{margin}"""{doc}', "", f"{margin}{answer}", f'{margin}"""']

    def _named_event_method(self, method: str, events: list[Event]) -> list[str]:
        if method == "on_elapsed":
            lines = ["", f"{INDENT}def on_elapsed(self, delay: str) -> None:"]
            lines.append(f'{INDENT * 2}"""A state\'s ``after`` delay has elapsed."""')
        else:
            lines = ["", f"{INDENT}def on_event(self, name: str, data: Any = None) -> None:"]
            lines.append(
                f'{INDENT * 2}"""An event that the machine sent or raised, or that is sent to it."""'
            )
        return [*lines, *indent(self._transitions.dispatch(events, None), 2)]

    def _failure_methods(self, written: Sequence[str]) -> list[str]:
        text = "\n".join(written)
        lines: list[str] = []
        if "self._holds(" in text:
            lines += [
                "",
                f"{INDENT}def _holds(self, condition: Callable[[], bool]) -> bool:",
                f'{INDENT * 2}"""The condition; one that cannot be evaluated does not hold."""',
                f"{INDENT * 2}try:",
                f"{INDENT * 3}return condition()",
                f"{INDENT * 2}except ExecutionError as error:",
                f"{INDENT * 3}self._failed(error)",
                f"{INDENT * 3}return False",
            ]
        if "self._failed(" in text or lines:
            lines += [
                "",
                f"{INDENT}def _failed(self, error: ExecutionError) -> None:",
                f'{INDENT * 2}"""What could not be evaluated: SCXML\'s error.execution."""',
                f'{INDENT * 2}self._outputs.log("error.execution", str(error))',
            ]
            if self._context.raises:
                lines.append(f'{INDENT * 2}self._internal.append(("error.execution", None))')
        return lines

    def _can_raise(self) -> bool:
        """Whether internal events can occur and be seen: raised ones, or error.execution."""
        machine = self._context.machine
        if any(isinstance(item, Raise) and not item.external for item in statements_of(machine)):
            return True
        if not any(event.kind is EventKind.INTERNAL for event in self._events):
            return False
        self._context.raises = True
        probe: list[str] = []
        for state in machine.states:
            for transition in state.transitions:
                port = (
                    None
                    if transition.event is None
                    else self._context.names.event(transition.event)
                )
                named = port is None or port.method in ("on_event", "on_elapsed")
                probe += self._transitions.transition(state, transition, None if named else port)
            probe += self._statements.block(state.on_entry, {}, "data")
            probe += self._statements.block(state.on_exit, {}, "data")
        return any("self._failed(" in line or "self._holds(" in line for line in probe)


_SAYS_WHETHER_TAKEN = frozenset(
    {
        *(EventKind.REQUEST, EventKind.GOAL, EventKind.CALL_ERROR),
        *(EventKind.BT_HALT, EventKind.BT_CHILD_STATUS, EventKind.BT_CHILD_HALTED),
    }
)
"""Events whose sender waits for something: the node must know of one that is discarded."""

_EVENT_DOCS = {
    EventKind.MESSAGE: "A message on ``{name}``.",
    EventKind.REQUEST: "A request to ``{name}``.",
    EventKind.RESPONSE: "The response to a call of ``{name}``.",
    EventKind.CALL_ERROR: "A call of ``{name}`` failed.",
    EventKind.GOAL: "A goal of ``{name}``.",
    EventKind.CANCEL: "A request to cancel a goal of ``{name}``.",
    EventKind.GOAL_ACCEPTED: "The goal sent to ``{name}`` was accepted.",
    EventKind.GOAL_REJECTED: "The goal sent to ``{name}`` was rejected.",
    EventKind.FEEDBACK: "Feedback of ``{name}``.",
    EventKind.SUCCEEDED: "The goal sent to ``{name}`` succeeded.",
    EventKind.ABORTED: "The goal sent to ``{name}`` was aborted.",
    EventKind.CANCELED: "The goal sent to ``{name}`` was canceled.",
    EventKind.THREAD_START: "A goal of ``{name}`` is to be executed.",
    EventKind.THREAD_FREE: "A thread of ``{name}`` has become free.",
    EventKind.TIMER: "The timer ``{name}``.",
    EventKind.BT_TICK: "The behaviour tree ticks this node.",
    EventKind.BT_HALT: "The behaviour tree halts this node.",
    EventKind.BT_CHILD_STATUS: "Child {name} returned a status.",
    EventKind.BT_CHILD_HALTED: "Child {name} was halted.",
}
