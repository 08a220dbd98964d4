"""``interfaces.py`` of a generated package: the message classes that its machine uses."""

from __future__ import annotations

from collections.abc import Iterable

from m2c.codegen.expressions import attribute_of_field, quoted
from m2c.codegen.names import camel, distinct
from m2c.model.datatypes import INTEGER_RANGES, Array, DataType, Primitive, Structure
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


def class_names(structures: Iterable[Structure]) -> dict[str, str]:
    """Class name per type name: the type's last part, with its package where two would collide."""
    names: dict[str, str] = {}
    for structure in structures:
        package, _, last = structure.name.partition("/")
        short = camel(last.rpartition("/")[2])
        if short in names.values() or short == "State":
            short = distinct(camel(package) + short, names.values())
        names[structure.name] = short
    return names


def interface_module(
    structures: list[Structure], names: dict[str, str]
) -> tuple[list[str], set[str]]:
    """Lines of the classes, and the integer types that they use."""
    lines: list[str] = []
    used: set[str] = set()
    for structure in structures:
        lines += ["", "", f"class {names[structure.name]}(TypedMessage):"]
        lines.append(f'    """``{structure.name}``."""')
        lines += ["", f'    __type_name__: ClassVar[str] = "{structure.name}"']
        if structure.fields:
            lines.append("")
        defaults = dict(structure.defaults)
        for name, kind in structure.fields:
            annotation = _annotation(kind, names, used)
            default = _default(kind, defaults.get(name), names)
            lines.append(f"    {attribute_of_field(name)}: {annotation} = {default}")
    return lines, used


def _annotation(kind: DataType, names: dict[str, str], used: set[str]) -> str:
    match kind:
        case Primitive("bool"):
            return "bool"
        case Primitive("string"):
            return "str"
        case Primitive(name) if name in INTEGER_RANGES:
            used.add(INTEGERS[name])
            return INTEGERS[name]
        case Primitive():
            return "float"
        case Structure(name):
            return names[name]
        case Array(element, None, _):
            return f"list[{_annotation(element, names, used)}]"
        case Array(element, length, fixed):
            inner = f"list[{_annotation(element, names, used)}]"
            least = f"min_length={length}, " if fixed else ""
            return f"Annotated[{inner}, msgspec.Meta({least}max_length={length})]"


def _default(kind: DataType, declared: object, names: dict[str, str]) -> str:
    if isinstance(declared, tuple):
        return f"msgspec.field(default_factory=lambda: {list(declared)!r})"
    if declared is not None:
        if isinstance(declared, str):
            return quoted(declared)
        is_float = kind in (Primitive("float32"), Primitive("float64"))
        return repr(float(declared)) if is_float and isinstance(declared, int) else repr(declared)
    match kind:
        case Primitive():
            return zero_text(kind, names)
        case Structure(name):
            return f"msgspec.field(default_factory={names[name]})"
        case Array(_, _, True):
            return f"msgspec.field(default_factory=lambda: {zero_text(kind, names)})"
        case Array():
            return "msgspec.field(default_factory=list)"


def zero_text(kind: DataType, names: dict[str, str]) -> str:
    """Python source of the zero value of ``kind``."""
    match kind:
        case Primitive("bool"):
            return "False"
        case Primitive("string"):
            return '""'
        case Primitive(name) if name in INTEGER_RANGES:
            return "0"
        case Primitive(name) if name in ("any", "null"):
            return "None"
        case Primitive():
            return "0.0"
        case Structure(name):
            return f"{names[name]}()" if name else "{}"
        case Array(element, length, True):
            inner = zero_text(element, names)
            if isinstance(element, Primitive):
                return f"[{inner}] * {length}"
            return f"[{inner} for _ in range({length})]"
        case Array():
            return "[]"
