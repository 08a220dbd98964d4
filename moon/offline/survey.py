"""What is found in a recording before it is judged: by which time, who did what, which channels are missing.

A recording of moon says all of that itself, and is read once. Any other is read twice.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from pathlib import Path

import msgspec

from m2c.model.machine import InterfaceKind, Machine
from m2c.model.system import System
from m2c.suggestions import nearest
from moon.monitor.properties import PropertyWatch
from moon.monitor.subject import Monitored
from moon.offline.view import View
from moon.oracle.bounds import Bounds
from moon.properties.predicates import ANY_CHANNEL
from moon.recording.attribution import Attribution, only_node, shared_topics
from moon.recording.contents import named
from moon.recording.entries import Began
from moon.recording.format import EVENT_TOPIC, PACKED_TOPIC, PULSE_TOPIC, VERDICT_TOPIC
from moon.recording.reader import JSON_LINES, OWN, ROSBAG, Recording, RecordingError, open_recording
from moon.sources.time_base import TimeBase, time_base
from moon.sources.time_choice import CLOCK, PUBLISH, TimeChoice, TimeError
from moon.sources.time_survey import Survey
from moon.tap.selection import is_recorded
from transports.fields_read import Paths
from transports.interface import Observation

MISTYPED = 2
"""So many letters are mistyped in a name; what differs more is another one."""
OWN_TOPICS = {EVENT_TOPIC, PACKED_TOPIC, PULSE_TOPIC, VERDICT_TOPIC}


class NotJudgedError(RecordingError):
    """Nothing in a recording can be judged, or not by the time that was chosen; the text says why."""


class Surveyed(msgspec.Struct, frozen=True):
    """What was found.

    Attributes:
        base: by which time it is judged; None: a recording of moon has one time only.
        attribution: who did what; None: it says so itself, or there are no machines.
        recorded: the channels that were recorded, if only to show that nothing happened on them.
        globs: the channels that moon was to record; empty: all, or it is not moon's.
        missing: between which times of reception (ns) a part of it is damaged.
        shared: the topics that matter to properties on which several publish, as far as that is known.
        other_time: why timers may follow another clock than stamps do.
    """

    base: TimeBase | None
    attribution: Attribution | None
    recorded: tuple[str, ...]
    globs: tuple[str, ...] = ()
    missing: tuple[tuple[int, int], ...] = ()
    shared: frozenset[str] = frozenset()
    other_time: str = ""

    def left_out(self, machines: Iterable[Machine]) -> dict[str, str]:
        """Those of ``machines`` of which something was not to be recorded: by name, a channel of each."""
        return {
            machine.name: interface.channel
            for machine in machines
            for interface in reversed(machine.interfaces)
            if interface.channel is not None
            and interface.kind is not InterfaceKind.TIMER
            and not is_recorded(interface.channel, self.globs)
        }

    def unrecorded(self, properties: PropertyWatch) -> dict[str, str]:
        """Each channel that ``properties`` need and that was not recorded, with what is said of it."""
        return {
            channel: _unrecorded(channel, properties, self.recorded)
            for channel in sorted(properties.channels - {*self.recorded, ANY_CHANNEL})
        }


def silent(recording: Recording, properties: PropertyWatch, named: Iterable[str]) -> list[str]:
    """Where nothing happened that ``properties`` need and no model names, by a recording of moon."""
    if recording.form != OWN:
        return []
    found = recording.contents.channels
    return [
        f"nothing was recorded on {channel}{'; ' if hint else ''}{hint}"
        for channel in sorted(properties.channels - {*found, *named, ANY_CHANNEL})
        for hint in [nearest(channel, found)]
    ]


def _unrecorded(channel: str, properties: PropertyWatch, recorded: Iterable[str]) -> str:
    users = [
        name
        for name, item in properties.properties.items()
        if any(port.channel == channel for port in item.ports)
    ]
    hint = nearest(channel, recorded)
    return (
        f"{channel} was not recorded: what depends on it cannot be known ({', '.join(users)})"
        f"{'; ' if hint else ''}{hint}"
    )


def survey(
    path: Path,
    monitored: Monitored,
    properties: PropertyWatch,
    named: Iterable[str],
    view: View,
) -> Surveyed:
    """Read the recording at ``path``, as far as it has to be known before it is judged.

    Args:
        path: the recording.
        monitored: what is monitored.
        properties: of these.
        named: the channels that the models name.
        view: how it is judged.

    Raises:
        RecordingError: there is no recording, or nothing of it can be judged.
    """
    recording = open_recording(path, monitored.system.library)
    if recording.form == OWN and view.time.kind in ("", PUBLISH):
        return _own(recording, properties, named)
    needed = frozenset({*named, *properties.channels})
    base, attribution = read_through(
        recording,
        view.time,
        monitored.system,
        monitored.machines,
        monitored.bounds,
        None if ANY_CHANNEL in needed else needed,
    )
    if not monitored.machines:
        attribution = None
    return Surveyed(
        base=base,
        attribution=attribution,
        recorded=tuple(recording.topics()),
        missing=recording.missing,
        shared=_shared(recording, monitored, properties),
        other_time=_other_time(recording, view.time),
    )


def _shared(
    recording: Recording, monitored: Monitored, properties: PropertyWatch
) -> frozenset[str]:
    """The topics on which several publish, by what publishers offered or by the models."""
    shared = shared_topics(monitored.system)
    return frozenset(
        channel
        for channel in properties.channels
        if channel in shared or recording.publishers(channel) > 1
    )


def read_through(
    recording: Recording,
    choice: TimeChoice | None,
    system: System,
    machines: Iterable[Machine],
    bounds: Bounds,
    needed: frozenset[str] | None = None,
) -> tuple[TimeBase | None, Attribution | None]:
    """Read all of ``recording``: by which time it can be judged, and who did what in it.

    Args:
        recording: just opened.
        choice: of the time; None: by evidence.
        system: all that runs.
        machines: those of it that are to be judged.
        bounds: what is assumed.
        needed: the channels of which the stamps matter; None: all.

    Returns:
        Neither for a recording of moon, which says both itself (unless another time was chosen); no time for
        one in which there is nothing.

    Raises:
        NotJudgedError: it has no such time, or none that makes sense, or holds two runs.
    """
    choice = choice or TimeChoice()
    found = Survey(choice, needed, bounds, only_node(system))
    for entry in recording.entries(fields_read=_no_sequence):
        if type(entry) is Observation:
            found.note(entry)
    if recording.is_of_two:
        raise NotJudgedError(f"{recording.path}: {TWO_RUNS}")
    if recording.form == OWN and choice.kind in ("", PUBLISH):
        return None, None
    clocks = recording.clocks()
    if choice.kind == CLOCK and len(clocks) > 1:
        text = f"it has the times of {named(clocks)}; expected one, --time log or --time publish"
        raise NotJudgedError(f"{recording.path}: {text}")
    base = None
    if found.log.count:
        is_lines = recording.form == JSON_LINES
        try:
            base = time_base(found, choice, is_lines, late=recording.late)
        except TimeError as error:
            raise NotJudgedError(f"{recording.path}: {error}") from error
    is_on_arrival = base is not None and base.is_on_arrival
    attribution = recording.attributed(
        system,
        machines if recording.form in (ROSBAG, OWN) else (),
        on_arrival=is_on_arrival or recording.contents.on_arrival,
        is_ordered=found.is_on_arrival or not is_on_arrival,
        other_time=_other_time(recording, choice),
    )
    return base, attribution


def _other_time(recording: Recording, choice: TimeChoice) -> str:
    """Why timers may follow another clock than stamps do; "" if they do not, or somebody chose the time."""
    clocks = recording.clocks() if not choice.kind else []
    if not clocks:
        return ""
    return (
        f"time may be that of {named(clocks)}, which may stand still or be faster "
        f"(--time {CLOCK} judges by it, --time {PUBLISH} as if nobody used it)"
    )


TWO_RUNS = "it holds two runs, and nothing can be judged of both together; check each by itself"


def _own(recording: Recording, properties: PropertyWatch, named: Iterable[str]) -> Surveyed:
    """Which channels a recording of moon has, of those that ``properties`` need.

    It has all that happened on channels that were to be recorded: on those that it does not show nothing
    did, unless their names are mistyped. A monitor heard all, whatever the names.
    """
    wanted = properties.channels - {ANY_CHANNEL}
    found, globs = recording.contents.channels, tuple[str, ...]()
    for number, entry in enumerate(recording.entries(wanted.__contains__, _no_sequence)):
        if isinstance(entry, Began):
            globs = entry.globs
            if entry.paced:
                return Surveyed(base=None, attribution=None, recorded=tuple(sorted(wanted)))
        if number and found.keys() >= wanted:
            break
    shown = {*found, *recording.topics()} - OWN_TOPICS
    silent = {
        channel
        for channel in wanted - shown
        if is_recorded(channel, globs)
        and (channel in named or not any(_is_mistyped(channel, other) for other in shown))
    }
    return Surveyed(
        base=None, attribution=None, recorded=tuple(sorted(shown | silent)), globs=globs
    )


def _no_sequence(_: str) -> Paths:
    """What is read of messages where only stamps matter."""
    return frozenset()


def _is_mistyped(name: str, other: str) -> bool:
    """Whether ``name`` is ``other`` but for a letter or two."""
    longest = max(len(name), len(other))
    if longest - min(len(name), len(other)) > MISTYPED:
        return False
    blocks = difflib.SequenceMatcher(None, name, other, autojunk=False).get_matching_blocks()
    wrong = longest - sum(block.size for block in blocks)
    return wrong <= min(MISTYPED, longest // 3)


def assumed(attribution: Attribution | None) -> list[str]:
    """What is assumed by it, and whom it leaves out, one sentence each."""
    if attribution is None:
        return []
    return [*filter(None, [attribution.assumption()]), *attribution.unjudged]
