"""Expressions in today's spelling: ``true`` for Python's ``True``, ``_msg`` for ``_event.data``."""

from __future__ import annotations

from collections.abc import Iterator

from m2c.model.diagnostics import DiagnosticLog, Position
from m2c.model.ecmascript import parse_expression
from m2c.model.expressions import EventData, Expression, Literal, children
from m2c.model.machine import EventKind

DATA_NAMES = {
    EventKind.MESSAGE: "_msg",
    EventKind.REQUEST: "_req",
    EventKind.RESPONSE: "_res",
}
"""How expressions call the data of an event that plain SCXML has, too."""
_BOOLEANS = {"True": "true", "False": "false"}
_EVENT_DATA = "_event.data"


def respelled(text: str, data_name: str) -> str:
    """The expression ``text``, with the same meaning.

    Args:
        text: an attribute's value or an element's text; what is no expression stays as it is.
        data_name: how event data are called here; "" to keep how they are written.
    """
    body = text.strip()
    if not any(word in body for word in (*_BOOLEANS, _EVENT_DATA)):
        return text
    expression = parse_expression(body, Position("", 1, 0), "", DiagnosticLog())
    if expression is None:
        return text
    for node in sorted(_all(expression), key=lambda item: item.position, reverse=True):
        start = node.position.column
        for word, new in _words(node, data_name):
            if body.startswith(word, start):
                body = body[:start] + new + body[start + len(word) :]
                break
    return text.replace(text.strip(), body)


def _words(node: Expression, data_name: str) -> Iterator[tuple[str, str]]:
    """What ``node`` may be written as, and what is written instead."""
    match node:
        case Literal(value=bool()):
            yield from _BOOLEANS.items()
        case EventData(part="data", spelling=spelling) if spelling == _EVENT_DATA and data_name:
            yield _EVENT_DATA, data_name


def _all(expression: Expression) -> Iterator[Expression]:
    yield expression
    for child in children(expression):
        yield from _all(child)
