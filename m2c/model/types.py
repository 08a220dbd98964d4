"""Reading the ``type`` attribute of data and ports."""

from __future__ import annotations

import re

from m2c.model.datatypes import FLOATS, INTEGER_RANGES, Array, DataType, Primitive
from m2c.model.diagnostics import DiagnosticLog
from m2c.model.interfaces import InterfaceLibrary
from m2c.model.typing import nearest
from m2c.model.xml import Element
from m2c.runtime.conversion import MAX_LENGTH

_ARRAY = re.compile(r"(.+?)\[(?:(<=)?(\d{1,9}))?\]\Z")
_PRIMITIVES = {*INTEGER_RANGES, *FLOATS, "bool", "string"}


def parse_type(element: Element, library: InterfaceLibrary, log: DiagnosticLog) -> DataType | None:
    """The type that ``element``'s attribute ``type`` names; None after reporting ``unknown-type``."""
    text = element.get("type")
    kind = _parse(text, library)
    if isinstance(kind, str):
        log.error("unknown-type", element.at("type"), element.tag, f"unknown type `{text}`", kind)
        return None
    return kind


def _parse(text: str, library: InterfaceLibrary) -> DataType | str:
    match = _ARRAY.match(text)
    if match is not None:
        element = _parse(match[1], library)
        if isinstance(element, str):
            return element
        length = int(match[3]) if match[3] else None
        if length is not None and length > MAX_LENGTH:
            return f"an array has at most {MAX_LENGTH} elements"
        return Array(element, length, bool(match[3]) and not match[2])
    if text in _PRIMITIVES:
        return Primitive(text)
    if "/" in text or "::" in text:
        try:
            return library.message(text)
        except KeyError as error:
            near = str(error.args[0]).partition("; ")[2]
            return near or "give the folder of its definition with --interfaces"
    return nearest(text, _PRIMITIVES)
