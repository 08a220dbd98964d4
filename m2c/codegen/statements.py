"""Executable content to Python: assignments, branches, logs, outputs and raised events."""

from __future__ import annotations

from collections.abc import Sequence

from m2c.codegen.context import MachineContext
from m2c.codegen.expressions import ExpressionCompiler, attribute_of_field, quoted
from m2c.codegen.layout import INDENT, call, indent
from m2c.codegen.names import attribute
from m2c.model.datatypes import ANY, Array, DataType, Primitive, Structure
from m2c.model.expressions import (
    EventData,
    Expression,
    Index,
    Literal,
    Member,
    Variable,
    children,
)
from m2c.model.machine import Assign, Cancel, Emit, Field, If, Log, OutputKind, Raise, Statement
from m2c.model.typing import Scope, type_of


class StatementWriter:
    """Writes the statements of one machine."""

    def __init__(self, context: MachineContext) -> None:
        self._context = context

    def block(
        self, statements: Sequence[Statement], parts: dict[str, DataType], data_name: str
    ) -> list[str]:
        """Lines that run ``statements``; ``parts`` are the types of the event's parts there."""
        compiler = self._context.compiler(parts, data_name)
        lines = self._statements(statements, compiler)
        if not compiler.may_fail:
            return lines
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
                kind = self._context.variables.get(name, ANY)
                return [f"self.{attribute(name)} = {compiler.value(value, kind)}"]
            case Member(object=inner, name=name):
                owner = _static(inner, self._context.variables)
                holder = compiler.value(inner)
                if isinstance(owner, Structure) and owner.name and not _indexed(inner):
                    wanted = owner.field(name) or ANY
                    return [
                        f"{holder}.{attribute_of_field(name)} = {compiler.value(value, wanted)}"
                    ]
                arguments = [holder, quoted(name)]
                arguments.append(compiler.value(value, _static(location, self._context.variables)))
                if isinstance(owner, Array) and name == "length":
                    arguments += _growth(owner, compiler)
                    if owner.fixed:
                        arguments.append(f"least={owner.length}")
                compiler.may_fail = True
                return call("ecmascript.set_member", arguments, 0)
            case Index(object=inner, index=index):
                owner = _static(inner, self._context.variables)
                element = owner.element if isinstance(owner, Array) else ANY
                arguments = [compiler.value(inner), compiler.value(index)]
                arguments.append(compiler.value(value, element))
                if isinstance(owner, Array):
                    arguments += _growth(owner, compiler)
                compiler.may_fail = True
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
        return call("self._outputs.log", [quoted(label), compiler.text(value)], 0)

    def _emit(self, emit: Emit, compiler: ExpressionCompiler) -> list[str]:
        port = self._context.names.output(emit.kind, emit.interface)
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
                    kind = self._context.output_ports.get(emit.interface)
                    arguments.append(compiler.value(emit.fields[0].value, kind))
                case "thread_id" if emit.kind is OutputKind.THREAD_FREE:
                    arguments.append("self.thread_id" if self._context.is_thread else "0")
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
        return f"{self._context.class_of[kind.name]}({', '.join(arguments)})"

    def _raise(self, statement: Raise, compiler: ExpressionCompiler) -> list[str]:
        fields = [
            f'"{field.name}": {compiler.value(field.value, ANY)}' for field in statement.fields
        ]
        data = f"{{{', '.join(fields)}}}" if fields else "None"
        if not statement.external:
            return [f'self._internal.append(("{statement.event}", {data}))']
        delay = "0.0" if statement.delay_s is None else self._delay(statement.delay_s, compiler)
        arguments = [f'"{statement.event}"', data, delay, f'"{statement.id}"']
        return call("self._outputs.send_self", arguments, 0)

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
