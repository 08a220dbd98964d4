"""The page of ``moon check --report``: verdicts, a timeline, each violation beside its model."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path

from m2c.model.interfaces import InterfaceLibrary
from m2c.printable import printable
from moon.monitor.status import PROPERTY, MachineStatus
from moon.offline.result import CheckResult
from moon.recording.entries import Said
from moon.recording.reader import RecordingError, open_recording
from moon.report.data import as_json, timeline_data
from moon.report.diagrams import POLICY, Figure, figures_of, read_system
from moon.report.observations import MAX_CHANNELS, Shelf
from moon.verdict import Verdict
from transports.interface import Observation

MAX_VIOLATIONS = 2_000
"""So many violations are told, the first; nobody reads more, and each has its place in the page."""

_SIGNS = {"conforming": "✓", "violated": "✗", "inconclusive": "?", "unseen": "–"}
_POLICY_RULES = (
    "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:"
)
"""The browser holds the page to it: nothing is loaded, from anywhere."""


def write_report(result: CheckResult, path: Path) -> None:
    """Write what was found to the HTML file ``path``; it needs no other file and no network.

    The recording is read once more for its observations, and the models for their diagrams; what is
    not there any more is left out of the page, and said.

    Args:
        result: of the check, with timelines.
        path: of the page.

    Raises:
        OSError: it cannot be written.
    """
    system = read_system(result.models, result.interfaces)
    violations = result.violated[:MAX_VIOLATIONS]
    shelf = Shelf(said.received_ns for said in violations)
    missing = _take_observations(result, system.library if system is not None else None, shelf)
    figures = figures_of(system, [said.verdict.machine for said in violations])
    if system is None and result.models:
        missing.append("the models are not where they were: there are no diagrams")
    path.write_text(_page(result, violations, shelf, figures, missing), encoding="utf-8")


def _take_observations(
    result: CheckResult, library: InterfaceLibrary | None, shelf: Shelf
) -> list[str]:
    """Fill ``shelf``; what is said if that cannot be done."""
    try:
        recording = open_recording(Path(result.recording.path), library)
    except RecordingError as error:
        return [f"{error}: the timeline shows no observations"]
    for entry in recording.entries():
        if isinstance(entry, Observation):
            shelf.take(entry)
    return []


def _page(
    result: CheckResult,
    violations: Sequence[Said],
    shelf: Shelf,
    figures: dict[str, Figure],
    missing: Sequence[str],
) -> str:
    name = Path(result.recording.path).resolve().name
    data = timeline_data(result, shelf, violations)
    parts = [
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY_RULES}">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{_text(name)}: {_text(_conclusion(result))}</title>",
        f"<style>\n{_file('report.css')}</style>",
        "<noscript><style>[hidden]{display:block!important}</style></noscript>\n</head>\n<body>",
        *_head(result, name),
        *_remarks(result, shelf, missing),
        *_table(result.machines),
        *_timeline(shelf),
        *_violations(result, violations, figures, data.start_ms),
        f'<script type="application/json" id="data">{as_json(data)}</script>',
        f"<script>\n{_file('timeline.js')}</script>",
        f"<script>\n{_file('report.js')}</script>",
        "</body>\n</html>\n",
    ]
    return "\n".join(parts)


def _conclusion(result: CheckResult) -> str:
    count = result.violations
    if count:
        return f"{count:,} violation{'' if count == 1 else 's'}"
    return "nothing is violated"


def _head(result: CheckResult, name: str) -> list[str]:
    facts = result.recording
    kind = "bad" if result.violations else "good"
    sign = _SIGNS["violated" if result.violations else "conforming"]
    about = [
        f"{facts.observations:,} observations",
        f"{facts.seconds:,.1f} s",
        f"from {_clock(facts.first_ns)}" if facts.first_ns else "",
        facts.form,
        f"checked in {result.seconds:.1f} s" if result.seconds else "",
    ]
    against = ", ".join([*result.models, *result.properties])
    return [
        "<header>",
        f'<p class="conclusion {kind}"><span aria-hidden="true">{sign}</span> {_conclusion(result)}</p>',
        f"<h1>{_text(name)}</h1>",
        f"<p>{_text(' · '.join(item for item in about if item))}</p>",
        f'<p class="quiet">{_text(facts.path)}{" against " if against else ""}{_text(against)}</p>',
        "</header>",
    ]


def _remarks(result: CheckResult, shelf: Shelf, missing: Sequence[str]) -> list[str]:
    """What could not be read, heard or judged, and what the page leaves out."""
    facts = result.recording
    notes = [*facts.faults, *result.problems, *facts.limits, *missing]
    if not facts.complete and not facts.faults:
        notes.insert(0, "the recording is not complete")
    if shelf.of_other_channels:
        notes.append(
            f"the timeline has the first {MAX_CHANNELS} channels; {shelf.of_other_channels:,} "
            "observations were on others"
        )
    merged = sum(timeline.merged for timeline in result.timelines)
    if merged:
        notes.append(
            f"{merged:,} changes of state followed others so closely that they are one band"
        )
    if shelf.shown < shelf.heard - shelf.of_other_channels:
        notes.append(
            f"the timeline shows {shelf.shown:,} of {shelf.heard:,} observations: those of the two "
            "seconds before each violation, and a part of the others"
        )
    told = len(result.violated)
    if told > MAX_VIOLATIONS:
        notes.append(f"of {told:,} violations the first {MAX_VIOLATIONS:,} are told")
    if not notes:
        return []
    items = "".join(f"<li>{_text(note)}</li>" for note in dict.fromkeys(notes))
    return [f'<section class="remarks"><h2>To be borne in mind</h2><ul>{items}</ul></section>']


def _table(machines: Sequence[MachineStatus]) -> list[str]:
    if not machines:
        return []
    head = "".join(
        f"<th{kind}>{title}</th>"
        for title, kind in (
            *(("machine or property", ""), ("verdict", ""), ("state", "")),
            *((title, ' class="number"') for title in ("in", "out", "violations")),
            ("last explanation", ""),
        )
    )
    rows = [_row(status) for status in machines]
    return [
        '<section><h2>Verdicts</h2><div class="wide">',
        f"<table><thead><tr>{head}</tr></thead><tbody>",
        *rows,
        "</tbody></table></div></section>",
    ]


def _row(status: MachineStatus) -> str:
    word = status.verdict.split(" ", maxsplit=1)[0]
    kind = word if word in _SIGNS else "unseen"
    state = " or ".join(status.states)
    last = "" if word == "conforming" else status.last
    about = ' <span class="quiet">property</span>' if status.kind == PROPERTY else ""
    numbers = (status.inputs, status.outputs, status.violations)
    return (
        f'<tr class="{kind}"><th scope="row">{_text(status.machine)}{about}</th>'
        f'<td><span class="sign" aria-hidden="true">{_SIGNS[kind]}</span> {_text(status.verdict)}</td>'
        f"<td>{_text(state)}</td>"
        f"{''.join(f'<td class=number>{value:,}</td>' for value in numbers)}"
        f'<td class="last">{_text(last)}</td></tr>'
    )


def _timeline(shelf: Shelf) -> list[str]:
    empty = "" if shelf.shown else '<p class="quiet">Nothing was heard.</p>'
    help_text = (
        "Wheel or <kbd>+</kbd> <kbd>−</kbd>: zoom · drag or <kbd>←</kbd> <kbd>→</kbd>: move · "
        "<kbd>0</kbd>: everything · <kbd>n</kbd> <kbd>p</kbd>: next and previous violation"
    )
    buttons = "".join(
        f'<button type="button" data-do="{do}" title="{title}">{sign}</button>'
        for do, title, sign in (
            ("in", "zoom in", "+"),
            ("out", "zoom out", "−"),
            ("all", "show everything", "⤢"),
            ("previous", "previous violation", "‹ ✗"),
            ("next", "next violation", "✗ ›"),
        )
    )
    legend = (
        '<span><i class="key m"></i>message</span><span><i class="key q"></i>request</span>'
        '<span><i class="key r"></i>response</span><span><i class="key x"></i>failed call</span>'
        '<span><i class="key v"></i>violation</span><span><i class="key u"></i>inconclusive</span>'
    )
    return [
        f'<section id="timeline"><h2>Timeline</h2>{empty}',
        f'<div class="tools">{buttons}<output id="range"></output></div>',
        '<div id="scroller"><canvas id="canvas" tabindex="0" role="application" '
        'aria-label="Timeline of machines and channels"></canvas></div>',
        f'<p class="legend">{legend}</p><p class="quiet help">{help_text}</p>',
        '<div id="tip" role="status" hidden></div></section>',
    ]


def _violations(
    result: CheckResult, violations: Sequence[Said], figures: dict[str, Figure], start_ms: float
) -> list[str]:
    if not violations:
        return []
    used: dict[str, Figure] = {}
    items: list[str] = []
    articles: list[str] = []
    for number, said in enumerate(violations):
        verdict = said.verdict
        figure, keys = _figure(said, figures)
        if figure is not None:
            used[figure.name] = figure
        at = f"+{max(said.received_ns / 1e6 - start_ms, 0) / 1e3:,.3f} s"
        name = verdict.node
        why = verdict.explanation
        brief = why.observed if why is not None and verdict.kind != PROPERTY else verdict.reason
        items.append(
            f'<li><button type="button" class="violation" data-violation="{number}" '
            f'aria-pressed="false"><b>{_text(name)}</b> <time>{at}</time> '
            f"<span>{_text(brief)}</span></button></li>"
        )
        shown = (
            f' data-figure="{figure.prefix}figure" data-keys="'
            f'{" ".join(figure.prefix + key for key in keys)}"'
            if figure is not None
            else ""
        )
        articles.append(
            f'<article id="violation-{number}"{shown} hidden>'
            f"<h3>{_text(name)} <time>{_clock(verdict.stamp_ns)}</time></h3>"
            f"{_why(verdict)}</article>"
        )
    drawings = [
        f'<figure id="{figure.prefix}figure" hidden><div class="wide">{figure.svg}</div></figure>'
        for figure in used.values()
    ]
    return [
        '<section id="violations"><h2>Violations</h2><div class="beside"><div class="told">',
        f'<ol class="list">{"".join(items)}</ol>',
        *articles,
        '</div><div class="drawn"><p class="quiet" id="no-figure">A violation that is clicked is '
        "explained here, beside the diagram of its model.</p>",
        *drawings,
        "</div></div></section>",
    ]


def _figure(said: Said, figures: dict[str, Figure]) -> tuple[Figure | None, list[str]]:
    """The diagram that belongs to a violation, and the keys of what it is about."""
    verdict = said.verdict
    places = verdict.explanation.places if verdict.explanation is not None else ()
    figure = figures.get(verdict.machine)
    if figure is None and verdict.kind != PROPERTY:  # what is no machine is the policy
        figure = figures.get(POLICY)
    return figure, figure.marked(places) if figure is not None else []


def _why(verdict: Verdict) -> str:
    """The explanation; the reason is told where it says more than that."""
    why = verdict.explanation
    if why is None:
        return f"<p>{_text(verdict.reason)}</p>"
    told = f"<p>{_text(verdict.reason)}</p>" if verdict.kind == PROPERTY else ""
    evidence = [f"{_clock(item.stamp_ns, with_date=False)}  {item.text}" for item in why.evidence]
    pairs: Iterable[tuple[str, Sequence[str]]] = (
        ("expected", why.expected),
        ("observed", [why.observed] if why.observed else []),
        ("in state", why.states),
        ("after", evidence),
        ("written" if verdict.kind == PROPERTY else "model", why.places),
    )
    return (
        f"{told}<dl>"
        + "".join(
            f"<dt>{title}</dt>" + "".join(f"<dd>{_text(text)}</dd>" for text in texts)
            for title, texts in pairs
            if texts
        )
        + "</dl>"
    )


def _clock(stamp_ns: int, with_date: bool = True) -> str:
    """A stamp as date and time of day in UTC: a report is read elsewhere, too."""
    form = "%Y-%m-%d %H:%M:%S" if with_date else "%H:%M:%S"
    moment = time.strftime(form, time.gmtime(stamp_ns // 10**9))
    return f"{moment}.{stamp_ns % 10**9 // 1000:06d}{' UTC' if with_date else ''}"


def _text(words: str) -> str:
    return escape(printable(words))


def _file(name: str) -> str:
    return (files("moon.report") / name).read_text(encoding="utf-8")
