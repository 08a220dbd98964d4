"""Checking one recording: what was recorded is played to the monitor that would have been there."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from moon.monitor.status import PROPERTY
from moon.monitor.subject import Monitored, Subject
from moon.monitor.watch import SystemWatch
from moon.offline.playing import Player
from moon.offline.result import MAX_REPEATS, CheckResult, RecordingFacts
from moon.offline.timelines import Timelines
from moon.ordering.on_time import received_on_time
from moon.recording.attribution import Attribution
from moon.recording.entries import Entry, ReportedVerdict
from moon.recording.reader import OWN, ROSBAG, Recording, open_recording
from moon.verdict import Outcome, Verdict
from transports.interface import Observation

PROGRESS_EVERY = 2_000
"""Entries between two reports of progress."""
_START_MARGIN = 1
"""Latency bounds by which a monitor would have been there before the first entry of a bag."""

Progress = Callable[[int], None]
"""Takes how many entries were read since it was last called."""


class EmptyRecordingError(ValueError):
    """There is nothing in a recording that could be checked; the text says why."""


class _Collector:
    """Takes verdicts, with the time of the recording."""

    def __init__(self, player: Player) -> None:
        self.reported: list[ReportedVerdict] = []
        self.counted: list[ReportedVerdict] = []
        self._repeats = 0
        self._player = player

    def take(self, verdict: Verdict) -> None:
        entry = ReportedVerdict(self._player.now_ns(), verdict)
        self.reported.append(entry)
        if verdict.outcome is Outcome.VIOLATED:
            self.counted.append(entry)

    def repeat(self, verdict: Verdict) -> None:
        self._repeats += 1
        if self._repeats <= MAX_REPEATS:
            self.counted.append(ReportedVerdict(self._player.now_ns(), verdict))

    def withdraw(self, name: str, since_ns: int) -> None:
        for place in range(len(self.counted) - 1, -1, -1):
            verdict = self.counted[place].verdict
            if (verdict.kind, verdict.node) == (PROPERTY, name) and verdict.stamp_ns == since_ns:
                del self.counted[place]
                return


def check_recording(
    path: Path,
    subject: Subject,
    monitored: Monitored,
    with_timelines: bool = False,
    progress: Progress | None = None,
) -> CheckResult:
    """What a monitor of ``monitored`` would have reported of the run in ``path``.

    Args:
        path: the recording.
        subject: the names of what is monitored, for the result.
        monitored: what is monitored.
        with_timelines: whether the result is to have them; that takes some more time.
        progress: called now and then.

    Raises:
        RecordingError: there is no recording at ``path``, or nothing of it can be read.
        EmptyRecordingError: nothing is in it.
    """
    began = time.monotonic()
    recording = open_recording(path, monitored.system.library)
    attribution = _attribution(path, recording.form, monitored)
    player = Player(_START_MARGIN * monitored.bounds.latency)
    collector = _Collector(player)
    notes: list[str] = []
    properties = monitored.property_watch()
    watch = SystemWatch(
        player,
        monitored.system,
        monitored.machines if attribution is None else attribution.machines,
        monitored.bounds,
        [collector],
        notes.append,
        properties,
        policy=monitored.policy and attribution is None,
        monotonic_ns=player.monotonic_ns,
        repeated=collector.repeat,
    )
    properties.withdrawn = collector.withdraw
    timelines = Timelines(watch, player) if with_timelines else None
    first, last, recorded = _play(recording, watch, player, timelines, progress, attribution)
    faults = tuple(recording.faults())
    if first is None or last is None:
        why = "; ".join(faults) or "it holds nothing"
        raise EmptyRecordingError(f"{path}: {why}")
    summary = watch.summary()
    facts = RecordingFacts(
        path=str(path),
        form=recording.form,
        observations=recording.contents.count,
        first_ns=first.received_ns,
        last_ns=last.received_ns,
        complete=not faults and (recording.ended or recording.form != OWN),
        faults=faults,
        limits=(*recording.limits(), *player.limits(), *_assumed(attribution)),
    )
    return CheckResult(
        recording=facts,
        models=tuple(map(str, subject.models)),
        system=monitored.system.name,
        properties=tuple(map(str, subject.properties)),
        interfaces=tuple(map(str, subject.interfaces)),
        verdicts=tuple(collector.reported),
        machines=summary.machines,
        timelines=timelines.finished(last.received_ns) if timelines is not None else (),
        counts=summary.counts,
        problems=summary.problems,
        recorded=recorded,
        seconds=time.monotonic() - began,
        counted=tuple(collector.counted),
        unmonitored=monitored.unmonitored,
    )


def _attribution(path: Path, form: str, monitored: Monitored) -> Attribution | None:
    """Who did what in a recording that names nobody; None for our own, which does.

    The recording is read once for it: whether a machine can be judged depends on all of it.
    """
    if form == OWN or not monitored.machines:
        return None
    recording = open_recording(path, monitored.system.library)
    for _ in recording.entries():
        pass  # its contents take note
    machines = monitored.machines if form == ROSBAG else ()
    return recording.attribution(monitored.system.nodes, machines)


def _assumed(attribution: Attribution | None) -> list[str]:
    """What is assumed by it, and whom it leaves out, one sentence each."""
    if attribution is None:
        return []
    return [*filter(None, [attribution.assumption()]), *attribution.unjudged]


def _play(
    recording: Recording,
    watch: SystemWatch,
    player: Player,
    timelines: Timelines | None,
    progress: Progress | None,
    attribution: Attribution | None,
) -> tuple[Entry | None, Entry | None, bool]:
    """Play all of it: the first entry, the last, and whether it has verdicts of its own."""
    first: Entry | None = None
    entry: Entry | None = None
    recorded = False
    count = 0
    play = player.play
    for entry in received_on_time(recording.entries()):
        if first is None:
            first = entry
            player.start(entry, watch.start)
        if attribution is not None and isinstance(entry, Observation):
            entry = attribution(entry)  # noqa: PLW2901 - the same, with names
        play(entry)
        if timelines is not None:
            timelines.look(entry)
        if type(entry) is ReportedVerdict:
            recorded = True
        if progress is not None:
            count += 1
            if count == PROGRESS_EVERY:
                progress(count)
                count = 0
    player.finish()
    if progress is not None:
        progress(count)
    return first, entry, recorded
