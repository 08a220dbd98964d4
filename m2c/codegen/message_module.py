"""The message classes of nodes that are written by hand, as one module."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from m2c.codegen.formatting import formatted
from m2c.codegen.interfaces import class_names, message_classes, needed_structures
from m2c.codegen.names import camel, distinct
from m2c.codegen.program import MessageModule, TypeOfCalls
from m2c.codegen.rendering import our_templates
from m2c.codegen.source import Source, name
from m2c.language.datatypes import Structure
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.standard import standard_texts
from m2c.suggestions import nearest

_KINDS = ("msg", "srv", "action")
_TAKEN = frozenset(
    {"Annotated", "ClassVar", "TypedMessage", "ServiceType", "ActionType", "True", "False", "None"}
)


class UnknownTypeError(Exception):
    """No type is called so; the text has the nearest name."""


def named_types(library: InterfaceLibrary, wanted: Iterable[str]) -> list[str]:
    """The types of the library's packages, and those that ``wanted`` names, as ``pkg/kind/Name``.

    Args:
        library: of the folders that were given.
        wanted: ``pkg/kind/Name``, ``pkg/Name``, or all of ``pkg``.

    Raises:
        UnknownTypeError: there is no such type or package.
    """
    own = [type_name for kind in _KINDS for type_name in library.names(kind)]
    known = sorted({*own, *standard_texts()})
    found = dict.fromkeys(own)
    for text in wanted:
        parts = text.split("/")
        of_it = [
            other
            for other in known
            if other == text
            or other.partition("/")[0] == text
            or (len(parts) == 2 and other.split("/")[::2] == parts)
        ]
        if not of_it:
            of_package = [other for other in known if other.partition("/")[0] == parts[0]]
            packages = {other.partition("/")[0] for other in known}
            raise UnknownTypeError(f"unknown type {text}; {nearest(text, of_package or packages)}")
        found |= dict.fromkeys(of_it)
    return list(found)


def message_module(library: InterfaceLibrary, types: Sequence[str], file_name: str) -> str:
    """The module with the classes of ``types`` and of all that they contain, formatted.

    Args:
        library: where they are looked up; faults in definitions go to its log.
        types: ``pkg/kind/Name``. The first of several that are called alike keeps the short name.
        file_name: what its first line calls it.

    Raises:
        KeyError: a definition has a fault, or a type that it contains is not known.
    """
    calls = []
    roots: list[Structure] = []
    for type_name in types:
        match type_name.split("/")[1]:
            case "msg":
                roots.append(library.message(type_name))
            case "srv":
                service = library.service(type_name)
                parts = [service.request, service.response]
                calls.append(("ServiceType", type_name, parts))
                roots += parts
            case _:
                action = library.action(type_name)
                parts = [action.goal, action.result, action.feedback]
                calls.append(("ActionType", type_name, parts))
                roots += parts
    ordered = needed_structures(roots)
    by_name = {structure.name: structure for structure in (*roots, *ordered)}
    names = class_names(by_name.values(), _TAKEN)
    used = {*_TAKEN, *names.values()}
    made = []
    for shape, type_name, parts in calls:
        package, _, last = type_name.partition("/")[0], "", type_name.rpartition("/")[2]
        short = (
            camel(last) if camel(last) not in used else distinct(camel(package) + camel(last), used)
        )
        used.add(short)
        classes = tuple(name(names[part.name]) for part in parts)
        made.append(TypeOfCalls(Source(shape), type_name, name(short), classes))
    module = MessageModule(file_name, message_classes(ordered, names), tuple(made))
    text = our_templates().render("message_module.py.j2", file_name, node=module)
    return formatted({file_name: text})[file_name]
