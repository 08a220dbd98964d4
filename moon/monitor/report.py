"""Verdicts and summaries in words."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterable, Sequence

from m2c.printable import near, printable
from m2c.suggestions import first_of
from moon.monitor.status import PROPERTY, UNSEEN, MachineStatus, Summary
from moon.verdict import Explanation, Outcome, Verdict

HEADER = ("machine", "verdict", "state", "in", "out", "lag [ms]")
NUMBERS = ("in", "out", "lag [ms]")
"""The columns whose cells are aligned to the right."""
MAX_STATES = 3
"""So many states are named; more say no more than their number."""
_SHOWN_TOGETHER = 5
"""So many channels that no model names, and machines with the same reason, are named."""
UNTIL_IT_ENDED = "conforming until it ended"
_UNTIL_THEY_ENDED = "conforming until they ended"
"""Of machines whose nodes went away: an end is no fault, and makes nothing inconclusive."""
_NOT_CONFORMING = (str(Outcome.VIOLATED), str(Outcome.INCONCLUSIVE))
_COLOURS = {
    str(Outcome.VIOLATED): "31",
    str(Outcome.INCONCLUSIVE): "33",
    str(Outcome.CONFORMING): "32",
}


def shade(verdict: str) -> str:
    """The colour of a verdict, as an ANSI code; "" for none."""
    return _COLOURS.get(verdict, "")


def clock(stamp_ns: int) -> str:
    """A stamp as local time of day, to the microsecond."""
    day = time.strftime("%H:%M:%S", time.localtime(stamp_ns // 10**9))
    return f"{day}.{stamp_ns % 10**9 // 1000:06d}"


def verdict_lines(verdict: Verdict, colour: bool = False) -> list[str]:
    """A verdict, and below it why."""
    word = str(verdict.outcome)
    shown = word.upper() if verdict.outcome is Outcome.VIOLATED else word
    if colour and (code := shade(word)):
        shown = f"\x1b[{code}m{shown}\x1b[0m"
    is_property = verdict.kind == PROPERTY
    name = (
        verdict.machine
        if verdict.node == verdict.machine
        else f"{verdict.node} ({verdict.machine})"
    )
    why = verdict.explanation
    head = f"{clock(verdict.stamp_ns)}  {printable(name)}  {shown}"
    if verdict.robot:
        head = f"{clock(verdict.stamp_ns)}  {printable(verdict.robot)}  {printable(name)}  {shown}"
    if why is None:
        return [f"{head}  {printable(verdict.reason)}".rstrip()]
    if is_property:
        head = f"{head}  {printable(verdict.reason)}"
    return [
        f"{head}{'  unresponsive' if verdict.is_silence else ''}",
        *_why(why, "written" if is_property else "model"),
    ]


def _why(why: Explanation, where: str) -> list[str]:
    lines = _listed("expected", why.expected) + _listed("observed", [why.observed])
    lines += _listed("in state", why.states)
    evidence = [f"{clock(item.stamp_ns)}  {item.text}" for item in why.evidence]
    lines += _listed("after", evidence)
    return lines + _listed(where, [near(place) for place in why.places])


def _listed(title: str, texts: Sequence[str]) -> list[str]:
    return [
        f"    {title if place == 0 else '':<9} {printable(text)}"
        for place, text in enumerate(texts)
    ]


def cells(status: MachineStatus) -> tuple[str, ...]:
    """A row of the table, as :data:`HEADER` has it."""
    states = status.states
    state = " or ".join(states) if len(states) <= MAX_STATES else f"one of {len(states)}"
    verdict = status.verdict
    if status.violations > 1:
        verdict += f" ×{status.violations}"
    lag = "" if status.lag_ms is None else f"{status.lag_ms:.1f}"
    state = state or ("" if status.verdict == UNSEEN else "?")
    numbers = (str(status.inputs), str(status.outputs), lag)
    return tuple(map(printable, (status.machine, verdict, state, *numbers)))


def last_explanations(statuses: Sequence[MachineStatus]) -> list[str]:
    """The lines below the table that say why machines do not conform: one for each reason."""
    of: dict[str, list[str]] = {}
    for status in statuses:
        if status.last and status.verdict != str(Outcome.CONFORMING):
            of.setdefault(status.last, []).append(status.machine)
    return [
        f"{printable(first_of(machines, _SHOWN_TOGETHER))}: {printable(why)}"
        for why, machines in of.items()
    ]


def table(statuses: Sequence[MachineStatus]) -> list[str]:
    """The table as lines of text, and below it the last explanations."""
    return aligned(HEADER, map(cells, statuses), NUMBERS) + last_explanations(statuses)


def aligned(
    header: tuple[str, ...], rows: Iterable[tuple[str, ...]], numbers: Collection[str]
) -> list[str]:
    """A table as lines of text; the columns that ``numbers`` names are aligned to the right."""
    lines = [header, *rows]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return [
        "  ".join(
            text.rjust(width) if heading in numbers else text.ljust(width)
            for heading, text, width in zip(header, line, widths, strict=True)
        ).rstrip()
        for line in lines
    ]


def closing(summary: Summary) -> list[str]:
    """The last lines: how it stands, and what could not be judged."""
    counts = summary.counts
    tallies = [
        _tally(noun, [_standing(status) for status in summary.machines if status.kind == kind])
        for kind, noun in (
            ("model", ("machine", "machines")),
            (PROPERTY, ("property", "properties")),
        )
    ]
    has_models = any(status.kind != PROPERTY for status in summary.machines)
    of_none = f", {counts.unconcerned:,} of no monitored machine" if has_models else ""
    lines = [
        f"{_many(summary.violations, 'violation')} in {summary.seconds:.1f} s; "
        f"{''.join(tallies)}received {counts.received:,} observations"
        f"{of_none}"
    ]
    if counts.unknown and has_models:
        named = [name for name, _ in counts.unknown.most_common()]
        lines.append(f"channels that no model names: {printable(first_of(named, _SHOWN_TOGETHER))}")
    lines += map(printable, summary.unmonitored)
    if counts.stalls:
        lines.append(f"resynchronised all machines {_many(counts.stalls, 'time')}")
    return lines


def _tally(nouns: tuple[str, str], verdicts: Sequence[str]) -> str:
    """How many there are of each verdict; nothing if there is none of the kind."""
    if not verdicts:
        return ""
    words = (str(Outcome.CONFORMING), UNTIL_IT_ENDED, *_NOT_CONFORMING, UNSEEN)
    parts = [_counted(verdicts.count(word), word) for word in words if word in verdicts]
    return f"{len(verdicts):,} {nouns[len(verdicts) != 1]}: {', '.join(parts)}; "


def _standing(status: MachineStatus) -> str:
    """Its verdict, as the last lines have it."""
    conforming = status.verdict == str(Outcome.CONFORMING)
    return UNTIL_IT_ENDED if conforming and status.has_ended else status.verdict


def _counted(number: int, verdict: str) -> str:
    several = number > 1 and verdict == UNTIL_IT_ENDED
    return f"{number} {_UNTIL_THEY_ENDED if several else verdict}"


def _many(number: int, noun: str) -> str:
    return f"{number:,} {noun}{'' if number == 1 else 's'}"
