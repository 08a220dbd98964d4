"""Checks of one element against the vocabulary: known here, known attributes, required ones."""

from __future__ import annotations

import math
from collections.abc import Collection

from m2c.diagnostics import DiagnosticLog, Position, shortened
from m2c.language.numerals import decimal
from m2c.model.vocabulary import ATTRIBUTES, MISPLACED
from m2c.model.xml import Element
from m2c.suggestions import nearest

_INSTEAD = {
    ("state", "final"): 'a final state is an element of its own, <final id="…"/>',
    ("send", "eventexpr"): "an event has a name; write `event`",
    ("send", "targetexpr"): "a machine has a name; write `target`",
    ("send", "typeexpr"): "events travel in one way; leave it out",
    ("send", "idlocation"): "a name is given by `id`",
    ("cancel", "sendidexpr"): "what is sent has a name; write `sendid`",
    ("data", "src"): "a value stands in `expr`",
}
"""What is written instead of an attribute of an element."""
_MAX_SHOWN = 80
"""Characters of a name that a note repeats."""


def check_element(
    element: Element,
    log: DiagnosticLog,
    *,
    as_tag: str = "",
    inside: Collection[str] = (),
    parent: str = "",
) -> bool:
    """Report an element that may not stand inside ``parent``, and attributes it does not have.

    Args:
        element: what to check.
        log: where ``unknown-tag`` and ``unknown-attribute`` go.
        as_tag: look the attributes up under this tag.
        inside: the tags allowed here; empty: any.
        parent: the element it stands in, for the message.

    Returns:
        Whether the element may stand here.
    """
    if inside and element.tag not in inside:
        log.error(
            "unknown-tag",
            element.position,
            element.tag,
            f"not an element of <{parent}>",
            MISPLACED.get(element.tag) or nearest(element.tag, inside),
        )
        return False
    check_attributes(element, ATTRIBUTES[as_tag or element.tag], log)
    return True


def check_attributes(element: Element, allowed: Collection[str], log: DiagnosticLog) -> None:
    """Report as ``unknown-attribute`` what ``element`` has besides the attributes ``allowed``."""
    for name in element.attributes:
        if name not in allowed:
            hint = nearest(name, allowed) if allowed else "it has no attributes"
            hint = _INSTEAD.get((element.tag, name), hint)
            what = f"unknown attribute `{name}`"
            log.error("unknown-attribute", element.at(name), element.tag, what, hint)


def require(element: Element, attribute: str, log: DiagnosticLog, hint: str = "") -> str:
    """The value of ``attribute``; reports ``missing-attribute`` and returns "" if there is none.

    SCXML computes some (``eventexpr``): that such a one is refused is reported elsewhere.
    """
    value = element.get(attribute)
    if not value and not element.get(f"{attribute}expr"):
        what = f"the attribute `{attribute}` is missing"
        log.error("missing-attribute", element.position, element.tag, what, hint)
    return value


def exclude(element: Element, one: str, other: str, log: DiagnosticLog) -> None:
    """Report ``unknown-attribute`` if ``element`` has both attributes, which say the same thing."""
    if one in element.attributes and other in element.attributes:
        what = f"`{one}` and `{other}` exclude each other"
        log.error("unknown-attribute", element.at(other), element.tag, what, "write one of them")


def note_read_as(
    position: Position,
    element: str,
    written: str,
    meaning: str,
    log: DiagnosticLog,
    hint: str = "`m2c convert` writes it so",
) -> None:
    """Note ``older-spelling``: that ``written`` is read as ``meaning``, which is today's way to say it."""
    what = f"`{shortened(written, _MAX_SHOWN)}` is read as {meaning}"
    log.note("older-spelling", position, element, what, hint)


def number(text: str) -> float | None:
    """The finite number that ``text`` is; None if it is none."""
    value = decimal(text)
    return value if value is not None and math.isfinite(value) else None
