"""Why tests of others are left out: ``docs/w3c-tests.md``, which is compared with what the check refuses."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

_REASONS = (
    ("`<parallel>`: states that are active side by side", r"<parallel"),
    ("`<invoke>`: a machine that starts others", r"<invoke"),
    ("`<script>`: statements of ECMAScript", r"<script"),
    ("the basic HTTP event I/O processor", r"(?i)basichttp"),
    ("`_ioprocessors`, `_sessionid`, `_x`: sessions and their addresses", r"\b_(ioprocessors|sessionid|x)\b|#_scxml_"),
    (
        "`eventexpr`, `targetexpr`, `typeexpr`, `sendidexpr`, `idlocation`: names that are computed",
        r"\b(eventexpr|targetexpr|typeexpr|sendidexpr|idlocation)\b",
    ),
    ("`<content>`: a message that is text or XML", r"<content"),
    ("`<send type>`: the processor of an event", r"<send\b[^>]*\btype=(?!.http://www.w3.org/TR/scxml/#SCXMLEventProcessor)"),
    ("`binding=\"late\"`: variables that begin when their state is entered", r'binding="late"'),
    ("`<data src>`: values in files of their own", r"<data\b[^>]*\bsrc="),
    (
        "of `_event`, what is neither `name` nor `data` (`type`, `sendid`, `origin`, `invokeid`, `raw`), "
        "and `_event` itself as a value or outside a handler",
        r"\b_event\b(?!\.(?:name|data)\b)|Var1[^>]*_event\.name",
    ),
)  # fmt: skip
UNDECLARED = "a variable that is not declared, a location or an expression that is none: an error of the model, before the run"
EXPRESSIONS = "expressions beyond the language: functions, methods, `++`, `instanceof`, bits"


def reason_of(text: str, rules: Iterable[str]) -> str:
    """Why a model is refused.

    Args:
        text: the model.
        rules: of what is wrong with it.
    """
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    for reason, pattern in _REASONS:
        if re.search(pattern, text):
            return reason
    wrong = {"undeclared-variable", "bad-location"}
    return EXPRESSIONS if wrong.isdisjoint(rules) else UNDECLARED


def rows(found: dict[str, list[str]]) -> Iterator[str]:
    """The table's rows, the reason with most tests first."""
    for reason, names in sorted(found.items(), key=lambda item: (-len(item[1]), item[0])):
        yield f"| {reason} | {len(names)} | {', '.join(names)} |"
