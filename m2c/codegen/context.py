"""What is known about one machine while it is lowered: its names, types and constants."""

from __future__ import annotations

from m2c.codegen.expressions import ExpressionCompiler
from m2c.codegen.names import attributes, constant, distinct, snake
from m2c.codegen.ports import PortNames
from m2c.codegen.source import Source, name
from m2c.language.datatypes import ANY, Array, DataType, Structure
from m2c.language.expressions import Literal, Unary
from m2c.language.typing import Scope
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import Data, Machine
from m2c.model.scopes import readable_ports
from m2c.model.walk import assigned_by, statements_of


class MachineContext:
    """Shared by what lowers one machine (or one action thread).

    Attributes:
        class_of: class name per type name of the messages.
        class_name: the machine's class.
        is_thread: the machine executes the goals of an action server.
        constants: variables that no statement assigns.
        output_ports: type of each output port of the behaviour tree.
        is_stepwise: it takes its eventless transitions one at a time, in turn with others.
    """

    def __init__(
        self,
        machine: Machine,
        library: InterfaceLibrary,
        names: PortNames,
        class_of: dict[str, str],
        class_name: str,
        is_thread: bool = False,
        is_stepwise: bool = False,
    ) -> None:
        self.machine = machine
        self.library = library
        self.names = names
        self.class_of = class_of
        self.class_name = class_name
        self.is_thread = is_thread
        self.is_stepwise = is_stepwise
        self.constants = frozenset(
            data.name for data in machine.data if _is_constant(data, machine)
        )
        self.variables = {data.name: data.type for data in machine.data}
        self._attributes = attributes(self.variables)
        self._state_names: dict[str, str] = {}
        for state in machine.states:
            taken = self._state_names.values()
            self._state_names[state.name] = constant(state.name, taken)
        methods = [name.lower() for name in self._state_names.values()]
        self._methods = {f"{verb}_{method}" for verb in ("enter", "exit") for method in methods}
        self._block_names: dict[str, str] = {}
        self._ports = readable_ports(machine)
        self.output_ports = {port.key: port.type for port in machine.ports if port.output}

    def attribute(self, variable: str) -> Source:
        """The attribute that holds a variable of the datamodel."""
        return name(self._attributes[variable])

    @property
    def state_class(self) -> Source:
        """Name of the enumeration of states."""
        return name(f"{self.class_name}State")

    def state_constant(self, state: str) -> Source:
        """The name of the enumeration's member that stands for ``state``."""
        return name(self._state_names[state])

    def state_text(self, state: str) -> Source:
        """The enumeration's member that stands for ``state``."""
        return name(f"{self.state_class}.{self._state_names[state]}")

    def state_method(self, state: str) -> Source:
        """What the names of the methods that enter and leave ``state`` end in."""
        return name(self._state_names[state].lower())

    def block_method(self, block: str) -> Source:
        """The name of the method that does what all blocks called ``block`` do, without its ``_``."""
        if block not in self._block_names:
            made = distinct(snake(block), self._methods)
            self._methods.add(made)
            self._block_names[block] = made
        return name(self._block_names[block])

    def child(self, written: str, owner: str) -> str:
        """A child's index: a number, or the variable of ``owner`` (the machine) that has it."""
        if written.isascii() and written.isdigit():
            return str(int(written))
        return f"{owner}.{self.attribute(written)}"

    def compiler(self, parts: dict[str, DataType], data_name: str = "data") -> ExpressionCompiler:
        """A compiler of expressions where an event has ``parts``, its data named ``data_name``."""
        scope = Scope(self.variables, parts, self._ports, self.machine.lenient)
        return ExpressionCompiler(scope, self._attributes, self.class_of, data_name)


def _is_constant(data: Data, machine: Machine) -> bool:
    literal = isinstance(data.initial, Literal) or (
        isinstance(data.initial, Unary) and isinstance(data.initial.operand, Literal)
    )
    if not literal or isinstance(data.type, Array | Structure) or data.type == ANY:
        return False
    return not any(data.name in assigned_by(item) for item in statements_of(machine))
