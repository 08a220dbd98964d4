"""``machine.py`` of a generated package: the state machine as a class, without any transport."""

from __future__ import annotations

from collections.abc import Sequence

from m2c.codegen.expressions import ExpressionCompiler, attribute_of_field, quoted
from m2c.codegen.interfaces import zero_text
from m2c.codegen.layout import INDENT, WIDTH, call, indent
from m2c.codegen.names import attribute, constant
from m2c.codegen.ports import EventPort, PortNames, events_of, statements_of
from m2c.model.datatypes import ANY, Array, DataType, Primitive, Structure, is_integer
from m2c.model.expressions import (
    EventData,
    Expression,
    Index,
    Literal,
    Member,
    ObjectLiteral,
    Unary,
    Variable,
    children,
)
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import (
    Assign,
    Cancel,
    Data,
    Emit,
    Event,
    EventKind,
    Field,
    If,
    Log,
    Machine,
    OutputKind,
    Raise,
    State,
    Statement,
    Target,
    Transition,
)
from m2c.model.scopes import event_parts
from m2c.model.typing import Scope

MAX_EVENTLESS_STEPS = 1000
"""Eventless transitions in one macrostep before it is called an endless loop."""


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
        self._machine = machine
        self._library = library
        self._names = names
        self._class_of = class_of
        self.class_name = class_name
        self._is_thread = is_thread
        self.uses: set[str] = set()
        self._constants = frozenset(
            data.name for data in machine.data if _is_constant(data, machine)
        )
        self._variables = {data.name: data.type for data in machine.data}
        self._ports = {port.key: port.type for port in machine.ports if not port.output}
        self._state_names: dict[str, str] = {}
        for state in machine.states:
            self._state_names[state.name] = constant(state.name, self._state_names.values())
        self._events = events_of(machine)
        self._has_eventless = any(
            transition.event is None for state in machine.states for transition in state.transitions
        )
        self._raises = self._can_raise()
        self._bodies: dict[str, list[str]] = {}

    # -- whole class --------------------------------------------------------------------------

    @property
    def state_class(self) -> str:
        """Name of the enumeration of states."""
        return f"{self.class_name}State"

    @property
    def uses_random(self) -> bool:
        """Whether the machine leaves choices open."""
        return "_random" in self._extras

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
        lines = [f"class {self.state_class}(Enum):"]
        lines += [f'{INDENT}"""The states of ``{self._machine.name}``."""', ""]
        for state in self._machine.states:
            lines.append(f"{INDENT}{self._state_names[state.name]} = {quoted(state.name)}")
        return lines

    def _class_head(self) -> list[str]:
        machine = self._machine
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
        constants = [data for data in machine.data if data.name in self._constants]
        compiler = self._compiler({})
        for data in constants:
            value = compiler.value(data.initial, data.type)
            lines.append(f"{INDENT}{attribute(data.name)}: Final = {value}")
        if constants:
            lines.append("")
        return lines

    def _extra_attributes(self, methods: Sequence[str]) -> list[str]:
        text = "\n".join(methods)
        extras = ["_outputs", "state"]
        if self._is_thread:
            extras.append("thread_id")
        if "self._random()" in text or self._initial_uses_random():
            extras.append("_random")
        if "self._ports[" in text or any(
            "PortInput" in repr(data.initial) for data in self._machine.data
        ):
            extras.append("_ports")
        if self._raises:
            extras.append("_internal")
        return extras

    def _initial_uses_random(self) -> bool:
        return any("function='random'" in repr(data.initial) for data in self._machine.data)

    def _constructor(self) -> list[str]:
        variables = [data for data in self._machine.data if data.name not in self._constants]
        slots = sorted([*self._extras, *(attribute(data.name) for data in variables)])
        quoted_slots = [f'"{slot}"' for slot in slots]
        lines = call("__slots__ = ", quoted_slots, 1)
        if len(quoted_slots) == 1:
            lines = [f"{INDENT}__slots__ = ({quoted_slots[0]},)"]
        parameters = ["self", "outputs: Outputs"]
        if "_ports" in self._extras:
            parameters.append("ports: Mapping[str, Any]")
            self.uses |= {"Any", "Mapping"}
        if self._is_thread:
            parameters.append("thread_id: int")
        if "_random" in self._extras:
            parameters.append("random: Callable[[], float] = random.random")
            self.uses |= {"Callable", "random"}
        lines += ["", *call("def __init__", parameters, 1, " -> None:")]
        lines.append(f"{INDENT * 2}self._outputs = outputs")
        if "_ports" in self._extras:
            lines.append(f"{INDENT * 2}self._ports = ports")
        if self._is_thread:
            lines.append(f"{INDENT * 2}self.thread_id = thread_id")
        if "_random" in self._extras:
            lines.append(f"{INDENT * 2}self._random = random")
        if self._raises:
            lines.append(f"{INDENT * 2}self._internal: deque[tuple[str, Any]] = deque()")
            self.uses |= {"deque", "Any"}
        initial = self._state_text(self._machine.initial)
        lines.append(f"{INDENT * 2}self.state = {initial}")
        compiler = self._compiler({})
        for data in variables:
            value = compiler.value(data.initial, data.type)
            if isinstance(data.initial, ObjectLiteral) and not data.initial.entries:
                value = zero_text(data.type, self._class_of)
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
                self.uses.add("Any")
                return "Any"
            case Primitive() if is_integer(kind):
                return "int"
            case Primitive("number"):
                return "int | float"
            case Primitive():
                return "float"
            case Structure(name) if name:
                return self._class_of[name]
            case Array(element, _, _):
                return f"list[{self._annotation(element)}]"
            case _:
                self.uses.add("Any")
                return "dict[str, Any]"

    # -- methods ------------------------------------------------------------------------------

    def _methods(self) -> list[str]:
        lines = self._start_method()
        grouped: dict[str, list[tuple[Event, EventPort]]] = {}
        for event in self._events:
            port = self._names.event(event)
            grouped.setdefault(port.method, []).append((event, port))
        for method, events in grouped.items():
            if method in ("on_event", "on_elapsed"):
                lines += self._named_event_method(method, [event for event, _ in events])
            else:
                lines += self._event_method(*events[0])
        for state in self._machine.states:
            lines += self._entry_method(state)
            lines += self._exit_method(state)
        if self._needs_settling:
            lines += self._settle_method()
        if self._raises:
            if "on_event" not in grouped:
                lines += self._named_event_method("on_event", [])
            lines += self._failure_methods(lines)
        return lines

    def _start_method(self) -> list[str]:
        state = self._machine.state(self._machine.initial)
        body = self._enter(state)
        if f"self.state = {self._state_text(state.name)}" in body:
            body.remove(f"self.state = {self._state_text(state.name)}")
        body += self._settle_call(state)
        return [
            "",
            f"{INDENT}def start(self) -> None:",
            f'{INDENT * 2}"""Enter the initial state, ``{state.name}``."""',
            *indent(body, 2),
        ]

    def _event_method(self, event: Event, port: EventPort) -> list[str]:
        parameters = ["self"]
        if port.data is not None:
            parameters.append(f"{port.data_name}: {self._class_of[port.data.name]}")
        parameters += [f"{name}: {kind}" for name, kind in port.parameters]
        says = event.kind in _SAYS_WHETHER_TAKEN
        result = "bool" if says else "None"
        lines = ["", *call(f"def {port.method}", parameters, 1, f" -> {result}:")]
        doc = _EVENT_DOCS[event.kind].format(name=event.name)
        lines += self._event_doc(doc, says)
        body = self._dispatch([event], port)
        if says:
            body = [
                line.replace("return", "return True") if line.strip() == "return" else line
                for line in body
            ]
            body.append("return False")
        else:
            body = _without_final_return(body)
        return [*lines, *indent(body, 2)]

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
            self.uses.add("Any")
            lines = ["", f"{INDENT}def on_event(self, name: str, data: Any = None) -> None:"]
            lines.append(
                f'{INDENT * 2}"""An event that the machine sent or raised, or that is sent to it."""'
            )
        body = _without_final_return(self._dispatch(events, None))
        return [*lines, *indent(body, 2)]

    def _dispatch(self, events: list[Event], port: EventPort | None) -> list[str]:
        """What each state does on any of ``events``: the first enabled transition is taken."""
        lines: list[str] = []
        word = "if"
        for state in self._machine.states:
            found = [transition for transition in state.transitions if transition.event in events]
            if not found:
                continue
            inner: list[str] = []
            for transition in found:
                inner += self._transition(state, transition, port)
                if self._is_unconditional(transition) and port is not None:
                    break
            lines.append(f"{word} self.state is {self._state_text(state.name)}:")
            lines += indent(inner)
            word = "elif"
        return lines

    def _is_unconditional(self, transition: Transition) -> bool:
        return transition.cond is None

    def _transition(
        self, state: State, transition: Transition, port: EventPort | None
    ) -> list[str]:
        parts = event_parts(transition.event, self._machine, self._library)
        data_name = port.data_name if port is not None else "data"
        compiler = self._compiler(parts, data_name)
        tests: list[str] = []
        event = transition.event
        if event is not None and port is None:
            tests.append(_event_test(event))
        if transition.cond is not None:
            test = compiler.condition(transition.cond)
            if compiler.may_fail:
                test = f"self._holds(lambda: {test})"
            tests.append(test)
        body = self._taken(state, transition, parts, data_name)
        if not tests:
            return body
        text = (
            tests[0]
            if len(tests) == 1
            else " and ".join(
                f"({test})" if " or " in test or " if " in test else test for test in tests
            )
        )
        return [f"if {text}:", *indent(body)]

    def _taken(
        self, state: State, transition: Transition, parts: dict[str, DataType], data_name: str
    ) -> list[str]:
        lines: list[str] = []
        leaves = bool(transition.targets)
        if leaves and self._has_exit(state):
            lines.append(f"self._leave_{_method_part(self._state_names[state.name])}()")
        lines += self._block(transition.body, parts, data_name)
        if len(transition.targets) > 1:
            lines += self._choice(state, transition.targets, parts, data_name)
        else:
            for target in transition.targets:
                lines += self._arrive(state, target, parts, data_name)
            if not transition.targets and self._needs_settling:
                lines.append("self._settle()")
        return [*lines, "return"]

    def _choice(
        self, state: State, targets: tuple[Target, ...], parts: dict[str, DataType], data_name: str
    ) -> list[str]:
        lines = ["draw = self._random()"]
        bound = 0.0
        for index, target in enumerate(targets):
            bound += target.probability or 0.0
            if index == len(targets) - 1:
                lines.append("else:")
            else:
                lines.append(f"{'if' if index == 0 else 'elif'} draw < {round(bound, 12)!r}:")
            lines += indent(self._arrive(state, target, parts, data_name) or ["pass"])
        return lines

    def _arrive(
        self, source: State, target: Target, parts: dict[str, DataType], data_name: str
    ) -> list[str]:
        state = self._machine.state(target.state)
        body = self._block(target.body, parts, data_name)
        entering = self._enter(state)
        assignment = f"self.state = {self._state_text(state.name)}"
        if source.name == state.name and entering == [assignment]:
            entering = []
        return [*body, *entering, *self._settle_call(state)]

    def _enter(self, state: State) -> list[str]:
        if self._has_entry(state):
            return [f"self._enter_{_method_part(self._state_names[state.name])}()"]
        return [f"self.state = {self._state_text(state.name)}"]

    def _settle_call(self, state: State) -> list[str]:
        eventless = any(transition.event is None for transition in state.transitions)
        return ["self._settle()"] if eventless or self._raises else []

    @property
    def _needs_settling(self) -> bool:
        return self._has_eventless or self._raises

    def _settle_method(self) -> list[str]:
        lines = [
            "",
            f"{INDENT}def _settle(self) -> None:",
            f'{INDENT * 2}"""Take eventless transitions and internal events until none is enabled."""',
            f"{INDENT * 2}for _ in range({MAX_EVENTLESS_STEPS}):",
        ]
        self.uses.add("EndlessLoopError")
        for state in self._machine.states:
            found = [transition for transition in state.transitions if transition.event is None]
            if not found:
                continue
            inner: list[str] = []
            for transition in found:
                body = self._transition(state, transition, None)
                inner += [_continue_instead(line) for line in body]
                if transition.cond is None:
                    break
            inner = [line for line in inner if line.strip() != "self._settle()"]
            lines.append(f"{INDENT * 3}if self.state is {self._state_text(state.name)}:")
            lines += indent(inner, 4)
        if self._raises:
            lines.append(f"{INDENT * 3}if self._internal:")
            lines.append(f"{INDENT * 4}self.on_event(*self._internal.popleft())")
            lines.append(f"{INDENT * 4}continue")
        lines.append(f"{INDENT * 3}return")
        lines.append(f"{INDENT * 2}raise EndlessLoopError(self.state.value)")
        return lines

    def _failure_methods(self, written: Sequence[str]) -> list[str]:
        text = "\n".join(written)
        lines: list[str] = []
        if "self._holds(" in text:
            self.uses |= {"Callable", "ExecutionError"}
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
            self.uses.add("ExecutionError")
            lines += [
                "",
                f"{INDENT}def _failed(self, error: ExecutionError) -> None:",
                f'{INDENT * 2}"""Queue SCXML\'s error.execution."""',
                f'{INDENT * 2}self._outputs.log("error.execution", str(error))',
                f'{INDENT * 2}self._internal.append(("error.execution", None))',
            ]
        return lines

    # -- entry and exit -----------------------------------------------------------------------

    def _delays(self, state: State) -> list[Transition]:
        return [item for item in state.transitions if item.after_s is not None]

    def _has_entry(self, state: State) -> bool:
        return bool(state.on_entry or self._delays(state) or state.final)

    def _has_exit(self, state: State) -> bool:
        return bool(state.on_exit or self._delays(state))

    def _entry_method(self, state: State) -> list[str]:
        if not self._has_entry(state):
            return []
        name = _method_part(self._state_names[state.name])
        body = [f"self.state = {self._state_text(state.name)}"]
        for transition in self._delays(state):
            assert transition.event is not None
            body.append(
                f'self._outputs.start_delay("{transition.event.name}", {transition.after_s!r})'
            )
        body += self._block(state.on_entry, {}, "data")
        if state.final:
            body.append('self._outputs.log("", "the machine has reached its final state")')
        return ["", f"{INDENT}def _enter_{name}(self) -> None:", *indent(body, 2)]

    def _exit_method(self, state: State) -> list[str]:
        if not self._has_exit(state):
            return []
        name = _method_part(self._state_names[state.name])
        body = self._block(state.on_exit, {}, "data")
        for transition in self._delays(state):
            assert transition.event is not None
            body.append(f'self._outputs.stop_delay("{transition.event.name}")')
        return ["", f"{INDENT}def _leave_{name}(self) -> None:", *indent(body, 2)]

    # -- statements ---------------------------------------------------------------------------

    def _compiler(self, parts: dict[str, DataType], data_name: str = "data") -> ExpressionCompiler:
        scope = Scope(self._variables, parts, self._ports)
        return _Recording(scope, self._constants, self._class_of, data_name, self.uses)

    def _block(
        self, statements: Sequence[Statement], parts: dict[str, DataType], data_name: str
    ) -> list[str]:
        compiler = self._compiler(parts, data_name)
        lines = self._statements(statements, compiler)
        if not compiler.may_fail:
            return lines
        self.uses.add("ExecutionError")
        return [
            "try:",
            *indent(lines),
            "except ExecutionError as error:",
            f"{INDENT}self._failed(error)",
        ]

    def _statements(
        self, statements: Sequence[Statement], compiler: ExpressionCompiler
    ) -> list[str]:
        lines: list[str] = []
        for statement in statements:
            match statement:
                case Assign(location, value):
                    lines += self._assign(location, value, compiler)
                case If(branches):
                    lines += self._if(branches, compiler)
                case Log(label, value):
                    lines += self._log(label, value, compiler)
                case Emit():
                    lines += self._emit(statement, compiler)
                case Raise():
                    lines += self._raise(statement, compiler)
                case Cancel(id=identifier):
                    lines.append(f'self._outputs.cancel_send("{identifier}")')
        return lines

    def _assign(
        self, location: Expression, value: Expression, compiler: ExpressionCompiler
    ) -> list[str]:
        match location:
            case Variable(name=name):
                kind = self._variables.get(name, ANY)
                return [f"self.{attribute(name)} = {compiler.value(value, kind)}"]
            case Member(object=inner, name=name):
                owner = _static(inner, self._variables)
                holder = compiler.value(inner)
                if isinstance(owner, Structure) and owner.name and not _indexed(inner):
                    wanted = owner.field(name) or ANY
                    return [
                        f"{holder}.{attribute_of_field(name)} = {compiler.value(value, wanted)}"
                    ]
                new = compiler.value(value, _static(location, self._variables))
                compiler.may_fail = True
                self.uses.add("ecmascript")
                return call("ecmascript.set_member", [holder, f'"{name}"', new], 0)
            case Index(object=inner, index=index):
                owner = _static(inner, self._variables)
                element = owner.element if isinstance(owner, Array) else ANY
                arguments = [compiler.value(inner), compiler.value(index)]
                arguments.append(compiler.value(value, element))
                if element != ANY:
                    arguments.append(f"fill={zero_text(element, self._class_of)}")
                compiler.may_fail = True
                self.uses.add("ecmascript")
                return call("ecmascript.set_element", arguments, 0)
        raise AssertionError(location)

    def _if(
        self,
        branches: Sequence[tuple[Expression | None, Sequence[Statement]]],
        compiler: ExpressionCompiler,
    ) -> list[str]:
        lines: list[str] = []
        for index, (test, body) in enumerate(branches):
            if test is None:
                lines.append("else:")
            else:
                head = self._condition(test, compiler)
                lines.append(f"{'if' if index == 0 else 'elif'} {head}:")
            lines += indent(self._statements(body, compiler) or ["pass"])
        return lines

    def _condition(self, test: Expression, compiler: ExpressionCompiler) -> str:
        failing = compiler.may_fail
        compiler.may_fail = False
        text = compiler.condition(test)
        if compiler.may_fail:
            text = f"self._holds(lambda: {text})"
        compiler.may_fail = failing
        return text

    def _log(self, label: str, value: Expression | None, compiler: ExpressionCompiler) -> list[str]:
        if value is None:
            return [f'self._outputs.log({quoted(label)}, "")']
        text = compiler.value(value)
        kind = _static(value, self._variables)
        if kind != Primitive("string") or _indexed(value):
            self.uses.add("ecmascript")
            text = f"ecmascript.to_string({text})"
        return call("self._outputs.log", [quoted(label), text], 0)

    def _emit(self, emit: Emit, compiler: ExpressionCompiler) -> list[str]:
        port = self._names.output(emit.kind, emit.interface)
        arguments: list[str] = []
        for name, _ in port.parameters:
            match name:
                case "status":
                    arguments.append(compiler.value(emit.fields[0].value))
                case "key":
                    arguments.append(f'"{emit.interface}"')
                case "child":
                    arguments.append(self._child(emit.interface))
                case "value":
                    arguments.append(compiler.value(emit.fields[0].value))
                case "thread_id" if emit.kind is OutputKind.THREAD_FREE:
                    arguments.append("self.thread_id" if self._is_thread else "0")
                case "thread_id":
                    arguments.append(self._number(emit.thread_id, compiler, "0"))
                case "goal_id":
                    absent = "None" if emit.kind is OutputKind.SEND_CANCEL else "0"
                    arguments.append(self._number(emit.goal_id, compiler, absent))
        if port.data is not None:
            arguments.append(self._message(port.data, emit.fields, compiler))
        return call(f"self._outputs.{port.method}", arguments, 0)

    def _child(self, written: str) -> str:
        """A child's index: a number, or the variable that has it."""
        return written if written.isdigit() else f"self.{attribute(written)}"

    def _number(self, value: Expression | None, compiler: ExpressionCompiler, absent: str) -> str:
        return absent if value is None else compiler.value(value, Primitive("int64"))

    def _message(
        self, kind: Structure, fields: Sequence[Field], compiler: ExpressionCompiler
    ) -> str:
        nested: dict[str, list[Field]] = {}
        arguments: list[str] = []
        for field in fields:
            head, _, rest = field.name.partition(".")
            if rest:
                nested.setdefault(head, []).append(Field(rest, field.value, field.position))
            else:
                value = compiler.value(field.value, kind.field(head))
                arguments.append(f"{attribute_of_field(head)}={value}")
        for head, inner in nested.items():
            wanted = kind.field(head)
            assert isinstance(wanted, Structure)
            arguments.append(f"{attribute_of_field(head)}={self._message(wanted, inner, compiler)}")
        return f"{self._class_of[kind.name]}({', '.join(arguments)})"

    def _raise(self, statement: Raise, compiler: ExpressionCompiler) -> list[str]:
        fields = [f'"{field.name}": {compiler.value(field.value)}' for field in statement.fields]
        data = f"{{{', '.join(fields)}}}" if fields else "None"
        if not statement.external:
            return [f'self._internal.append(("{statement.event}", {data}))']
        delay = "0.0" if statement.delay_s is None else self._delay(statement.delay_s, compiler)
        arguments = [f'"{statement.event}"', data, delay, f'"{statement.id}"']
        return call("self._outputs.send_self", arguments, 0)

    def _delay(self, value: Expression, compiler: ExpressionCompiler) -> str:
        if isinstance(value, Literal) and isinstance(value.value, int | float):
            return repr(float(value.value))
        self.uses.add("seconds")
        compiler.may_fail = True
        return f"seconds({compiler.value(value)})"

    def _can_raise(self) -> bool:
        """Whether internal events can occur: raised ones, or error.execution."""
        machine = self._machine
        if any(isinstance(item, Raise) and not item.external for item in statements_of(machine)):
            return True
        self._raises = True
        probe: list[str] = []
        for state in machine.states:
            for transition in state.transitions:
                port = None if transition.event is None else self._names.event(transition.event)
                named = port is None or port.method in ("on_event", "on_elapsed")
                probe += self._transition(state, transition, None if named else port)
            probe += self._block(state.on_entry, {}, "data")
            probe += self._block(state.on_exit, {}, "data")
        self.uses.clear()
        return any("self._failed(" in line or "self._holds(" in line for line in probe)

    def _state_text(self, name: str) -> str:
        return f"{self.state_class}.{self._state_names[name]}"


class _Recording(ExpressionCompiler):
    """An expression compiler that notes what run-time names it used in the machine's own set."""

    def __init__(
        self,
        scope: Scope,
        constants: frozenset[str],
        class_of: dict[str, str],
        data_name: str,
        uses: set[str],
    ) -> None:
        super().__init__(scope, constants, class_of, data_name)
        self.uses = uses


_SAYS_WHETHER_TAKEN = frozenset(
    {
        *(EventKind.REQUEST, EventKind.GOAL, EventKind.CALL_ERROR),
        *(EventKind.BT_CHILD_STATUS, EventKind.BT_CHILD_HALTED),
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


def _event_test(event: Event) -> str:
    if event.kind is EventKind.AFTER:
        return f'delay == "{event.name}"'
    name = event.name
    if name == "*":
        return "True"
    prefix = name.removesuffix("*").removesuffix(".")
    return (
        f'matches(name, "{prefix}")' if "." in prefix or name.endswith("*") else f'name == "{name}"'
    )


def _continue_instead(line: str) -> str:
    return line.replace("return", "continue") if line.strip() == "return" else line


def _without_final_return(lines: list[str]) -> list[str]:
    """Drop ``return`` where a branch ends anyway: the whole method is one if/elif chain."""
    kept: list[str] = []
    for index, line in enumerate(lines):
        if line == f"{INDENT}return":
            following = lines[index + 1] if index + 1 < len(lines) else ""
            if not following.startswith(INDENT):
                if kept and kept[-1].rstrip().endswith(":"):
                    kept.append(f"{INDENT}pass")
                continue
        kept.append(line)
    return kept


def _method_part(constant_name: str) -> str:
    return constant_name.lower().strip("_")


def _is_constant(data: Data, machine: Machine) -> bool:
    literal = isinstance(data.initial, Literal) or (
        isinstance(data.initial, Unary) and isinstance(data.initial.operand, Literal)
    )
    if not literal or isinstance(data.type, Array | Structure) or data.type == ANY:
        return False
    return not any(
        isinstance(item, Assign) and _root(item.location) == data.name
        for item in statements_of(machine)
    )


def _root(location: Expression) -> str:
    while isinstance(location, Member | Index):
        location = location.object
    return location.name if isinstance(location, Variable) else ""


def _static(node: Expression, variables: dict[str, DataType]) -> DataType:
    from m2c.model.typing import type_of

    return type_of(node, Scope(variables))


def _indexed(node: Expression) -> bool:
    return isinstance(node, Index | EventData) or any(_indexed(child) for child in children(node))
