"""A type's definition as text, as bags keep it (``ros2msg``): its own fields, then those it needs.

https://mcap.dev/spec/registry, "ros2msg"; the sections are divided and headed as rosbag2 does it.
"""

from __future__ import annotations

from m2c.language.datatypes import Array, DataType, Primitive, Structure
from m2c.model.event_types import PACKAGE

_DIVIDER = "=" * 80


def definition_text(structure: Structure) -> str:
    """The definition of ``structure`` and of all that it is made of."""
    sections = [_fields(structure)]
    seen = {structure.name}
    waiting = _parts(structure)
    while waiting:
        part = waiting.pop(0)
        if part.name in seen:
            continue
        seen.add(part.name)
        sections.append(f"{_DIVIDER}\nMSG: {_short(part.name)}\n{_fields(part)}")
        waiting += _parts(part)
    return "".join(sections)


def _fields(structure: Structure) -> str:
    constants = [f"{kind} {name}={_constant(value)}\n" for name, kind, value in structure.constants]
    return "".join([*constants, *(f"{_spelt(kind)} {name}\n" for name, kind in structure.fields)])


def _constant(value: bool | int | float | str) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _spelt(kind: DataType) -> str:
    match kind:
        case Structure(name):
            return _short(name)
        case Array(element, None, _):
            return f"{_spelt(element)}[]"
        case Array(element, length, fixed):
            return f"{_spelt(element)}[{'' if fixed else '<='}{length}]"
        case Primitive(name):
            return name


def _parts(structure: Structure) -> list[Structure]:
    found = []
    for _, kind in structure.fields:
        inner = kind.element if isinstance(kind, Array) else kind
        while isinstance(inner, Array):
            inner = inner.element
        if isinstance(inner, Structure):
            found.append(inner)
    return found


def _short(name: str) -> str:
    """``pkg/Name`` of a message, as ROS writes it in definitions; others keep all parts.

    What a system declares has no package: it is in that of plain events, as generated definitions have it.
    """
    package, _, rest = name.partition("/")
    if not rest:
        return f"{PACKAGE}/{package}"
    return f"{package}/{rest.removeprefix('msg/')}"
