"""The catalogue of patterns as timelines, drawn by running the monitors.

``python -m tests.properties.catalogue`` prints docs/property-patterns.md; a test holds the page to it.
"""

from __future__ import annotations

from moon.properties.formula import TICKS_PER_SECOND, Interval, text
from moon.properties.meaning import pattern_sentence
from moon.properties.monitor import PropertyMonitor
from moon.properties.patterns import (
    Pattern,
    PatternName,
    Scope,
    ScopeName,
    deadline,
    pattern_formula,
)
from moon.properties.syntax import parse_formula
from moon.properties.verdict import Status
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
    PatternName.EXISTENCE: "`p` holds at least once; with a time, by then. Here within 5 s of the segment's begin.",
    PatternName.BOUNDED_EXISTENCE: "`p` begins to hold at most so often (here twice).",
    PatternName.RECURRENCE: "`p` holds at least once in every stretch of so much time (here 3 s).",
    PatternName.PRECEDENCE: "`s` holds only if `p` held before it, or with it, in the same segment.",
    PatternName.RESPONSE: "every `p` is followed by `s`, or comes with it, in the same segment; here within 3 s.",
    PatternName.RESPONSE_CHAIN: "every `p` is followed by `s`, that by a later `t`; here each within 3 s.",
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


def page() -> str:
    lines = [
        "# Property patterns",
        "",
        "Every pattern in every scope, with a timeline: one column a second, `#` where a predicate holds,",
        "`-` where the property is true so far, `X` where it is false. The timelines are what the monitors",
        "say (`python -m tests.properties.catalogue` draws this page). How the scopes cut time, and every",
        "definition quantifier by quantifier: [properties.md](properties.md).",
    ]
    for name, (events, bound, marks) in PATTERNS.items():
        lines += ["", f"## {name}", "", NOTES[name]]
        for scope, (where, delimiters) in SCOPES.items():
            pattern = Pattern(name, events, where, bound)
            limit = deadline(pattern)
            late = f" Deadline {limit // TICKS_PER_SECOND} s." if limit is not None else ""
            lines += ["", f"### {name}, {scope}", "", pattern_sentence(pattern) + late, "", "```"]
            lines += [f"{'':<8}" + "".join(str(t % 10) for t in range(LENGTH))]
            lines += drawing(pattern, marks | delimiters)
            lines += ["```", "", f"`{text(pattern_formula(pattern))}`"]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(page(), end="")
