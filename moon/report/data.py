"""What the timeline is drawn from, as compact JSON that can stand inside a page."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
from markupsafe import Markup

from m2c.json_lines import as_line
from m2c.printable import printable
from moon.offline.result import CheckResult, Timeline
from moon.recording.entries import ReportedVerdict
from moon.report.observations import Channel, Shelf

VERDICTS = ("conforming", "violated", "inconclusive", "unseen")


class ChannelRow(msgspec.Struct, frozen=True):
    """A channel: ``t`` are microseconds, each from the one before; ``k`` a sign for each."""

    name: str
    type: str
    received: int
    t: list[int]
    k: str
    s: list[int]
    f: list[int]


class MachineRow(msgspec.Struct, frozen=True):
    """A machine's or property's bands: start and end (microseconds), text, index of the verdict."""

    name: str
    kind: str
    bands: list[tuple[int, int, str, int]]


class Mark(msgspec.Struct, frozen=True):
    """A violation: when (microseconds), since when it came about, on which row of ``machines``."""

    t: int
    since: int
    row: int


class TimelineData(msgspec.Struct, frozen=True):
    """Everything; times count from ``start_ms`` (since the epoch)."""

    start_ms: float
    end: int
    machines: list[MachineRow]
    channels: list[ChannelRow]
    violations: list[Mark]
    texts: list[str]
    sources: list[str]


def timeline_data(
    result: CheckResult, shelf: Shelf, violations: Sequence[ReportedVerdict]
) -> TimelineData:
    """The data of ``result`` and its observations.

    Args:
        result: of the check.
        shelf: the observations.
        violations: those that the page shows.
    """
    channels = shelf.channels()
    moments = [
        *(
            one.received_ns
            for channel in channels
            for one in (*channel.shown[:1], *channel.shown[-1:])
        ),
        *(band.start_ns for timeline in result.timelines for band in timeline.bands[:1]),
        *(band.end_ns for timeline in result.timelines for band in timeline.bands[-1:]),
        *(reported.received_ns for reported in violations),
    ]
    facts = result.recording
    moments += [moment for moment in (facts.first_ns, facts.last_ns) if moment]
    start, end = min(moments, default=0), max(moments, default=0)
    rows = {timeline.name: row for row, timeline in enumerate(result.timelines)}
    return TimelineData(
        start / 1e6,
        (end - start) // 1000,
        [_machine(timeline, start) for timeline in result.timelines],
        [_channel(channel, start) for channel in channels],
        [_mark(reported, start, rows.get(reported.verdict.node, -1)) for reported in violations],
        list(shelf.texts()),
        list(shelf.sources()),
    )


def as_json(data: TimelineData) -> Markup:
    """``data`` for a ``<script type="application/json">``, in which it stands as it is.

    Nothing in it can end the element or open a comment (HTML, section 13.1.2.3): what HTML gives a
    meaning is written as an escape, as is what cannot be printed.
    """
    text = as_line(data).decode()
    for character in "<>&":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return Markup(text)


def _mark(reported: ReportedVerdict, start: int, row: int) -> Mark:
    why = reported.verdict.explanation
    stamps = [item.stamp_ns for item in why.evidence] if why is not None else []
    since = min([reported.received_ns, *stamps])
    return Mark((reported.received_ns - start) // 1000, max(since - start, 0) // 1000, row)


def _machine(timeline: Timeline, start: int) -> MachineRow:
    bands = [
        (
            (band.start_ns - start) // 1000,
            (band.end_ns - start) // 1000,
            printable(" or ".join(band.states)),
            VERDICTS.index(band.verdict) if band.verdict in VERDICTS else len(VERDICTS) - 1,
        )
        for band in timeline.bands
    ]
    return MachineRow(printable(timeline.name), timeline.kind, bands)


def _channel(channel: Channel, start: int) -> ChannelRow:
    steps, last = [], 0
    for one in channel.shown:
        at = (one.received_ns - start) // 1000
        steps.append(at - last)
        last = at
    return ChannelRow(
        channel.name,
        channel.type_name,
        channel.received,
        steps,
        "".join(one.sign for one in channel.shown),
        [one.text for one in channel.shown],
        [one.source for one in channel.shown],
    )
