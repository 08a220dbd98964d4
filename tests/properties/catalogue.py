"""The catalogue of patterns as timelines, drawn by running the monitors.

``python -m tests.properties.catalogue`` writes docs/property-patterns.md and a page of each pattern in
docs/patterns; a test holds the pages to it.
"""

from __future__ import annotations

from pathlib import Path

from moon.properties.describe import pattern_sentence
from moon.properties.formula import TICKS_PER_SECOND, Interval, text
from moon.properties.monitor import PropertyMonitor
from moon.properties.patterns import (
    Pattern,
    PatternName,
    Scope,
    ScopeName,
    deadline,
    pattern_formula,
)
from moon.properties.property import Status
from moon.properties.syntax import parse_formula
from tests.properties.runs import seen

LENGTH = 26
P, S, T, Q, R = (parse_formula(f"{{{letter}}}") for letter in "pstqr")
SCOPES = {
    ScopeName.GLOBALLY: (Scope(), {}),
    ScopeName.BEFORE: (Scope(ScopeName.BEFORE, end=R), {"r": {21}}),
    ScopeName.AFTER: (Scope(ScopeName.AFTER, begin=Q), {"q": {3}}),
    ScopeName.BETWEEN: (Scope(ScopeName.BETWEEN, Q, R), {"q": {3, 14}, "r": {11, 22}}),
    ScopeName.AFTER_UNTIL: (Scope(ScopeName.AFTER_UNTIL, Q, R), {"q": {3, 14}, "r": {11, 22}}),
}
WRITTEN = {
    ScopeName.GLOBALLY: "nothing",
    ScopeName.BEFORE: "`before: r`",
    ScopeName.AFTER: "`after: q`",
    ScopeName.BETWEEN: "`between: [q, r]`",
    ScopeName.AFTER_UNTIL: "`after_until: [q, r]`",
}
LEGEND = """One column is a second. `#`: the predicate holds. `-`: the property is true so far. `X`: it is false.
The timelines are what the monitors say."""
WITHIN_3 = Interval(0, 3 * TICKS_PER_SECOND)
WITHIN_5 = Interval(0, 5 * TICKS_PER_SECOND)
PATTERNS = {
    PatternName.ABSENCE: ((P,), Interval(), {"p": {1, 18}}),
    PatternName.UNIVERSALITY: ((P,), Interval(), {"p": set(range(26)) - {1, 18, 19}}),
    PatternName.EXISTENCE: ((P,), WITHIN_5, {"p": {6, 12}}),
    PatternName.BOUNDED_EXISTENCE: ((P,), Interval(), {"p": {1, 5, 8, 9, 12, 15, 17, 19}}),
    PatternName.RECURRENCE: ((P,), WITHIN_3, {"p": {1, 4, 6, 9, 12, 15}}),
    PatternName.PRECEDENCE: ((P, S), Interval(), {"p": {4, 12}, "s": {1, 6, 18}}),
    PatternName.RESPONSE: ((P, S), WITHIN_3, {"p": {5, 16}, "s": {7}}),
    PatternName.RESPONSE_CHAIN: ((P, S, T), WITHIN_3, {"p": {4, 15}, "s": {5, 17}, "t": {7}}),
    PatternName.PRECEDENCE_CHAIN: (
        (S, T, P),
        Interval(),
        {"s": {4, 17}, "t": {6, 15}, "p": {1, 9, 19}},
    ),
}
NOTES = {
    PatternName.ABSENCE: "`p` never holds. Time bounds count from the segment's begin.",
    PatternName.UNIVERSALITY: "`p` holds all the time. Time bounds count from the segment's begin.",
    PatternName.EXISTENCE: "`p` holds at least once, by then if a time is given. Here within 5 s of the segment's begin.",
    PatternName.BOUNDED_EXISTENCE: "`p` begins to hold at most so many times (here 2).",
    PatternName.RECURRENCE: "`p` holds at least once in every period of the given length (here 3 s).",
    PatternName.PRECEDENCE: "`s` holds only if `p` held before it, or with it, in the same segment.",
    PatternName.RESPONSE: "Every `p` is followed by `s`, or comes with it, in the same segment. Here within 3 s.",
    PatternName.RESPONSE_CHAIN: "Every `p` is followed by `s`, and that by a later `t`. Here each within 3 s.",
    PatternName.PRECEDENCE_CHAIN: "`p` holds only if `s` and then, later, `t` held before it in the same segment.",
}


def drawing(pattern: Pattern, marks: dict[str, set[int]]) -> list[str]:
    """The predicates' and the verdict's timelines."""
    letters = sorted(marks)
    monitor = PropertyMonitor(pattern_formula(pattern))
    verdicts = []
    for t in range(LENGTH):
        values = {letter: t in marks[letter] for letter in letters}
        verdicts.append(monitor.observe(seen(t * TICKS_PER_SECOND, **values)))
    lines = [
        f"{letter:<8}" + "".join("#" if t in marks[letter] else "." for t in range(LENGTH))
        for letter in letters
    ]
    shown = {Status.TRUE: "-", Status.FALSE: "X", Status.INCONCLUSIVE: "?"}
    lines.append(f"{'verdict':<8}" + "".join(shown[verdict.status] for verdict in verdicts))
    return lines


def described(pattern: Pattern) -> str:
    """Its meaning in one sentence, and its deadline if it has one."""
    limit = deadline(pattern)
    late = f" Deadline {limit // TICKS_PER_SECOND} s." if limit is not None else ""
    return pattern_sentence(pattern) + late


def page_of(name: PatternName) -> str:
    """The page of one pattern: every scope with its sentence, timeline and formula."""
    events, bound, marks = PATTERNS[name]
    lines = [f"# Pattern: {name}", "", NOTES[name], "", LEGEND]
    for scope, (where, delimiters) in SCOPES.items():
        pattern = Pattern(name, events, where, bound)
        lines += ["", f"## {name}, {scope}", "", described(pattern), "", "```"]
        lines += [f"{'':<8}" + "".join(str(t % 10) for t in range(LENGTH))]
        lines += drawing(pattern, marks | delimiters)
        lines += ["```", "", f"`{text(pattern_formula(pattern))}`"]
    return "\n".join(lines) + "\n"


def index() -> str:
    """The page of all patterns: each pattern in one line, each scope in one line."""
    lines = [
        "# Property patterns",
        "",
        "A pattern is a property with blanks: which event, in which scope, within which time.",
        "Each has a page with a timeline and the formula of every scope.",
        "The exact definitions are in [What properties mean](property-semantics.md#patterns).",
        "",
        "| pattern | meaning | for example |",
        "|---|---|---|",
    ]
    for name, (events, bound, _) in PATTERNS.items():
        sentence = described(Pattern(name, events, Scope(), bound))
        lines.append(f"| [`{name}`](patterns/{name}.md) | {NOTES[name]} | {sentence} |")
    lines += ["", "Any of them in any scope; `absence` for example:", ""]
    lines += ["| scope | written | meaning |", "|---|---|---|"]
    for scope, (where, _) in SCOPES.items():
        sentence = described(Pattern(PatternName.ABSENCE, (P,), where, Interval()))
        lines.append(f"| {scope} | {WRITTEN[scope]} | {sentence} |")
    lines += [
        "",
        "`python -m tests.properties.catalogue` writes these pages by running the monitors.",
    ]
    return "\n".join(lines) + "\n"


def pages() -> dict[str, str]:
    """Every page by its path below docs."""
    found = {f"patterns/{name}.md": page_of(name) for name in PATTERNS}
    return {"property-patterns.md": index(), **found}


if __name__ == "__main__":
    docs = Path(__file__).parents[2] / "docs"
    (docs / "patterns").mkdir(exist_ok=True)
    for path, content in pages().items():
        (docs / path).write_text(content, encoding="utf-8")
