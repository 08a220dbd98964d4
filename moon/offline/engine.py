"""Checking one recording: what was recorded is played to the monitor that would have been there."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import msgspec

from moon.judge import Gap, Missing
from moon.monitor.properties import PropertyWatch
from moon.monitor.status import PROPERTY
from moon.monitor.subject import Monitored, Subject
from moon.offline.result import MAX_REPEATS, CheckResult, RecordingFacts
from moon.offline.survey import TWO_RUNS, NotJudgedError, Surveyed, assumed, silent, survey
from moon.offline.timelines import Timelines
from moon.offline.view import Part, View
from moon.recording.entries import END_OF_TIME_NS, Began, Ending, Entry, ReportedVerdict
from moon.recording.reader import OWN, Recording, open_recording
from moon.run import Run
from moon.sources.on_time import received_on_time
from moon.sources.played import Player
from moon.sources.source import Outputs
from moon.sources.time_base import TimeBase, in_time
from moon.sources.time_choice import LOG, PUBLISH
from moon.verdict import Outcome, Verdict
from transports.interface import Observation
from transports.service_events import EVENT_SUFFIX

PROGRESS_EVERY = 2_000
"""Entries between two reports of progress."""

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
    view: View | None = None,
) -> CheckResult:
    """What a monitor of ``monitored`` would have reported of the run in ``path``.

    Args:
        path: the recording.
        subject: the names of what is monitored, for the result.
        monitored: what is monitored.
        with_timelines: whether the result is to have them; that takes some more time.
        progress: called now and then.
        view: which part of it, and by which time; by default all, by the one that evidence speaks for.

    Raises:
        RecordingError: there is no recording at ``path``, or nothing of it can be read or judged.
        EmptyRecordingError: nothing is in it.
    """
    began = time.monotonic()
    view = view or View()
    properties = monitored.property_watch()
    surveyed = survey(path, monitored, properties, _channels(monitored), view)
    check = functools.partial(
        _check, _Task(path, subject, monitored, view, surveyed), with_timelines, progress
    )
    result = check(properties)
    if doubted := _doubted(result):
        properties = monitored.property_watch()
        properties.doubt_times(doubted, _open_ns(surveyed.base), surveyed.shared)
        result = check(properties)
    return msgspec.structs.replace(result, seconds=time.monotonic() - began)


def _doubted(result: CheckResult) -> frozenset[str]:
    """The properties that are violated, but perhaps only as it was recorded."""
    if not _open_ns(result.base):
        return frozenset()
    found = (item.verdict for item in result.counted or ())
    return frozenset(verdict.node for verdict in found if verdict.kind == PROPERTY)


def _open_ns(base: TimeBase | None) -> int:
    """By how much what happened is not known by ``base``; a recording of moon has one clock, or bounds."""
    return 0 if base is None else base.open_ns


class _Task(msgspec.Struct, frozen=True):
    """What is checked (see :func:`check_recording`), and what was found of it."""

    path: Path
    subject: Subject
    monitored: Monitored
    view: View
    surveyed: Surveyed


def _check(
    task: _Task, with_timelines: bool, progress: Progress | None, properties: PropertyWatch
) -> CheckResult:
    """:func:`check_recording`, with these ``properties``; how long it took is left open."""
    path, subject, monitored = task.path, task.subject, task.monitored
    view, surveyed = task.view, task.surveyed
    recording = open_recording(path, monitored.system.library)
    base, attribution = surveyed.base, surveyed.attribution
    player = Player()
    if surveyed.other_time:
        player.take_another_time(surveyed.other_time)
    collector = _Collector(player)
    notes: list[str] = []
    unrecorded = surveyed.unrecorded(properties)
    left_out = surveyed.left_out(monitored.machines)
    properties.miss(unrecorded)
    watch = Run(
        player,
        _judged(monitored, surveyed, left_out),
        Outputs([collector], notes.append, repeated=collector.repeat),
        properties,
        in_order=base is not None,
    )
    properties.withdrawn = collector.withdraw
    timelines = Timelines(watch, player) if with_timelines else None
    entries = recording.entries(fields_read=monitored.fields_read)
    played = _Played(recording, entries, watch, player, surveyed, view, properties)
    played.play(monitored.bounds.latency, timelines, progress)
    faults = tuple(recording.faults())
    if played.first is None or played.last is None:
        why = "; ".join(faults) or played.part.why_empty
        raise EmptyRecordingError(f"{path}: {why}")
    if recording.is_of_two:
        raise NotJudgedError(f"{path}: {TWO_RUNS}")
    summary = watch.summary()
    facts = RecordingFacts(
        path=str(path),
        form=recording.form,
        observations=recording.contents.count,
        first_ns=played.first.received_ns,
        last_ns=played.last.received_ns,
        complete=not faults
        and (recording.ended or recording.form != OWN or bool(played.part.ends_ns)),
        faults=faults,
        limits=(
            *recording.limits(base is not None and base.is_on_arrival),
            *(base.limits if base is not None else ()),
            *player.limits(),
            *(unrecorded.values() or silent(recording, properties, _channels(monitored))),
            *assumed(attribution),
            *(
                f"{name} is not judged: {topic} was not recorded"
                for name, topic in left_out.items()
            ),
        ),
        time="" if base is None else base.sentence,
        steady_ns=played.steady_ns,
        unrecorded=tuple(
            dict.fromkeys(
                [
                    *unrecorded,
                    *(attribution.unrecorded if attribution else ()),
                    *left_out.values(),
                ]
            )
        ),
    )
    return CheckResult(
        recording=facts,
        models=tuple(map(str, subject.models)),
        system=monitored.system.name,
        properties=tuple(map(str, subject.properties)),
        interfaces=tuple(map(str, subject.interfaces)),
        verdicts=tuple(collector.reported),
        machines=summary.machines,
        timelines=timelines.finished(played.last.received_ns) if timelines is not None else (),
        counts=summary.counts,
        problems=summary.problems,
        recorded=played.is_judged_before,
        counted=tuple(collector.counted),
        unmonitored=monitored.unmonitored,
        base=base,
        view=view,
    )


def _judged(monitored: Monitored, surveyed: Surveyed, left_out: Mapping[str, str]) -> Monitored:
    """What of ``monitored`` can be judged. All of it is itself: nothing of it is compiled again."""
    attribution = surveyed.attribution
    if attribution is None and not left_out:
        return monitored
    machines = monitored.machines if attribution is None else attribution.machines
    skew_ns = max(monitored.bounds.skew, _open_ns(surveyed.base))
    return msgspec.structs.replace(
        monitored,
        machines=tuple(machine for machine in machines if machine.name not in left_out),
        policy=False,
        bounds=msgspec.structs.replace(
            monitored.bounds, skew=skew_ns, names_callers=attribution is None
        ),
    )


def _channels(monitored: Monitored) -> list[str]:
    """Those that the models name."""
    machines = (*monitored.system.nodes, *monitored.system.plugins)
    return [
        interface.channel
        for machine in machines
        for interface in machine.interfaces
        if interface.channel is not None
    ]


class _Played:
    """A recording that is played to a watch.

    Attributes:
        first, last: its first and last entry; None before there is one.
        is_judged_before: whether it has verdicts of its own.
        part: what of it is played.
    """

    def __init__(
        self,
        recording: Recording,
        entries: Iterator[Entry],
        watch: Run,
        player: Player,
        surveyed: Surveyed,
        view: View,
        properties: PropertyWatch,
    ) -> None:
        self.first: Entry | None = None
        self.last: Entry | None = None
        self.is_judged_before = False
        self.part = Part(view)
        self._was_set_back = False
        self._recording = recording
        self._read = entries
        self._watch = watch
        self._player = player
        self._surveyed = surveyed
        self._properties = properties
        self._missing = sorted(surveyed.missing)
        self._late_ns = 0
        """By how much at most something was received after it happened."""
        self._instants: dict[str, tuple[int, str]] = {}
        """When each node of the models did something last (ns), and on which channel."""

    def play(self, latency_ns: int, timelines: Timelines | None, progress: Progress | None) -> None:
        """Play all of it, to its end."""
        count = 0
        play, attribution = self._player.play, self._surveyed.attribution
        for entry in self.part.of(self._entries(latency_ns)):
            if isinstance(entry, Gap):
                self._watch.gap(entry)
                continue
            if self.first is None:
                self.first = entry
                finds_nodes = isinstance(entry, Began)
                self._player.start(
                    entry, functools.partial(self._watch.start, finds_nodes=finds_nodes)
                )
                if self.part.begins_ns:  # what was left out may have been anything
                    self._properties.lose_all(0, self.part.begins_ns)
            self._tell_missing(entry, latency_ns)
            self.last = entry
            self._lose_what_cannot_be_read(latency_ns)
            if type(entry) is Observation:
                self._late_ns = max(self._late_ns, entry.received_ns - entry.stamp_ns)
                if attribution is not None:
                    entry = attribution(entry)  # noqa: PLW2901 - the same, with names
                    self._note_instant(entry)
            play(entry)
            if type(entry) is Ending:
                self._watch.ending(entry.received_ns)
            if timelines is not None:
                timelines.look(entry)
            if type(entry) is ReportedVerdict:
                self.is_judged_before = True
            if progress is not None:
                count += 1
                if count == PROGRESS_EVERY:
                    progress(count)
                    count = 0
        self._lose_what_cannot_be_read(latency_ns)
        self._end(latency_ns)
        if progress is not None:
            progress(count)

    def _note_instant(self, seen: Observation) -> None:
        """Of two things that a node did at once, by a coarse clock, nobody knows which came first."""
        at_ns, node = seen.stamp_ns, seen.source
        if not node:
            return
        before = self._instants.get(node, (-1, ""))
        self._instants[node] = at_ns, seen.channel
        if before[0] == at_ns and before[1] != seen.channel:
            why = f"{node} did two things at the same instant, by its clock"
            self._watch.gap(Gap("", node, at_ns, at_ns + 1, why))

    def _lose_what_cannot_be_read(self, latency_ns: int) -> None:
        """A message of a bag that cannot be decoded was there: no property takes it for silence."""
        base = self._surveyed.base
        for message in self._recording.take_missed() if base is not None else ():
            topic = message.channel.topic
            channel = topic.removesuffix(EVENT_SUFFIX)
            at_ns = message.received_ns
            if base is not None and base.kind == PUBLISH and message.published_ns >= base.first_ns:
                at_ns = message.published_ns
            if base is not None and base.kind not in (LOG, PUBLISH):
                self._properties.lose(
                    channel, 0, END_OF_TIME_NS
                )  # what would tell its time is in it
            else:
                early_ns = latency_ns if channel != topic else 0  # events happened before
                self._properties.lose(channel, at_ns - early_ns, at_ns + 1)

    def _tell_missing(self, entry: Entry, latency_ns: int) -> None:
        """What is damaged in a bag was there: nobody is judged by its silence."""
        base = self._surveyed.base
        while self._missing and base is not None:
            from_ns, until_ns = self._missing[0]
            if base.kind not in (LOG, PUBLISH):  # where it lies in that time is not known
                from_ns, until_ns = 0, END_OF_TIME_NS
            if entry.received_ns < from_ns:
                return
            del self._missing[0]
            why = "a part of the recording is damaged"
            from_ns = max(from_ns - latency_ns, 0)
            self._watch.gap(Gap("", "", from_ns, until_ns + 1, why, cause=Missing.ANEW))

    @property
    def steady_ns(self) -> int:
        """How long it is (ns), where its clock was set back; else 0."""
        return self._player.steady_ns() if self._was_set_back else 0

    def _entries(self, latency_ns: int) -> Iterator[Entry | Gap]:
        base, entries = self._surveyed.base, self._read
        if base is None:
            return received_on_time(entries)
        return in_time(entries, base, functools.partial(self._set_back, latency_ns))

    def _set_back(self, latency_ns: int) -> None:
        """The clock was set back: a run is over, and another begins."""
        self._was_set_back = True
        self._end(latency_ns)

    def _end(self, latency_ns: int) -> None:
        """All is played, of this clock: nothing comes later.

        A monitor that ended in good order had judged before what it had received. Any other file is whole
        up to its last entry, but for what was under way: that takes as long as anything in it took.
        """
        last = self.last
        if last is None:
            return
        end_ns = self.part.ends_ns or last.received_ns
        self._player.finish(end_ns)
        if self._player.is_paced and self._recording.ended and not self.part.ends_ns:
            return
        known_ns = end_ns - min(self._late_ns, latency_ns)
        base = self._surveyed.base
        if base is not None and base.known_ns and not self.part.ends_ns:
            known_ns = min(known_ns, base.known_ns)
        self._watch.finish(known_ns, end_ns)
