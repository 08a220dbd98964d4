"""The page of ``moon check --report``: verdicts, a timeline, each violation beside its model."""

from __future__ import annotations

import time
from base64 import b64encode
from collections.abc import Iterable, Sequence
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from typing import Any

import msgspec
from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup

from m2c.diagnostics import ModelError
from m2c.model.interfaces import InterfaceLibrary
from m2c.output_file import write_whole
from m2c.printable import printable
from moon.monitor.status import PROPERTY, MachineStatus
from moon.offline.result import CheckResult
from moon.properties.fields import fields_read
from moon.properties.files import load_properties
from moon.properties.property import Property
from moon.recording.entries import ReportedVerdict
from moon.recording.reader import RecordingError, open_recording
from moon.report.data import as_json, timeline_data
from moon.report.diagrams import POLICY, Figure, figures_of, read_system
from moon.report.observations import MAX_CHANNELS, Shelf
from moon.report.plot_drawing import drawn
from moon.report.plots import Plots
from moon.verdict import Explanation
from moon.wording import Wording
from transports.fields_read import FieldsRead

MAX_VIOLATIONS = 2_000
"""So many violations are shown, the first; nobody reads more, and each has its place in the page."""

_SIGNS = {"conforming": "✓", "violated": "✗", "inconclusive": "?", "unseen": "–"}


def write_report(result: CheckResult, path: Path) -> None:
    """Write what was found to the HTML file ``path``; it needs no other file and no network.

    The recording is read once more for its observations, and the models for their diagrams; what is
    not there any more is left out of the page, and reported on it.

    Args:
        result: of the check, with timelines.
        path: of the page.

    Raises:
        OSError: it cannot be written.
    """
    system = read_system(result.models, result.interfaces)
    violations = result.each_violation[:MAX_VIOLATIONS]
    library = system.library if system is not None else None
    wording = Wording(library)
    shelf = Shelf((reported.received_ns for reported in violations), wording)
    properties, missing = _read_properties(result, violations)
    plots = Plots(properties, violations)
    missing += _take_observations(result, library, shelf, plots, fields_read(properties))
    figures = figures_of(system, [reported.verdict.machine for reported in violations])
    if system is None and result.models:
        missing.append("the models are not where they were: there are no diagrams")
    write_whole(path, _page(result, violations, shelf, plots, figures, missing))


def _read_properties(
    result: CheckResult, violations: Sequence[ReportedVerdict]
) -> tuple[Sequence[Property], list[str]]:
    """The properties, if any is violated; the remark if they cannot be read any more."""
    if not any(reported.verdict.kind == PROPERTY for reported in violations):
        return (), []
    try:
        return load_properties(*map(Path, result.properties)), []
    except ModelError:
        return (), ["the property files are not what they were: their values are not plotted"]


def _take_observations(
    result: CheckResult,
    library: InterfaceLibrary | None,
    shelf: Shelf,
    plots: Plots,
    read: FieldsRead,
) -> list[str]:
    """Fill ``shelf`` and ``plots``; the remark if that cannot be done."""
    try:
        recording = open_recording(Path(result.recording.path), library)
    except RecordingError as error:
        return [f"{error}: the timeline shows no observations"]
    for entry in result.entries(recording, read):
        shelf.take(entry)
        plots.take(entry)
    return []


class _Row(msgspec.Struct, frozen=True):
    """A machine or property in the table of verdicts."""

    name: str
    is_property: bool
    kind: str
    sign: str
    verdict: str
    state: str
    numbers: tuple[str, ...]
    last: str


class _Violation(msgspec.Struct, frozen=True):
    """A violation.

    Attributes:
        name: of who violated what.
        at: when, from the start.
        brief: what the list shows of it.
        clock: when, as date and time of day.
        reason: the verdict's, where it says more than the explanation; else "".
        why: the explanation, as titles with what stands under them; None without one.
        figure: the id of its diagram; "" without one.
        keys: of the diagram's parts that it is about.
        plot: of a property's: the values that it is about; "" without any.
    """

    name: str
    at: str
    brief: str
    clock: str
    reason: str
    why: list[tuple[str, Sequence[str]]] | None
    figure: str
    keys: str
    plot: str


def _page(
    result: CheckResult,
    violations: Sequence[ReportedVerdict],
    shelf: Shelf,
    plots: Plots,
    figures: dict[str, Figure],
    missing: Sequence[str],
) -> str:
    facts = result.recording
    data = timeline_data(result, shelf, violations)
    used: dict[str, Figure] = {}
    shown = [_violation(reported, figures, used, plots, data.start_ms) for reported in violations]
    style, bare = _file("report.css"), Markup("[hidden]{display:block!important}")
    scripts = [_file("timeline.js"), _file("report.js")]
    return _template().render(
        security_policy=_security_policy(scripts, [style, bare]),
        style=style,
        style_without_scripts=bare,
        scripts=scripts,
        name=Path(facts.path).resolve().name,
        conclusion=_conclusion(result),
        kind="bad" if result.violations else "good",
        sign=_SIGNS["violated" if result.violations else "conforming"],
        about=_about(result),
        path=facts.path,
        against=[*result.models, *result.properties],
        remarks=_remarks(result, shelf, missing),
        rows=[_row(status) for status in result.machines],
        anything_received=shelf.shown > 0,
        violations=shown,
        figures=[{"id": f"{figure.prefix}figure", "svg": figure.svg} for figure in used.values()],
        data=as_json(data),
    )


def _template() -> Template:
    """The page's template. A text that it is given is made printable and escaped, wherever it stands.

    Only :class:`markupsafe.Markup` is left as it is: our own files and policy, the timeline's
    JSON, the diagrams.
    """
    environment = Environment(
        loader=PackageLoader("moon.report"),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_printable_text,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template("report.html.j2")


def _printable_text(value: Any) -> Any:
    return printable(value) if isinstance(value, str) and not isinstance(value, Markup) else value


def _security_policy(scripts: Iterable[str], styles: Iterable[str]) -> Markup:
    """What the browser holds the page to (W3C Content Security Policy Level 3).

    Nothing is loaded from anywhere, and of what stands in the page only our own runs, named by its digest.
    """
    return Markup(
        "default-src 'none'; base-uri 'none'; form-action 'none'; "
        f"script-src {' '.join(map(_digest, scripts))}; style-src {' '.join(map(_digest, styles))}"
    )


def _digest(text: str) -> str:
    return f"'sha256-{b64encode(sha256(text.encode()).digest()).decode()}'"


def _conclusion(result: CheckResult) -> str:
    count = result.violations
    if count:
        return f"{count:,} violation{'' if count == 1 else 's'}"
    return "nothing is violated"


def _about(result: CheckResult) -> list[str]:
    facts = result.recording
    about = (
        f"{facts.observations:,} observations",
        f"{facts.seconds:,.1f} s",
        f"from {_clock(facts.first_ns)}" if facts.first_ns else "",
        facts.form,
        f"checked in {result.seconds:.1f} s" if result.seconds else "",
    )
    return [item for item in about if item]


def _remarks(result: CheckResult, shelf: Shelf, missing: Sequence[str]) -> list[str]:
    """What could not be read, received or judged, and what the page leaves out."""
    facts = result.recording
    time = [f"time: {facts.time}"] if facts.time else []
    notes = [*time, *facts.faults, *result.unmonitored, *result.problems, *facts.limits, *missing]
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
    if shelf.shown < shelf.received - shelf.of_other_channels:
        notes.append(
            f"the timeline shows {shelf.shown:,} of {shelf.received:,} observations: those of the two "
            "seconds before each violation, and a part of the others"
        )
    count = result.violations
    if count > MAX_VIOLATIONS:
        notes.append(f"of {count:,} violations the first {MAX_VIOLATIONS:,} are shown")
    return list(dict.fromkeys(notes))


def _row(status: MachineStatus) -> _Row:
    word = status.verdict.split(" ", maxsplit=1)[0]
    kind = word if word in _SIGNS else "unseen"
    numbers = (status.inputs, status.outputs, status.violations)
    return _Row(
        status.machine,
        status.kind == PROPERTY,
        kind,
        _SIGNS[kind],
        status.verdict,
        " or ".join(status.states),
        tuple(f"{number:,}" for number in numbers),
        "" if word == "conforming" else status.last,
    )


def _violation(
    reported: ReportedVerdict,
    figures: dict[str, Figure],
    used: dict[str, Figure],
    plots: Plots,
    start_ms: float,
) -> _Violation:
    """What the page shows of a violation; its diagram is added to ``used``."""
    verdict, why = reported.verdict, reported.verdict.explanation
    figure, keys = _figure(reported, figures)
    if figure is not None:
        used[figure.name] = figure
    is_property = verdict.kind == PROPERTY
    plot = plots.of(reported)
    return _Violation(
        verdict.node,
        f"+{max(reported.received_ns / 1e6 - start_ms, 0) / 1e3:,.3f} s",
        why.observed if why is not None and not is_property else verdict.reason,
        _clock(verdict.stamp_ns),
        verdict.reason if why is None or is_property else "",
        _why(why, "written" if is_property else "model") if why is not None else None,
        f"{figure.prefix}figure" if figure is not None else "",
        " ".join(figure.prefix + key for key in keys) if figure is not None else "",
        drawn(plot, round(start_ms * 1e6)) if plot is not None else "",
    )


def _figure(
    reported: ReportedVerdict, figures: dict[str, Figure]
) -> tuple[Figure | None, list[str]]:
    """The diagram that belongs to a violation, and the keys of what it is about."""
    verdict = reported.verdict
    places = verdict.explanation.places if verdict.explanation is not None else ()
    figure = figures.get(verdict.machine)
    if figure is None and verdict.kind != PROPERTY:  # what is no machine is the policy
        figure = figures.get(POLICY)
    return figure, figure.marked(places) if figure is not None else []


def _why(why: Explanation, where: str) -> list[tuple[str, Sequence[str]]]:
    """The explanation; ``where`` is the title of the places in models."""
    evidence = [f"{_clock(item.stamp_ns, with_date=False)}  {item.text}" for item in why.evidence]
    pairs: Iterable[tuple[str, Sequence[str]]] = (
        ("expected", why.expected),
        ("observed", [why.observed] if why.observed else []),
        ("in state", why.states),
        ("after", evidence),
        (where, why.places),
    )
    return [(title, texts) for title, texts in pairs if texts]


def _clock(stamp_ns: int, with_date: bool = True) -> str:
    """A stamp as date and time of day in UTC: a report is read elsewhere, too."""
    form = "%Y-%m-%d %H:%M:%S" if with_date else "%H:%M:%S"
    moment = time.strftime(form, time.gmtime(stamp_ns // 10**9))
    return f"{moment}.{stamp_ns % 10**9 // 1000:06d}{' UTC' if with_date else ''}"


def _file(name: str) -> Markup:
    """A file of ours, which stands in the page as it is."""
    return Markup((files("moon.report") / name).read_text(encoding="utf-8"))
