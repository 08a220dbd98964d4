"""What is wrong with a model, where, and what would be right.

Every reader and every check reports through :class:`Diagnostic`, so that a user sees one shape of
message whichever part of the tool found the fault: ``file:line:column: severity: <element>: what
is wrong; what would be right [rule]``.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum

import msgspec


class Severity(StrEnum):
    """How bad a finding is: an error stops every tool (exit 2), a warning does not."""

    ERROR = "error"
    WARNING = "warning"
    NOTE = "note"


class Position(msgspec.Struct, frozen=True, order=True):
    """A place in a model file. ``line`` and ``column`` count from 1; 0 means "the whole file"."""

    file: str
    line: int = 0
    column: int = 0

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}"


class Diagnostic(msgspec.Struct, frozen=True):
    """One finding.

    Attributes:
        severity: error, warning or note.
        rule: the stable kebab-case name of the rule that found it, e.g. ``undeclared-variable``.
        position: where.
        element: the XML element concerned, without brackets, e.g. ``assign``; empty if none.
        message: what is wrong, in one clause without a final full stop.
        hint: what would be right, in one clause; empty if the message says it.
    """

    severity: Severity
    rule: str
    position: Position
    element: str
    message: str
    hint: str = ""

    def __str__(self) -> str:
        element = f"<{self.element}>: " if self.element else ""
        hint = f"; {self.hint}" if self.hint else ""
        return f"{self.position}: {self.severity}: {element}{self.message}{hint} [{self.rule}]"


def shortened(text: str, most: int) -> str:
    """``text``, cut after ``most`` characters: what a message quotes may be as long as the file."""
    return text if len(text) <= most else f"{text[:most]}…"


class ModelError(Exception):
    """A model that cannot be used. ``diagnostics`` has at least one error."""

    def __init__(self, diagnostics: Iterable[Diagnostic]) -> None:
        self.diagnostics = tuple(diagnostics)
        super().__init__("\n".join(str(diagnostic) for diagnostic in self.diagnostics))


class DiagnosticLog:
    """Collects findings while a model is read or checked."""

    def __init__(self) -> None:
        self.diagnostics: list[Diagnostic] = []

    def error(
        self, rule: str, position: Position, element: str, message: str, hint: str = ""
    ) -> None:
        """Record an error."""
        self._add(Severity.ERROR, rule, position, element, message, hint)

    def warning(
        self, rule: str, position: Position, element: str, message: str, hint: str = ""
    ) -> None:
        """Record a warning."""
        self._add(Severity.WARNING, rule, position, element, message, hint)

    def note(
        self, rule: str, position: Position, element: str, message: str, hint: str = ""
    ) -> None:
        """Record a note."""
        self._add(Severity.NOTE, rule, position, element, message, hint)

    def _add(
        self,
        severity: Severity,
        rule: str,
        position: Position,
        element: str,
        message: str,
        hint: str,
    ) -> None:
        self.diagnostics.append(Diagnostic(severity, rule, position, element, message, hint))

    @property
    def has_errors(self) -> bool:
        """Whether any finding so far is an error."""
        return any(found.severity is Severity.ERROR for found in self.diagnostics)

    def raise_if_errors(self) -> None:
        """Raise :class:`ModelError` with everything found so far, if any of it is an error."""
        if self.has_errors:
            raise ModelError(self.diagnostics)
