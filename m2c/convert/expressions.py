"""Expressions in today's spelling: ``true`` for Python's ``True``, ``_msg`` for ``_event.data``."""

from __future__ import annotations

from m2c.diagnostics import DiagnosticLog, Position
from m2c.language.expressions import EventData, Expression, nodes
from m2c.language.parsing import parse_expression, python_boolean
from m2c.model.machine import EventKind

DATA_NAMES = {
    EventKind.MESSAGE: "_msg",
    EventKind.REQUEST: "_req",
    EventKind.RESPONSE: "_res",
}
"""How expressions call the data of an event that plain SCXML has, too."""
_EVENT_DATA = "_event.data"


def respelled(text: str, data_name: str) -> str:
    """The expression ``text``, with the same meaning.

    Args:
        text: an attribute's value or an element's text; what is no expression stays as it is.
        data_name: how event data are called here; "" to keep how they are written.
    """
    body = text.strip()
    if not any(word in body for word in ("True", "False", _EVENT_DATA)):
        return text
    expression = parse_expression(body, Position("", 1, 0), "", DiagnosticLog(), has_states=True)
    if expression is None:
        return text
    for node in sorted(nodes(expression), key=lambda item: item.position, reverse=True):
        start = node.position.column
        old, new = _respelling(node, body[start:], data_name)
        body = body[:start] + new + body[start + len(old) :]
    return text.replace(text.strip(), body)


def _respelling(node: Expression, text: str, data_name: str) -> tuple[str, str]:
    """What ``node``, with which ``text`` begins, is written as, and what instead; twice "" to keep it."""
    written = python_boolean(node, text)
    if written:
        return written, written.lower()
    is_data = isinstance(node, EventData) and node.part == "data" and bool(data_name)
    return (_EVENT_DATA, data_name) if is_data and text.startswith(_EVENT_DATA) else ("", "")
