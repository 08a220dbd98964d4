"""Findings as text, JSON or SARIF 2.1.0."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from typing import Any, TextIO
from urllib.parse import quote

from m2c.check.grouping import Group, by_rule, grouped
from m2c.check.rules import RULES, Rule
from m2c.diagnostics import Diagnostic, Severity
from m2c.json_format import VERSION, VERSION_KEY
from m2c.printable import printable
from m2c.terminal import folded, has_colour, show_painted

_COLOURS = {Severity.ERROR: "\x1b[31m", Severity.WARNING: "\x1b[33m", Severity.NOTE: "\x1b[36m"}
MOST_LISTED = 10
"""Findings that are seen at a glance; of more, and of several rules, a line says how many each rule has."""
_LEVELS = {Severity.ERROR: "error", Severity.WARNING: "warning", Severity.NOTE: "note"}


def print_findings(
    diagnostics: Sequence[Diagnostic],
    stream: TextIO | None = None,
    *,
    notes: bool = False,
    each: bool = False,
    option: str = "m2c check --all",
) -> None:
    """Findings in file order, a line for each; coloured on a terminal.

    Args:
        diagnostics: what was found.
        stream: where to; standard error by default.
        notes: show notes too.
        each: show each finding of a mistake that is repeated, not only the first.
        option: how the user gets to see each.
    """
    out = stream if stream is not None else sys.stderr
    colour = has_colour(out)
    lines = []
    shown = [found for found in diagnostics if notes or found.severity is not Severity.NOTE]
    ordered = sorted(shown, key=lambda item: (item.position, item.rule))
    for group in [Group(found, ()) for found in ordered] if each else grouped(ordered):
        lines.append(_line(group.first, colour))
        if group.others:
            files = _counted(len({found.position.file for found in group.others}), "file")
            more = f"... and {len(group.others)} more like this in {files}"
            lines.append(f"  {more} ({option} shows each)")
    show_painted(*(part for line in lines for part in folded(line, stream=out)), stream=out)


def _line(found: Diagnostic, colour: bool) -> str:
    where, text = printable(str(found.position)), printable(str(found))
    if not colour:
        return text
    painted = f" {_COLOURS[found.severity]}{found.severity}:\x1b[0m"
    return where + text[len(where) :].replace(f" {found.severity}:", painted, 1)


def count(diagnostics: Sequence[Diagnostic], severity: Severity) -> int:
    """How many findings have ``severity``."""
    return sum(found.severity is severity for found in diagnostics)


def as_json(diagnostics: Sequence[Diagnostic]) -> str:
    """An array of findings, each an object with file, line, column, severity, rule and texts."""
    return json.dumps([_entry(found) for found in diagnostics], indent=2)


def _entry(found: Diagnostic) -> dict[str, Any]:
    return {
        VERSION_KEY: VERSION,
        "file": found.position.file,
        "line": found.position.line,
        "column": found.position.column,
        "severity": str(found.severity),
        "rule": found.rule,
        "element": found.element,
        "message": found.message,
        "hint": found.hint,
    }


def summary(read: int, diagnostics: Sequence[Diagnostic], what: str = "model") -> list[str]:
    """``17 models, 1 error, 2 warnings``; ``what`` is the noun of what was ``read``.

    Before it, where there are more than ``MOST_LISTED`` findings of several rules, how many each has.
    """
    errors, warnings = count(diagnostics, Severity.ERROR), count(diagnostics, Severity.WARNING)
    counts = ((read, what), (errors, "error"), (warnings, "warning"))
    last = ", ".join(_counted(number, noun) for number, noun in counts)
    several = len({found.rule for found in diagnostics}) > 1
    return [by_rule(diagnostics), last] if several and len(diagnostics) > MOST_LISTED else [last]


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def as_sarif(diagnostics: Sequence[Diagnostic]) -> str:
    """A SARIF 2.1.0 log with one run (OASIS sarif-v2.1.0).

    Files are named relative to the current folder (``%SRCROOT%``), as code scanning wants them.
    """
    from importlib.metadata import version  # slow to import, and only this form names it

    rules = {rule.id: rule for rule in RULES}
    used = sorted({found.rule for found in diagnostics})
    driver = {
        "name": "m2c",
        "version": version("m2c-moon"),
        "rules": [_rule(rules[name]) for name in used],
    }
    run = {
        "tool": {"driver": driver},
        "columnKind": "unicodeCodePoints",
        "results": [_result(found, used) for found in diagnostics],
    }
    schema = "https://json.schemastore.org/sarif-2.1.0.json"
    return json.dumps({"$schema": schema, "version": "2.1.0", "runs": [run]}, indent=2)


def _rule(rule: Rule) -> dict[str, Any]:
    return {
        "id": rule.id,
        "shortDescription": {"text": rule.meaning},
        "defaultConfiguration": {"level": _LEVELS[rule.severity]},
    }


def _result(found: Diagnostic, rules: list[str]) -> dict[str, Any]:
    artifact = {"uri": relative_uri(found.position.file), "uriBaseId": "%SRCROOT%"}
    physical: dict[str, Any] = {"artifactLocation": artifact}
    if found.position.line:
        region = {"startLine": found.position.line, "startColumn": max(found.position.column, 1)}
        physical["region"] = region
    text = f"{found.message}; {found.hint}" if found.hint else found.message
    return {
        "ruleId": found.rule,
        "ruleIndex": rules.index(found.rule),
        "level": _LEVELS[found.severity],
        "message": {"text": text},
        "locations": [{"physicalLocation": physical}],
    }


def relative_uri(file: str) -> str:
    """``file`` relative to the current folder, as a URI reference (RFC 3986 section 4.2)."""
    path = os.path.relpath(file).replace(os.sep, "/")
    return quote(path.encode("utf-8", "surrogateescape"), safe="/")
