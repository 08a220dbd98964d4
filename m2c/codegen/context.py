"""What is known about one machine while it is written: its names, types and constants."""

from __future__ import annotations

from m2c.codegen.expressions import ExpressionCompiler
from m2c.codegen.names import constant
from m2c.codegen.ports import PortNames
from m2c.model.datatypes import ANY, Array, DataType, Structure
from m2c.model.expressions import Literal, Unary
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.machine import Assign, Data, Machine, State
from m2c.model.typing import Scope
from m2c.model.walk import root_of, statements_of


class MachineContext:
    """Shared by the writers of one machine (or of one action thread).

    Attributes:
        class_of: class name per type name of the messages.
        class_name: the class that is written.
        is_thread: the machine executes the goals of an action server.
        constants: variables that no statement assigns.
        raises: whether internal events can occur.
        output_ports: type of each output port of the behaviour tree.
    """

    def __init__(
        self,
        machine: Machine,
        library: InterfaceLibrary,
        names: PortNames,
        class_of: dict[str, str],
        class_name: str,
        is_thread: bool = False,
    ) -> None:
        self.machine = machine
        self.library = library
        self.names = names
        self.class_of = class_of
        self.class_name = class_name
        self.is_thread = is_thread
        self.constants = frozenset(
            data.name for data in machine.data if _is_constant(data, machine)
        )
        self.variables = {data.name: data.type for data in machine.data}
        self.raises = True
        self.state_names: dict[str, str] = {}
        for state in machine.states:
            self.state_names[state.name] = constant(state.name, self.state_names.values())
        self._ports = {port.key: port.type for port in machine.ports if not port.output}
        self.output_ports = {port.key: port.type for port in machine.ports if port.output}

    @property
    def state_class(self) -> str:
        """Name of the enumeration of states."""
        return f"{self.class_name}State"

    def state_text(self, name: str) -> str:
        """The member of the enumeration that stands for state ``name``."""
        return f"{self.state_class}.{self.state_names[name]}"

    def method_part(self, state: State) -> str:
        """What the names of the methods that enter and leave ``state`` end in."""
        return self.state_names[state.name].lower().strip("_")

    def compiler(self, parts: dict[str, DataType], data_name: str = "data") -> ExpressionCompiler:
        """A compiler of expressions where an event has ``parts``, its data named ``data_name``."""
        scope = Scope(self.variables, parts, self._ports)
        return ExpressionCompiler(scope, self.constants, self.class_of, data_name)


def _is_constant(data: Data, machine: Machine) -> bool:
    literal = isinstance(data.initial, Literal) or (
        isinstance(data.initial, Unary) and isinstance(data.initial.operand, Literal)
    )
    if not literal or isinstance(data.type, Array | Structure) or data.type == ANY:
        return False
    return not any(
        isinstance(item, Assign) and root_of(item.location) == data.name
        for item in statements_of(machine)
    )
