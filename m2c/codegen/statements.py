"""Executable content, lowered to what the templates write: assignments, branches, outputs, guards."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from m2c.codegen import program
from m2c.codegen.context import MachineContext
from m2c.codegen.expressions import ExpressionCompiler
from m2c.codegen.names import field_attribute
from m2c.codegen.source import Source, quoted
from m2c.diagnostics import Position
from m2c.language.datatypes import ANY, Array, DataType, Primitive, Structure, part
from m2c.language.expressions import (
    EventData,
    Expression,
    Index,
    Literal,
    Member,
    Variable,
    children,
)
from m2c.language.typing import Scope, type_of
from m2c.model.machine import (
    Assign,
    Block,
    Cancel,
    Delay,
    Emit,
    Field,
    Foreach,
    If,
    Log,
    OutputKind,
    Raise,
    Statement,
)

OUTPUTS = "self._outputs"
ON_EVENT, ON_ELAPSED = "self.on_event", "self.on_elapsed"
"""What takes a delayed event, and a delay that is over: of the machine, or of one of its threads."""


_BLOCKS = {
    "enter": "Enter ``{}``, before what is in it.",
    "exit": "Exit ``{}``, after what is in it.",
    "initial": "``{}`` is entered at its initial state.",
    "default": "``{}`` has nothing to go back to.",
}
"""What the methods of blocks with a name do, by the first word of that."""


def place(position: Position) -> str:
    """``Model.scxml:18:5``: the file without its folders, so that generated code is the same everywhere."""
    return f"{Path(position.file).name}:{position.line}:{position.column}"


def call(function: str, *arguments: str) -> program.Call:
    """A call of ``function``."""
    return program.Call(Source(function), tuple(Source(argument) for argument in arguments))


class StatementLowering:
    """Lowers the statements of one machine.

    Attributes:
        sends: outputs that are no messages, so far.
        tests_may_fail: a condition may turn out not to be possible.
        named: methods of the blocks with a name, so far.
    """

    def __init__(self, context: MachineContext) -> None:
        self._context = context
        self.sends: set[str] = set()
        self.named: dict[str, program.BlockMethod] = {}
        self.tests_may_fail = False

    def sent(self, output: str, *arguments: str) -> program.Call:
        """A call of ``output``, which is no message."""
        self.sends.add(output)
        return call(f"{OUTPUTS}.{output}", *arguments)

    def block(
        self, statements: Sequence[Statement], compiler: ExpressionCompiler, position: Position
    ) -> tuple[program.Statement, ...]:
        """What runs ``statements``; the block begins at ``position``.

        Where one of them may fail, the block ends there (W3C SCXML 4.9), so it stands in a guard. Its
        place is that of the one statement, or of the block where it can be one of several.
        """
        lowered: list[program.Statement] = []
        failing: list[Position] = []
        for statement in statements:
            compiler.may_fail = False
            lowered += self._statement(statement, compiler)
            if compiler.may_fail:
                failing.append(statement.position)
        compiler.may_fail = False
        if not failing:
            return tuple(lowered)
        self.sends.add("fault")
        at = failing[0] if len(failing) == 1 else position
        return (program.Guard(tuple(lowered), place(at)),)

    def condition(
        self, test: Expression, compiler: ExpressionCompiler, operand_of: str = ""
    ) -> str:
        """``test`` as a condition; one that cannot be evaluated does not hold (W3C SCXML 5.9.1)."""
        if not self.may_fail(test, compiler):
            return compiler.condition(test, operand_of)
        self.sends.add("fault")
        self.tests_may_fail = True
        before = compiler.may_fail
        text = f"self._holds({quoted(place(test.position))}, lambda: {compiler.condition(test)})"
        compiler.may_fail = before
        return text

    def may_fail(self, test: Expression, compiler: ExpressionCompiler) -> bool:
        """Whether ``test`` may turn out not to be possible."""
        before, compiler.may_fail = compiler.may_fail, False
        compiler.condition(test)
        fails, compiler.may_fail = compiler.may_fail, before
        return fails

    def _statement(
        self, statement: Statement, compiler: ExpressionCompiler
    ) -> list[program.Statement]:
        match statement:
            case Assign(location, value):
                return [self._assign(location, value, compiler)]
            case If(branches):
                return [self._if(branches, compiler)]
            case Foreach():
                return [self._loop(statement, compiler)]
            case Block(body, position, block) if block:
                return [self._called(block, body, position)]
            case Block(body, position):
                return list(self.block(body, compiler, position))
            case Delay(event, None):
                return [self.sent("stop_delay", quoted(event), ON_ELAPSED)]
            case Delay(event, after_s):
                return [self.sent("start_delay", quoted(event), repr(after_s), ON_ELAPSED)]
            case Log(label, value):
                return [self._log(label, value, compiler)]
            case Emit():
                return [self._emit(statement, compiler)]
            case Raise():
                return [self._raise(statement, compiler)]
            case Cancel(id=identifier):
                return [self.sent("cancel_send", quoted(identifier), ON_EVENT)]

    def _called(
        self, block: str, body: Sequence[Statement], position: Position
    ) -> program.Statement:
        """A call of the method that is ``block``; it is made where it is called first."""
        method = self._context.block_method(block)
        if block not in self.named:
            verb, _, name = block.partition(" ")
            inside = self.block(body, self._context.compiler({}), position)
            self.named[block] = program.BlockMethod(method, _BLOCKS[verb].format(name), inside)
        return call(f"self._{method}")

    def _assign(
        self, location: Expression, value: Expression, compiler: ExpressionCompiler
    ) -> program.Statement:
        variables = self._context.variables
        match location:
            case Variable(name=name):
                new = compiler.value(value, variables.get(name, ANY))
                return program.Assign(Source(f"self.{self._context.attribute(name)}"), Source(new))
            case Member(object=inner, name=name):
                owner = _static(inner, variables)
                holder = compiler.value(inner)
                if isinstance(owner, Structure) and owner.name and not _indexed(inner):
                    new = compiler.value(value, owner.field(name) or ANY)
                    return program.Assign(Source(f"{holder}.{field_attribute(name)}"), Source(new))
                arguments = [holder, quoted(name)]
                arguments.append(compiler.value(value, _static(location, variables)))
                if isinstance(owner, Array):
                    arguments += _growth(owner, compiler)
                    if owner.fixed and name == "length":
                        arguments.append(f"least={owner.length}")
                compiler.may_fail = True
                return call("ecmascript.set_member", *arguments)
            case Index(object=inner, index=index):
                owner = _static(inner, variables)
                element = owner.element if isinstance(owner, Array) else ANY
                arguments = [compiler.value(inner), compiler.value(index)]
                arguments.append(compiler.value(value, element))
                if isinstance(owner, Array):
                    arguments += _growth(owner, compiler)
                compiler.may_fail = True
                return call("ecmascript.set_element", *arguments)
        raise AssertionError(location)

    def _if(
        self,
        branches: Sequence[tuple[Expression | None, Sequence[Statement]]],
        compiler: ExpressionCompiler,
    ) -> program.Statement:
        lowered = []
        for test, body in branches:
            head = None if test is None else Source(self.condition(test, compiler))
            inner = [item for statement in body for item in self._statement(statement, compiler)]
            lowered.append(program.Branch(head, tuple(inner)))
        return program.If(tuple(lowered))

    def _loop(self, loop: Foreach, compiler: ExpressionCompiler) -> program.Statement:
        variables = self._context.variables
        elements, each = compiler.elements(loop.array, "each", variables.get(loop.item, ANY))
        body = [program.Assign(Source(f"self.{self._context.attribute(loop.item)}"), Source(each))]
        if loop.index:
            place = compiler.place("place", variables.get(loop.index, ANY))
            where = f"self.{self._context.attribute(loop.index)}"
            body.append(program.Assign(Source(where), Source(place)))
        inner = [item for statement in loop.body for item in self._statement(statement, compiler)]
        return program.Loop(Source(elements), bool(loop.index), (*body, *inner))

    def _log(
        self, label: str, value: Expression | None, compiler: ExpressionCompiler
    ) -> program.Statement:
        if value is None:
            return self.sent("log", quoted(label), quoted(""))
        return self.sent("log", quoted(label), compiler.text(value))

    def _emit(self, emit: Emit, compiler: ExpressionCompiler) -> program.Statement:
        port = self._context.names.output(emit.kind, emit.interface)
        arguments: list[str] = []
        for name, _ in port.parameters:
            match name:
                case "status":
                    arguments.append(compiler.status(emit.fields[0].value))
                case "value":
                    kind = self._context.output_ports.get(emit.interface)
                    arguments.append(compiler.value(emit.fields[0].value, kind))
                case "key":
                    arguments.append(quoted(emit.interface))
                case "child":
                    arguments.append(self._context.child(emit.interface, "self"))
                case "thread_id" if emit.kind is OutputKind.THREAD_FREE:
                    arguments.append("self.thread_id" if self._context.is_thread else "0")
                case "thread_id":
                    arguments.append(self._number(emit.thread_id, compiler, "0"))
                case "goal_id":
                    absent = "None" if emit.kind is OutputKind.SEND_CANCEL else "0"
                    arguments.append(self._number(emit.goal_id, compiler, absent))
        if port.data is not None:
            arguments.append(self._message(port.data, emit.fields, compiler))
        return call(f"{OUTPUTS}.{port.method}", *arguments)

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
                arguments.append(f"{field_attribute(head)}={value}")
        for head, inner in nested.items():
            wanted = kind.field(head)
            if isinstance(wanted, Array):
                value = self._rows(wanted, inner, compiler)
            else:
                assert isinstance(wanted, Structure)
                value = self._message(wanted, inner, compiler)
            arguments.append(f"{field_attribute(head)}={value}")
        return f"{self._context.class_of[kind.name]}({', '.join(arguments)})"

    def _rows(self, kind: Array, columns: Sequence[Field], compiler: ExpressionCompiler) -> str:
        """An array of structures, of which columns are given."""
        given = [
            f"{quoted(field.name)}: {compiler.value(field.value, part(kind, field.name))}"
            for field in columns
        ]
        arguments = [f"{{{', '.join(given)}}}", compiler.zero(kind.element)]
        if kind.length is not None:
            arguments += [str(kind.length), str(kind.length)] if kind.fixed else [str(kind.length)]
        compiler.may_fail = True
        return f"ecmascript.rows({', '.join(arguments)})"

    def _raise(self, statement: Raise, compiler: ExpressionCompiler) -> program.Statement:
        fields = [
            f"{quoted(field.name)}: {compiler.value(field.value, ANY)}"
            for field in statement.fields
        ]
        data = f"{{{', '.join(fields)}}}" if fields else "None"
        if not statement.external:
            return call("self._internal.append", f"({quoted(statement.event)}, {data})")
        delay = "0.0" if statement.delay_s is None else self._delay(statement.delay_s, compiler)
        event, identifier = quoted(statement.event), quoted(statement.id)
        return self.sent("send_self", event, data, delay, identifier, ON_EVENT)

    def _delay(self, value: Expression, compiler: ExpressionCompiler) -> str:
        if isinstance(value, Literal) and isinstance(value.value, int | float):
            return repr(float(value.value))
        compiler.may_fail = True
        return f"seconds({compiler.value(value)})"


def _growth(owner: Array, compiler: ExpressionCompiler) -> list[str]:
    """What new elements of an array are, and how many it may have."""
    arguments = [] if owner.element == ANY else [f"fill={compiler.zero(owner.element)}"]
    return arguments if owner.length is None else [*arguments, f"most={owner.length}"]


def _static(node: Expression, variables: dict[str, DataType]) -> DataType:
    return type_of(node, Scope(variables))


def _indexed(node: Expression) -> bool:
    return isinstance(node, Index | EventData) or any(_indexed(child) for child in children(node))
