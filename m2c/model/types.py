"""Reading the ``type`` attribute of data, ports and members."""

from __future__ import annotations

import math
import re

from m2c.diagnostics import DiagnosticLog
from m2c.language.conversion import MAX_DEPTH, MAX_LENGTH
from m2c.language.datatypes import ANY, FLOATS, INTEGER_RANGES, Array, DataType, Primitive
from m2c.model.definitions import ros_2_name
from m2c.model.interfaces import InterfaceLibrary, fault_of
from m2c.model.xml import Element
from m2c.suggestions import nearest

PRIMITIVES = frozenset({*INTEGER_RANGES, *FLOATS, "bool", "string"})
_ARRAY = re.compile(r"([^\[\]]+)((?:\[(?:<=)?\d{0,9}\])+)\Z", re.ASCII)
_COMMENT = re.compile(r"TYPE\s+([^:]+):(.+)", re.DOTALL)
_DIMENSION = re.compile(r"\[(<=)?(\d*)\]", re.ASCII)


def parse_type(
    element: Element, library: InterfaceLibrary, log: DiagnosticLog, *, bounded: bool = False
) -> DataType | None:
    """The type that ``element``'s attribute ``type`` names; None after reporting ``unknown-type``.

    ``bounded``: ``T[n]`` has at most ``n`` elements; see :func:`type_of_text`.
    """
    text = element.get("type")
    kind = type_of_text(text, library, bounded=bounded)
    if isinstance(kind, str):
        log.error("unknown-type", element.at("type"), element.tag, f"unknown type `{text}`", kind)
        return None
    return kind


def type_in_comment(
    element: Element, library: InterfaceLibrary, log: DiagnosticLog, *, bounded: bool = False
) -> DataType | None:
    """The type that the comment ``<!-- TYPE id:T -->`` before ``element`` gives; None without one.

    Reports ``unknown-type`` if it is none, or of another ``id``.
    """
    match = _COMMENT.fullmatch(element.comment)
    if match is None:
        return None
    name, text = match[1].strip(), match[2].strip()
    kind = type_of_text(text, library, bounded=bounded)
    if name != element.get("id"):
        what = f"the comment before it gives the type of `{name}`"
        log.error("unknown-type", element.at("id"), element.tag, what, 'write type="…"')
    elif isinstance(kind, str):
        what = f"unknown type `{text}` in the comment before it"
        log.error("unknown-type", element.position, element.tag, what, kind)
    return None if isinstance(kind, str) else kind


def type_of_text(text: str, library: InterfaceLibrary, *, bounded: bool = False) -> DataType | str:
    """The type that ``text`` names, or what would be right.

    Args:
        text: a primitive, ``pkg/Message`` or a declared structure, with ``[]``, ``[<=n]`` or ``[n]`` for each
            dimension of an array, the outermost first: ``T[][5]`` is any number of arrays of 5.
        library: the messages and structures.
        bounded: whether ``[n]`` means up to ``n`` elements, as ASCXML has it, and not always ``n``.
    """
    match = _ARRAY.match(text)
    if match is None:
        return _element(text, library)
    kind = _element(match[1], library)
    dimensions = _DIMENSION.findall(match[2])
    lengths = [int(digits) for _, digits in dimensions if digits]
    if len(dimensions) > MAX_DEPTH:
        return f"an array has at most {MAX_DEPTH} dimensions"
    if max(lengths, default=0) > MAX_LENGTH or (not bounded and math.prod(lengths) > MAX_LENGTH):
        return f"an array has at most {MAX_LENGTH} elements"
    if ("<=", "") in dimensions:
        return "a bound is written like [<=5]"
    for bound, digits in reversed(dimensions):
        if isinstance(kind, str):
            break
        kind = Array(kind, int(digits) if digits else None, bool(digits) and not (bound or bounded))
    return kind


def _element(text: str, library: InterfaceLibrary) -> DataType | str:
    if text in PRIMITIVES:
        return Primitive(text)
    if "/" in text or "::" in text:
        try:
            return library.message(text)
        except KeyError as error:
            what, hint = fault_of(error)
            return what.partition("; ")[2] or hint
    if text in library.structures:
        return library.structures[text]
    if library.lacks_structures:
        return ANY
    right = ros_2_name(text)
    return f"did you mean {right}?" if right else nearest(text, [*PRIMITIVES, *library.structures])
