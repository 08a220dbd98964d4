"""What ``moon check`` concludes of a recording."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec

from moon.feed.counts import Counts
from moon.monitor.status import UNSEEN, MachineStatus
from moon.offline.view import Part, View
from moon.recording.entries import ReportedVerdict
from moon.recording.reader import Recording
from moon.sources.time_base import TimeBase, in_time
from moon.verdict import Outcome
from transports.fields_read import FieldsRead
from transports.interface import Observation

MAX_REPEATS = 10_000
"""Violations that read as the one before are kept up to so many: a broken node may never stop."""


class Band(msgspec.Struct, frozen=True):
    """How a machine or a property stood from ``start_ns`` on, until ``end_ns``.

    Attributes:
        start_ns, end_ns: on the recorder's clock, ns since the epoch (``received_ns`` of entries).
        states: in which the machine may have been, going by what had been received; empty if that was
            not known, and for properties.
        verdict: ``conforming``, ``violated``, ``inconclusive``, or ``unseen``
            (``moon.monitor.status.UNSEEN``). As a monitor's screen has it, but not lasting: a machine
            that conforms again is conforming.
    """

    start_ns: int
    end_ns: int
    states: tuple[str, ...]
    verdict: str


class Timeline(msgspec.Struct, frozen=True):
    """The bands of one machine or property, in order and without gaps.

    Attributes:
        name: of the node, or the property's id.
        kind: ``model``, or ``property`` (``moon.monitor.status.PROPERTY``).
        bands: neighbours differ.
        merged: how many changes are not shown, because there were too many of them: the bands in
            which they fell have the states of all of them.
    """

    name: str
    kind: str
    bands: tuple[Band, ...]
    merged: int = 0


class RecordingFacts(msgspec.Struct, frozen=True):
    """The recording itself.

    Attributes:
        path: as it was given.
        form: ``moon recording``, ``rosbag2``, ``JSON lines``.
        observations: how many were read.
        first_ns, last_ns: when the recording begins and ends (``received_ns`` of the first and the
            last entry); 0 if there is none.
        complete: whether all of it was read, and it was ended in good order.
        faults: what could not be read, one sentence each, with its place in the file.
        limits: what cannot be concluded from what was recorded, one sentence each.
        time: by which of its times it was judged, and why, where a recording may have several.
        unrecorded: channels that are needed, and were not recorded.
        steady_ns: how long it is (ns), where its clock was set back; else 0.
    """

    path: str
    form: str
    observations: int
    first_ns: int
    last_ns: int
    complete: bool
    faults: tuple[str, ...] = ()
    limits: tuple[str, ...] = ()
    time: str = ""
    unrecorded: tuple[str, ...] = ()
    steady_ns: int = 0

    @property
    def seconds(self) -> float:
        """How long the recording is."""
        return (self.steady_ns or self.last_ns - self.first_ns) / 1e9


class CheckResult(msgspec.Struct, frozen=True):
    """What was found in one recording.

    Who wants to show the observations too reads them once more, from ``recording.path``.

    Attributes:
        recording: what was checked.
        models: the paths of the models or system file, as they were given.
        system: the system's name; "" without models.
        properties: the property files, as they were given.
        interfaces: folders of interface packages, as they were given.
        verdicts: all that a monitor would have reported, in order, each with the time at which it would
            have (on the recorder's clock); the same lines that ``moon monitor --log`` writes.
        machines: each machine as it stands at the end, then each property.
        timelines: one for each of ``machines``, in the same order; empty unless asked for.
        counts: what was received, and what could not be used.
        problems: what could not be received or judged, one sentence each.
        recorded: whether the recording holds verdicts of its own (``moon monitor --record``).
        seconds: how long the check took.
        counted: the violations that count, in order, each with the time at which it was: those of
            ``verdicts`` that were not withdrawn, and the first :data:`MAX_REPEATS` of those that are
            not reported again; None: all of ``verdicts``.
        unmonitored: what was not checked though it was named, and why, one sentence each.
        base: by which of its times the recording was judged; None: it has one.
        view: which part of it.
    """

    recording: RecordingFacts
    models: tuple[str, ...]
    system: str
    properties: tuple[str, ...]
    interfaces: tuple[str, ...]
    verdicts: tuple[ReportedVerdict, ...]
    machines: tuple[MachineStatus, ...]
    timelines: tuple[Timeline, ...]
    counts: Counts
    problems: tuple[str, ...]
    recorded: bool = False
    seconds: float = 0.0
    counted: tuple[ReportedVerdict, ...] | None = None
    unmonitored: tuple[str, ...] = ()
    base: TimeBase | None = None
    view: View = View()

    def entries(
        self, recording: Recording, fields_read: FieldsRead | None = None
    ) -> Iterator[Observation]:
        """The observations of ``recording``, opened anew, that were judged, each when it happened.

        For ``fields_read`` see :meth:`Recording.entries`.
        """
        found = recording.entries(fields_read=fields_read)
        entries = in_time(found, self.base) if self.base is not None else found
        for entry in Part(self.view).of(entries):
            if isinstance(entry, Observation):
                yield entry

    @property
    def violations(self) -> int:
        """Of all machines and properties."""
        return sum(machine.violations for machine in self.machines)

    @property
    def undecided(self) -> tuple[MachineStatus, ...]:
        """The machines and properties of which nothing is known in the end: inconclusive, or unseen."""
        return tuple(
            machine
            for machine in self.machines
            if not machine.violations and machine.verdict in (UNSEEN, str(Outcome.INCONCLUSIVE))
        )

    @property
    def is_open(self) -> bool:
        """Whether something is not known in the end, or cannot be as it was not recorded."""
        return bool(self.undecided or self.recording.unrecorded)

    @property
    def violated(self) -> tuple[ReportedVerdict, ...]:
        """The verdicts that are violations."""
        return tuple(
            reported for reported in self.verdicts if reported.verdict.outcome is Outcome.VIOLATED
        )

    @property
    def each_violation(self) -> tuple[ReportedVerdict, ...]:
        """As many as :attr:`violations` (unless so many repeat themselves that not all are kept)."""
        return self.violated if self.counted is None else self.counted
