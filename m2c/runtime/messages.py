"""Typed messages: the integer types of ROS 2, and message classes made at run time."""

from __future__ import annotations

import copy
import types
from typing import Annotated, Any, ClassVar, Generic, TypeVar

import msgspec
import msgspec.inspect

from m2c.language.datatypes import (
    BOOL,
    FLOAT64,
    INT64,
    INTEGER_RANGES,
    STRING,
    Array,
    DataType,
    Primitive,
    Structure,
)

int8 = Annotated[int, msgspec.Meta(ge=-(2**7), le=2**7 - 1)]
int16 = Annotated[int, msgspec.Meta(ge=-(2**15), le=2**15 - 1)]
int32 = Annotated[int, msgspec.Meta(ge=-(2**31), le=2**31 - 1)]
int64 = Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1)]
uint8 = Annotated[int, msgspec.Meta(ge=0, le=2**8 - 1)]
uint16 = Annotated[int, msgspec.Meta(ge=0, le=2**16 - 1)]
uint32 = Annotated[int, msgspec.Meta(ge=0, le=2**32 - 1)]
uint64 = Annotated[int, msgspec.Meta(ge=0)]
"""Integers of a width, checked when a message is decoded. (msgspec bounds by int64, so an unsigned
64-bit integer is only checked from below: MessagePack cannot carry a larger one.)"""

INTEGERS: dict[str, str] = {
    "byte": "uint8",
    "char": "uint8",
    **{f"int{bits}": f"int{bits}" for bits in (8, 16, 32, 64)},
    **{f"uint{bits}": f"uint{bits}" for bits in (8, 16, 32, 64)},
}
"""Name of the annotated type for each integer primitive."""


class TypedMessage(msgspec.Struct, forbid_unknown_fields=True):
    """What every message class derives from; ``__type_name__`` is its ROS type name."""

    __type_name__: ClassVar[str] = ""


Request = TypeVar("Request", bound=msgspec.Struct)
Response = TypeVar("Response", bound=msgspec.Struct)
Goal = TypeVar("Goal", bound=msgspec.Struct)
Result = TypeVar("Result", bound=msgspec.Struct)
Feedback = TypeVar("Feedback", bound=msgspec.Struct)


class ServiceType(msgspec.Struct, Generic[Request, Response], frozen=True):
    """A type of services, with the classes of its messages, as in ``SetBool.Request(data=True)``.

    Attributes:
        type_name: its ROS name, ``std_srvs/srv/SetBool``.
        Request: the class of requests.
        Response: the class of responses.
    """

    type_name: str
    Request: type[Request]
    Response: type[Response]


class ActionType(msgspec.Struct, Generic[Goal, Result, Feedback], frozen=True):
    """A type of actions, with the classes of its messages.

    Attributes:
        type_name: its ROS name, ``example_interfaces/action/Fibonacci``.
        Goal: the class of goals.
        Result: the class of results.
        Feedback: the class of feedback.
    """

    type_name: str
    Goal: type[Goal]
    Result: type[Result]
    Feedback: type[Feedback]


_classes: dict[Structure, type[msgspec.Struct]] = {}


def message_class(structure: Structure) -> type[msgspec.Struct]:
    """The class for messages of type ``structure``: what a generated ``interfaces.py`` declares."""
    known = _classes.get(structure)
    if known is not None:
        return known
    fields: list[Any] = [
        (name, _annotation(kind), _default(kind, dict(structure.defaults).get(name)))
        for name, kind in structure.fields
    ]
    made = msgspec.defstruct(
        structure.name.rpartition("/")[2],
        fields,
        bases=(TypedMessage,),
        namespace={"__type_name__": structure.name},
        forbid_unknown_fields=True,
    )
    _classes[structure] = made
    return made


def _annotation(kind: DataType) -> Any:
    match kind:
        case Primitive("bool"):
            return bool
        case Primitive("string"):
            return str
        case Primitive(name) if name in INTEGER_RANGES:
            return globals()[INTEGERS[name]]
        case Primitive():
            return float
        case Structure():
            return message_class(kind)
        case Array(element, length, fixed):
            inner = types.GenericAlias(list, (_annotation(element),))
            if length is None:
                return inner
            least = length if fixed else 0
            return Annotated[inner, msgspec.Meta(min_length=least, max_length=length)]


def structure_of(message: type[TypedMessage]) -> Structure:
    """The type of messages of the class ``message``, whose integers have no width: int64."""
    fields = tuple(
        (field.encode_name, _type_of(msgspec.inspect.type_info(field.type)))
        for field in msgspec.structs.fields(message)
    )
    return Structure(message.__type_name__, fields)


def _type_of(annotation: msgspec.inspect.Type) -> DataType:
    match annotation:
        case msgspec.inspect.BoolType():
            return BOOL
        case msgspec.inspect.StrType():
            return STRING
        case msgspec.inspect.IntType():
            return INT64
        case msgspec.inspect.FloatType():
            return FLOAT64
        case msgspec.inspect.ListType(item_type=item):
            return Array(_type_of(item))
        case msgspec.inspect.StructType(cls=inner) if issubclass(inner, TypedMessage):
            return structure_of(inner)
    raise AssertionError(annotation)


def zero(kind: DataType) -> Any:
    """The zero value of ``kind``, as ROS 2 initialises a field (mutable ones are fresh)."""
    match kind:
        case Primitive("bool"):
            return False
        case Primitive("string"):
            return ""
        case Primitive(name) if name in INTEGER_RANGES:
            return 0
        case Primitive():
            return 0.0
        case Structure():
            return message_class(kind)()
        case Array(element, length, True):
            return [zero(element) for _ in range(length or 0)]
        case Array():
            return []


def _default(kind: DataType, declared: Any) -> Any:
    if declared is not None:
        value = list(declared) if isinstance(declared, tuple) else declared
        if isinstance(value, list):
            return msgspec.field(default_factory=lambda: copy.deepcopy(value))
        return float(value) if kind in (Primitive("float32"), Primitive("float64")) else value
    if isinstance(kind, Primitive):
        return zero(kind)
    return msgspec.field(default_factory=lambda: zero(kind))
