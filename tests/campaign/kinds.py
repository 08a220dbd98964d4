"""Types of values as the generator sees them, and the interface definitions and structures made of them."""

from __future__ import annotations

from random import Random

import msgspec

from tests.campaign.elements import Element, e
from tests.campaign.plans import PACKAGE, Definition


class Kind(msgspec.Struct, frozen=True):
    """A type: a primitive, a message or structure (``fields``), or an array (``item``).

    Attributes:
        name: as a model writes it.
        bound: most elements of an array; 0: any number.
    """

    name: str
    fields: tuple[tuple[str, Kind], ...] = ()
    item: Kind | None = None
    bound: int = 0

    @property
    def is_integer(self) -> bool:
        """Whether it holds whole numbers."""
        return self.item is None and self.name.lstrip("u").startswith("int")

    @property
    def is_float(self) -> bool:
        """Whether it holds fractions."""
        return self.item is None and self.name.startswith("float")

    @property
    def is_record(self) -> bool:
        """Whether it has fields."""
        return bool(self.fields)


def array(item: Kind, bound: int = 0) -> Kind:
    """An array of ``item``."""
    return Kind(f"{item.name}[{f'<={bound}' if bound else ''}]", (), item, bound)


INT32, INT64, INT8 = Kind("int32"), Kind("int64"), Kind("int8")
UINT8, FLOAT64, FLOAT32 = Kind("uint8"), Kind("float64"), Kind("float32")
BOOL, STRING = Kind("bool"), Kind("string")
PRIMITIVES = (INT32, INT32, INT64, INT8, UINT8, FLOAT64, FLOAT32, BOOL, BOOL, STRING)
STD = {
    "Int32": Kind("std_msgs/Int32", (("data", INT32),)),
    "Bool": Kind("std_msgs/Bool", (("data", BOOL),)),
    "String": Kind("std_msgs/String", (("data", STRING),)),
}


class Service(msgspec.Struct, frozen=True):
    """A service's type."""

    name: str
    request: Kind
    response: Kind


class ActionType(msgspec.Struct, frozen=True):
    """An action's type."""

    name: str
    goal: Kind
    result: Kind
    feedback: Kind


TICK_RESPONSE = Kind("", (("status", INT8), ("is_ok", BOOL)))
EMPTY = Kind("")
CONDITION = Service("bt_interfaces/TickCondition", EMPTY, TICK_RESPONSE)
ACTION = Service("bt_interfaces/TickAction", EMPTY, TICK_RESPONSE)
HALT = Service("bt_interfaces/HaltAction", EMPTY, Kind("", (("is_ok", BOOL),)))


class Kinds:
    """The types of one system.

    Attributes:
        messages, services, actions: to be had.
        structures: declared in ``types.xml``.
    """

    def __init__(self, draw: Random) -> None:
        self._draw = draw
        self._texts: dict[str, str] = {}
        inner = self._message("Mark", draw.randint(1, 3), ())
        middle = self._message("Reading", draw.randint(1, 3), (inner, array(inner, 3)))
        self.messages = [inner, middle, *STD.values()]
        self.services = [
            Service(
                f"{PACKAGE}/Ask{number}", *self._parts("srv", f"Ask{number}", ("value", "value"))
            )
            for number in range(2)
        ]
        self.actions = [
            ActionType(
                f"{PACKAGE}/Work{number}",
                *self._parts("action", f"Work{number}", ("amount", "done", "left")),
            )
            for number in range(2)
        ]
        self.structures: list[Kind] = []
        for name in ("Item", "Stop")[: draw.randint(1, 2)]:
            fields = self._fields(2, tuple(self.structures))
            self.structures.append(Kind(name, (("count", INT32), *fields)))

    def definitions(self) -> tuple[Definition, ...]:
        """Their files."""
        return tuple(Definition(name, text) for name, text in self._texts.items())

    def declarations(self) -> Element:
        """The structures' file."""
        return e(
            "types",
            *(
                e("struct", *(e("member", id=n, type=k.name) for n, k in kind.fields), id=kind.name)
                for kind in self.structures
            ),
        )

    def _message(self, name: str, count: int, others: tuple[Kind, ...]) -> Kind:
        fields = (("number", INT32), *self._fields(count, others))
        self._texts[f"msg/{name}"] = _text(fields)
        return Kind(f"{PACKAGE}/{name}", fields)

    def _parts(self, folder: str, name: str, needed: tuple[str, ...]) -> list[Kind]:
        parts = [
            Kind("", ((first, INT32), *self._fields(self._draw.randint(0, 2), ())))
            for first in needed
        ]
        self._texts[f"{folder}/{name}"] = "\n---\n".join(_text(part.fields) for part in parts)
        return parts

    def _fields(self, count: int, others: tuple[Kind, ...]) -> tuple[tuple[str, Kind], ...]:
        names = self._draw.sample(["first", "second", "level", "label", "items", "state"], count)
        pool = (*PRIMITIVES, array(INT32), array(INT32, 4), *others, *others, *others)
        return tuple((name, self._draw.choice(pool)) for name in names)


def _text(fields: tuple[tuple[str, Kind], ...]) -> str:
    return "\n".join(f"{_written(kind)} {name}" for name, kind in fields)


def _written(kind: Kind) -> str:
    return kind.name.replace(f"{PACKAGE}/", "")
