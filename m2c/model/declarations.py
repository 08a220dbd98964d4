"""Reading what a machine declares: interfaces, behaviour-tree ports and the datamodel."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from m2c.diagnostics import DiagnosticLog, Position
from m2c.language.datatypes import (
    ANY,
    INT64,
    NULL,
    NUMBER,
    Array,
    DataType,
    Primitive,
    Structure,
    describe,
    is_number,
)
from m2c.language.expressions import ArrayLiteral, Expression, Literal, ObjectLiteral, PortInput
from m2c.language.parsing import parse_expression
from m2c.language.typing import Scope, constant_value, type_of
from m2c.model.content import ContentReader
from m2c.model.interfaces import InterfaceLibrary, canonical
from m2c.model.machine import Data, Foreach, Interface, InterfaceKind, Port, State
from m2c.model.naming import absolute
from m2c.model.structure import check_element, note_read_as, number, require
from m2c.model.types import parse_type, type_in_comment
from m2c.model.vocabulary import DECLARATIONS
from m2c.model.walk import statements_in
from m2c.model.xml import Element


class DeclarationReader:
    """Collects the declarations of one machine element.

    Args:
        log: where faults go.
        library: the types.
        outer: interfaces of the machine around an action thread.
        bounded: whether an array type ``T[n]`` has at most ``n`` elements (ASCXML).

    Attributes:
        interfaces: declared so far, those of the machine around an action thread first.
        ports: the behaviour-tree ports declared so far.
    """

    def __init__(
        self,
        log: DiagnosticLog,
        library: InterfaceLibrary,
        outer: tuple[Interface, ...],
        bounded: bool,
    ) -> None:
        self._bounded = bounded
        self._log = log
        self._library = library
        self.interfaces: list[Interface] = list(outer)
        self.ports: list[Port] = []

    def declare(self, element: Element) -> None:
        """Add what ``element`` declares; other elements are left alone."""
        if element.tag in DECLARATIONS:
            self._declare_channel(element)
        elif element.tag == "ros_time_rate":
            name = require(element, "name", self._log)
            written, port = self._given(element, "rate_hz")
            if not written and not port:
                require(element, "rate_hz", self._log)
            rate = number(written)
            if written and (rate is None or rate <= 0):
                self._log.error(
                    "bad-rate",
                    element.at("rate_hz"),
                    element.tag,
                    f"`{written}` is not a rate",
                    "rate_hz is a number of callbacks a second, greater than 0",
                )
            self._add(
                Interface(
                    kind=InterfaceKind.TIMER,
                    name=name,
                    position=element.position,
                    channel=name,
                    port=port or None,
                    rate_hz=0.0 if port else rate or 1.0,
                )
            )
        elif element.tag in ("bt_declare_port_in", "bt_declare_port_out"):
            key = require(element, "key", self._log)
            kind = parse_type(element, self._library, self._log, bounded=self._bounded)
            output = element.tag.endswith("out")
            self.ports.append(Port(key, kind or ANY, output, element.position))

    def _declare_channel(self, element: Element) -> None:
        kind, attribute, folder = DECLARATIONS[element.tag]
        short = attribute.removesuffix("_name")
        if short != attribute and (element.get(short) or element.first(short) is not None):
            note_read_as(element.at(short), element.tag, short, f"`{attribute}`", self._log)
        channel, port = self._given(element, attribute, short)
        written, _ = self._given(element, "type")
        if not written:
            require(element, "type", self._log)
        if not channel and not port:
            hint = f'write {attribute}="/…"'
            what = f"the attribute `{attribute}` is missing"
            self._log.error("missing-attribute", element.position, element.tag, what, hint)
        channel = absolute(channel) if channel else ""
        self._add(
            Interface(
                kind=kind,
                name=element.get("name") or channel or port,
                position=element.position,
                channel=channel or None,
                type_name=canonical(written, folder) if written else "",
                port=port or None,
            )
        )

    def _given(self, element: Element, *names: str) -> tuple[str, str]:
        """What an attribute or a child of one of these names says, and the port that says it at run time."""
        written = next((element.get(name) for name in names if element.get(name)), "")
        child = next(iter(element.all(*names)), None)
        if child is None:
            return written, ""
        lookup = child.first("bt_get_input")
        port = require(lookup, "key", self._log) if lookup is not None else ""
        return written or child.text.strip(), port

    def _add(self, interface: Interface) -> None:
        for known in self.interfaces:
            if known.kind is interface.kind and known.name == interface.name:
                self._log.error(
                    "duplicate-interface",
                    interface.position,
                    "",
                    f"a second {interface.kind.noun} is called `{interface.name}`",
                    f"the first is at {known.position}",
                )
        self.interfaces.append(interface)

    def data(self, root: Element, content: ContentReader) -> list[Data]:
        """The variables in the ``<datamodel>`` of ``root`` and of its states, in order."""
        found: list[Data] = []
        for model in _datamodels(root):
            if model not in root.children and root.get("binding") == "late":
                what = (
                    "variables that begin when their state is entered are not part of the language"
                )
                hint = 'write binding="early", and assign them in <onentry>'
                self._log.error("unsupported-element", model.position, model.tag, what, hint)
            for element in model.children:
                if not check_element(element, self._log, inside=("data",), parent="datamodel"):
                    continue
                data = self._read_item(element, content)
                if any(known.name == data.name for known in found):
                    self._log.error(
                        "duplicate-data",
                        element.position,
                        "data",
                        f"`{data.name}` is declared twice",
                        "ids are unique in a datamodel",
                    )
                found.append(data)
        return found

    def _read_item(self, element: Element, content: ContentReader) -> Data:
        name = require(element, "id", self._log)
        declared = None
        if element.get("type"):
            declared = parse_type(element, self._library, self._log, bounded=self._bounded)
        else:
            declared = type_in_comment(element, self._library, self._log, bounded=self._bounded)
        value = content.expression_of(element, "expr", optional=True)
        if value is None:
            value = _zero(declared, element.position)
        kind = declared
        if kind is None:
            kind = type_of(value, Scope({}))
            if is_number(kind):
                kind = NUMBER
            elif kind == NULL or isinstance(kind, Array) or isinstance(value, PortInput):
                kind = ANY
        lower = self._bound(element, "lower_bound_incl", kind)
        upper = self._bound(element, "upper_bound_incl", kind)
        if lower is not None and upper is not None and lower > upper:
            what = f"no number is from {lower} to {upper}"
            self._log.error("out-of-range", element.at("lower_bound_incl"), "data", what)
        return Data(name, kind, value, element.position, declared is not None, lower, upper)

    def _bound(self, element: Element, attribute: str, kind: DataType) -> int | float | None:
        """The number in ``attribute``, a bound of a variable of type ``kind``; None without one."""
        text = element.get(attribute)
        if not text:
            return None
        at = element.at(attribute)
        if not is_number(kind):
            what = f"a bound of `{element.get('id')}`, which is of type {describe(kind)}"
            self._log.error("type-mismatch", at, "data", what, "numbers have bounds")
            return None
        value = parse_expression(text, at, "data", self._log)
        bound = None if value is None else constant_value(value)
        if value is not None and bound is None:
            what = f"`{text}` is not a number"
            self._log.error("type-mismatch", at, "data", what, "a bound is written out")
        return bound


def _datamodels(parent: Element) -> Iterator[Element]:
    for child in parent.all("datamodel", "state"):
        if child.tag == "datamodel":
            yield child
        else:
            yield from _datamodels(child)


def loop_variables(states: Iterable[State], data: Sequence[Data]) -> tuple[Data, ...]:
    """The variables of ``<foreach>`` that ``data`` does not declare (W3C SCXML 4.6).

    An item has the type of the array's elements, as far as that is known; a place in the array is an int64.
    """
    types = {item.name: item.type for item in data}
    found: list[Data] = []
    loops = (it for state in states for it in statements_in(state) if isinstance(it, Foreach))
    for loop in loops:
        array = type_of(loop.array, Scope(types))
        element = array.element if isinstance(array, Array) else ANY
        for name, kind in ((loop.item, element), (loop.index, INT64)):
            if name and name not in types:
                types[name] = kind
                found.append(Data(name, kind, _zero(kind, loop.position), loop.position))
    return tuple(found)


def _zero(kind: DataType | None, position: Position) -> Expression:
    match kind:
        case Primitive("bool"):
            return Literal(value=False, position=position)
        case Primitive("string"):
            return Literal(value="", position=position)
        case Primitive(name) if name.startswith("float"):
            return Literal(value=0.0, position=position)
        case Primitive(name) if name != "any":
            return Literal(value=0, position=position)
        case Array():
            return ArrayLiteral(position=position)
        case Structure():
            return ObjectLiteral(position=position)
        case _:
            return Literal(value=None, position=position)
