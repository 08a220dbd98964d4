"""What can be concluded about a machine from one recording, and what cannot, and why."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime

import msgspec

from m2c.model.machine import Machine
from moon.feed.places import places
from moon.recording.contents import ChannelContents, Contents, is_made_up
from moon.recording.reader import Recording
from moon.recording.stored import plural
from moon.sources.time_base import TimeBase
from transports.interface import ObservationKind as Kind

_OF_TOPICS = (Kind.MESSAGE, Kind.MESSAGE_TAKEN)
_NAMELESS = (
    "who sent what was recorded is not known",
    "its callers were recorded without their names",
)


class Gap(msgspec.Struct, frozen=True):
    """Something of a machine that a recording does not tell.

    Attributes:
        channel: where.
        why: what is missing, and what follows.
    """

    channel: str
    why: str


class Concluded(msgspec.Struct, frozen=True):
    """What a recording tells of one machine.

    Attributes:
        machine: its name; also its node's.
        observed: how many observations there are on its channels.
        own: whether anything in it is known to be from its node.
        gaps: what is missing.
    """

    machine: str
    observed: int
    own: bool
    gaps: tuple[Gap, ...]


class Overview(msgspec.Struct, frozen=True):
    """What a recording is and holds.

    Attributes:
        path: where it is.
        form: what it is.
        observations: how many there are.
        channels: on how many channels.
        first_ns: stamp of the first observation.
        seconds: from the first to the last.
        faults: what could not be read.
        limits: what cannot be concluded from any of it.
        time: by which of its times it would be judged; "" if it has one.
    """

    path: str
    form: str
    observations: int
    channels: int
    first_ns: int
    seconds: float
    faults: tuple[str, ...]
    limits: tuple[str, ...]
    time: str = ""


def overview(recording: Recording, base: TimeBase | None = None) -> Overview:
    """What was found in ``recording``, which was read to its end and would be judged by ``base``."""
    contents = recording.contents
    return Overview(
        path=str(recording.path),
        form=recording.form,
        observations=contents.count,
        channels=len(contents.channels),
        first_ns=contents.first_ns,
        seconds=max(0, contents.last_ns - contents.first_ns) / 1e9,
        faults=tuple(recording.faults()),
        limits=(
            *recording.limits(base is not None and base.is_on_arrival),
            *(base.limits if base is not None else ()),
        ),
        time="" if base is None else base.sentence,
    )


def concluded(
    machine: Machine, contents: Contents, judged: frozenset[str] | None = None
) -> Concluded:
    """What ``contents`` tell of ``machine``, whose node has its name.

    Args:
        machine: its model.
        contents: what was found in the recording.
        judged: of a recording without names: those that can be judged all the same.
    """
    channels = contents.channels
    parts: dict[tuple[str, bool], set[Kind]] = {}
    for name, kind in places(machine):
        parts.setdefault((name, kind in _OF_TOPICS), set()).add(kind)
    own = (
        machine.name in judged
        if judged is not None
        else any(
            source == machine.name and kind in kinds
            for (name, _), kinds in parts.items()
            if name in channels
            for kind, source in channels[name].sources
        )
    )
    gaps = dict.fromkeys(
        gap
        for (name, is_topic), kinds in parts.items()
        for gap in _gaps(machine, name, kinds, channels.get(name), is_topic)
        if not (own and judged is not None and gap.why in _NAMELESS)
    )
    names = dict.fromkeys(name for name, _ in parts)
    observed = sum(channels[name].count for name in names if name in channels)
    return Concluded(machine.name, observed, own, tuple(gaps))


def _gaps(
    machine: Machine, channel: str, kinds: set[Kind], found: ChannelContents | None, is_topic: bool
) -> Iterator[Gap]:
    if found is None:
        what = "message was" if is_topic else "event of a call was"
        hint = "" if is_topic else f" (a bag has them on {channel}/_service_event)"
        yield Gap(channel, f"no {what} recorded{hint}: nobody sent one, or it was not recorded")
        return
    if kinds == {Kind.MESSAGE_TAKEN}:
        return
    sources = {source for kind, source in found.sources if kind in kinds}
    if not sources and not is_topic:
        yield Gap(
            channel, f"only the other end of its calls was recorded, not {machine.name}'s own"
        )
    elif machine.name not in sources and "" in sources:
        yield Gap(channel, _NAMELESS[0])
    elif machine.name not in sources and all(map(is_made_up, sources)):
        yield Gap(channel, _NAMELESS[1])
    elif machine.name not in sources:
        others = ", ".join(sorted(sources))
        yield Gap(channel, f"was recorded of others only ({others}), not of {machine.name}")


def lines_of_overview(found: Overview) -> list[str]:
    """The overview in words."""
    when = datetime.fromtimestamp(found.first_ns / 1e9, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
    lines = [
        f"{found.path}  {found.form}, {plural(found.observations, 'observation')} on "
        f"{plural(found.channels, 'channel')}"
        + (f", {found.seconds:.1f} s from {when}" if found.observations else "")
    ]
    for title, sentences in (
        ("is judged by its time", (found.time,) if found.time else ()),
        ("could not be read", found.faults),
        ("cannot be known", found.limits),
    ):
        if sentences:
            lines += [f"  {title}", *(f"    {sentence}" for sentence in sentences)]
    return lines


def lines_of(found: Concluded) -> list[str]:
    """What is concluded of one machine, in words."""
    if not found.observed:
        return [f"{found.machine}: cannot be judged: nothing on its channels was recorded"]
    if not found.own:
        verdict = "cannot be judged: nothing that was recorded is known to be from its node"
    elif found.gaps:
        verdict = "can be judged by what there is"
    else:
        verdict = "can be judged"
    width = max((len(gap.channel) for gap in found.gaps), default=0)
    return [
        f"{found.machine}: {verdict} ({plural(found.observed, 'observation')})",
        *(f"  {gap.channel.ljust(width)}  {gap.why}" for gap in found.gaps),
    ]
