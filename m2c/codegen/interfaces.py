"""The message classes that a machine uses: facts of a generated ``interfaces.py``."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from m2c.codegen.names import camel, distinct, field_attribute
from m2c.codegen.program import MessageClass, MessageField
from m2c.codegen.source import Source, name, py
from m2c.language.datatypes import FLOATS, INTEGER_RANGES, Array, DataType, Primitive, Structure
from m2c.runtime.messages import INTEGERS


def needed_structures(roots: Iterable[Structure]) -> list[Structure]:
    """``roots`` and everything they contain, contained ones first, each once."""
    ordered: dict[str, Structure] = {}

    def add(kind: DataType) -> None:
        if isinstance(kind, Array):
            add(kind.element)
        elif isinstance(kind, Structure) and kind.name not in ordered:
            for _, inner in kind.fields:
                add(inner)
            ordered[kind.name] = kind

    for root in roots:
        add(root)
    return list(ordered.values())


def class_names(structures: Iterable[Structure], taken: Collection[str]) -> dict[str, str]:
    """Class name per type name: the type's last part, with its package where that is ``taken``.

    A structure that the system declares has no package: ``DataPose``.
    """
    names: dict[str, str] = {}
    for structure in structures:
        package, _, last = structure.name.rpartition("/")
        short = camel(last)
        used = {*taken, *names.values()}
        if short in used:
            short = distinct(camel(package.partition("/")[0] or "Data") + short, used)
        names[structure.name] = short
    return names


def message_classes(
    structures: Iterable[Structure], names: dict[str, str]
) -> tuple[MessageClass, ...]:
    """The class of each of ``structures``; ``names``: class name per type name."""
    return tuple(
        MessageClass(
            structure.name,
            name(names[structure.name]),
            tuple(
                _field(field, kind, dict(structure.defaults).get(field), names)
                for field, kind in structure.fields
            ),
        )
        for structure in structures
    )


def _field(field: str, kind: DataType, declared: object, names: dict[str, str]) -> MessageField:
    default, is_factory = _default(kind, declared, names)
    attribute = field_attribute(field)
    annotation = Source(_annotation(kind, names))
    return MessageField(field, name(attribute), annotation, Source(default), is_factory)


def _annotation(kind: DataType, names: dict[str, str]) -> str:
    match kind:
        case Primitive("bool"):
            return "bool"
        case Primitive("string"):
            return "str"
        case Primitive(primitive) if primitive in INTEGER_RANGES:
            return INTEGERS[primitive]
        case Primitive():
            return "float"
        case Structure(structure):
            return names[structure]
        case Array(element, None, _):
            return f"list[{_annotation(element, names)}]"
        case Array(element, length, fixed):
            least = f"min_length={length}, " if fixed else ""
            bound = f"msgspec.Meta({least}max_length={length})"
            return f"Annotated[list[{_annotation(element, names)}], {bound}]"


def _default(kind: DataType, declared: object, names: dict[str, str]) -> tuple[str, bool]:
    """The default of a field of type ``kind``, and whether it is what makes one."""
    if isinstance(declared, tuple):
        return f"lambda: {list(declared)!r}", True
    if declared is not None:
        is_float = isinstance(kind, Primitive) and kind.name in FLOATS
        return py(float(declared) if is_float and isinstance(declared, int) else declared), False
    match kind:
        case Primitive():
            return zero_text(kind, names), False
        case Structure(structure):
            return names[structure], True
        case Array(_, _, True):
            return f"lambda: {zero_text(kind, names)}", True
        case Array():
            return "list", True


def zero_text(kind: DataType, names: dict[str, str]) -> str:
    """Python source of the zero value of ``kind``."""
    match kind:
        case Primitive("bool"):
            return "False"
        case Primitive("string"):
            return '""'
        case Primitive(primitive) if primitive in INTEGER_RANGES:
            return "0"
        case Primitive(primitive) if primitive in ("any", "null"):
            return "None"
        case Primitive():
            return "0.0"
        case Structure(structure):
            return f"{names[structure]}()" if structure else "{}"
        case Array(element, length, True):
            inner = zero_text(element, names)
            if isinstance(element, Primitive):
                return f"[{inner}] * {length}"
            return f"[{inner} for _ in range({length})]"
        case Array():
            return "[]"
