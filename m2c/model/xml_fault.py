"""Why an XML text is not read, and where."""

from __future__ import annotations


class XmlFault(Exception):
    """An XML text is refused.

    Attributes:
        line, column: where, counted from 1.
        message: what is wrong.
        hint: what would be right; "" if the message says it.
    """

    def __init__(self, line: int, column: int, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.line = line
        self.column = column
        self.message = message
        self.hint = hint


class MalformedXml(XmlFault):
    """The text is not XML."""


class HostileXml(XmlFault):
    """The text is larger or deeper than a model is, or declares a document type."""


def malformed(text: str, offset: int, reason: str, hint: str = "") -> MalformedXml:
    """That ``text`` is not XML at ``offset``."""
    return MalformedXml(*place_of(text, offset), f"malformed XML: {reason}", hint)


def hostile(text: str, offset: int, message: str, hint: str) -> HostileXml:
    """That what stands at ``offset`` of ``text`` is not read, whoever wrote it."""
    return HostileXml(*place_of(text, offset), message, hint)


def place_of(text: str, offset: int) -> tuple[int, int]:
    """Line and column, from 1, of the character at ``offset``."""
    return text.count("\n", 0, offset) + 1, offset - text.rfind("\n", 0, offset)
