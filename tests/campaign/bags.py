"""Bags of a run as others record it, and what may be wrong with them: clocks, stamps, what is left out. All plain data.

A bag has topics and service events, stamped by the nodes' clocks and by the recorder's; nothing in it is numbered.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from enum import StrEnum
from pathlib import Path
from random import Random
from typing import Any

import msgspec
from mcap.writer import Writer

from m2c.language.datatypes import Structure
from m2c.model.machine import InterfaceKind
from m2c.model.system import System
from moon.offline.view import View, instant
from moon.recording.cdr_writing import HEADER, as_typed, encoder
from moon.recording.definition_text import definition_text
from moon.recording.definitions import Definitions
from moon.sources.time_choice import TimeChoice, time_choice
from transports.actions.parts import channel_of_part
from transports.interface import Observation, ObservationKind
from transports.service_events import EVENT_SUFFIX, KIND_OF_EVENT, TYPE_SUFFIX
from transports.simulated.world import START_NS

NS = 10**9
_LAG_S = (0.0005, 0.003)
"""So long after it happened is something recorded."""
_PARTICIPANT_BYTES, _GID_BYTES = 12, 16


class BagClock(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The clock of one node is off.

    Attributes:
        source: the node; empty: all.
        ahead_s: by so much.
        at_s, for_s: from then on, and for how long; 0: for good.
        drift: it runs by this share too fast.
    """

    source: str = ""
    ahead_s: float = 0.0
    at_s: float = 0.0
    for_s: float = 0.0
    drift: float = 0.0

    def off_s(self, at_s: float) -> float:
        """By how much it is ahead then."""
        is_on = at_s >= self.at_s and (not self.for_s or at_s < self.at_s + self.for_s)
        return (self.ahead_s if is_on else 0.0) + self.drift * at_s


class Bag(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A bag of a run, and what is wrong with it.

    Attributes:
        clocks: of nodes, that are off.
        stood_still: when the recorder did, and for how long (s); it received everything afterwards.
        unset: of this share of the messages the stamps are zero.
        begins_s, ends_s: when recording begins and ends; 0: with the run.
        latched: channels of which the last message of before is recorded first, stamped when it was published.
        left_out: channels that are not recorded.
        again: whether another run follows in which other nodes do the same at the same times.
        is_same: whether it is the same run a second time: its clients have the same GIDs.
        shuffled: by so much (s) entries stand out of their order.
        from_s, to_s: the part that is judged; 0: all.
        time: by which time, as ``--time`` has it; empty: by evidence.
        seed: of what is drawn for each entry.
    """

    clocks: tuple[BagClock, ...] = ()
    stood_still: tuple[float, float] = (0.0, 0.0)
    unset: float = 0.0
    begins_s: float = 0.0
    ends_s: float = 0.0
    latched: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    again: bool = False
    is_same: bool = False
    shuffled: float = 0.0
    from_s: float = 0.0
    to_s: float = 0.0
    time: str = ""
    seed: int = 0

    def recorded(self, seen: Iterable[Observation]) -> list[Observation]:
        """What of a run is in it, in the order in which it happened."""
        begin_ns = START_NS + round(self.begins_s * NS)
        end_ns = START_NS + round((self.ends_s or 1e6) * NS)
        told = [one for one in seen if _is_told(one) and one.channel not in self.left_out]
        before = {
            one.channel: one
            for one in told
            if one.channel in self.latched and one.stamp_ns < begin_ns
        }
        latched = [  # one after the other: no two things happen at one instant
            msgspec.structs.replace(one, received_ns=one.stamp_ns, stamp_ns=begin_ns + place)
            for place, one in enumerate(before.values())
        ]
        within = [
            msgspec.structs.replace(one, received_ns=one.stamp_ns)
            for one in told
            if begin_ns <= one.stamp_ns < end_ns
        ]
        return sorted([*latched, *within], key=lambda one: one.stamp_ns)

    @property
    def view(self) -> View:
        """How it is checked."""
        choice = time_choice(self.time) if self.time else TimeChoice()
        from_, to = (instant(str(at)) if at else None for at in (self.from_s, self.to_s))
        return View(choice, from_, to)


def _is_told(seen: Observation) -> bool:
    is_message = seen.kind is ObservationKind.MESSAGE and not seen.type_name.startswith("m2c/")
    return (is_message or seen.kind in KIND_OF_EVENT) and not seen.error


def declared(system: System) -> dict[str, str]:
    """The topics that a recorder of all finds, with their types, whether there are messages on them or not."""
    library, found = system.library, dict[str, str]()
    for node in (*system.nodes, *system.plugins):
        for interface in node.interfaces:
            channel, name = interface.channel, interface.type_name
            if channel is None or interface.own:
                continue
            match interface.kind:
                case InterfaceKind.PUBLISHER | InterfaceKind.SUBSCRIBER:
                    found[channel] = library.message(name).name
                case InterfaceKind.SERVER | InterfaceKind.CLIENT:
                    found[channel + EVENT_SUFFIX] = library.service(name).name + TYPE_SUFFIX
                case InterfaceKind.ACTION_SERVER | InterfaceKind.ACTION_CLIENT:
                    action = library.action(name).name
                    for part, type_name in (
                        (f"send_goal{EVENT_SUFFIX}", f"{action}_SendGoal{TYPE_SUFFIX}"),
                        (f"get_result{EVENT_SUFFIX}", f"{action}_GetResult{TYPE_SUFFIX}"),
                        (f"cancel_goal{EVENT_SUFFIX}", f"action_msgs/srv/CancelGoal{TYPE_SUFFIX}"),
                        ("feedback", f"{action}_FeedbackMessage"),
                        ("status", "action_msgs/msg/GoalStatusArray"),
                    ):
                        found[channel_of_part(channel, part)] = type_name
    return found


def write_bag(path: Path, bag: Bag, run: Sequence[Observation], system: System) -> None:
    """Write what ``bag.recorded`` of a run as another tool does, with all that is declared.

    Args:
        path: where to.
        bag: what is wrong with it.
        run: what is recorded; ``received_ns`` is when it was published.
        system: what ran.
    """
    chance = Random(bag.seed)
    entries: list[tuple[float, int, int, Observation]] = []
    last_s: dict[tuple[str, str], float] = {}
    still_s, for_s = bag.stood_still
    for seen in run:
        at_s = (seen.stamp_ns - START_NS) / NS
        log_s = at_s + chance.uniform(*_LAG_S)
        if for_s and still_s < log_s < still_s + for_s:
            log_s = still_s + for_s + (log_s - still_s) * 1e-3
        sender = seen.source, seen.channel  # what one sends on a topic is received in order
        log_s = last_s[sender] = max(log_s, last_s.get(sender, 0.0) + 1e-9)
        off_s = sum(it.off_s(at_s) for it in bag.clocks if it.source in ("", seen.source))
        published_ns = seen.received_ns + round(off_s * NS)
        if chance.random() < bag.unset:
            published_ns = 0
        log_ns = START_NS + round(log_s * NS)
        place_s = log_s + chance.uniform(0.0, bag.shuffled)
        entries.append((place_s, log_ns, max(published_ns, 0), seen))
    entries.sort(key=lambda entry: entry[0])
    with path.open("wb") as opened:
        file = _File(Writer(opened), Definitions(system.library))
        for topic, type_name in declared(system).items():
            if topic.removesuffix(EVENT_SUFFIX) not in bag.left_out:
                file.declare(topic, type_name)
        for life in range(1 + bag.again):
            file.life = 0 if bag.is_same else life
            for _, log_ns, published_ns, seen in entries:
                file.add(log_ns, published_ns, seen)
        file.writer.finish()


class _File:
    """A bag that is written; of each ``life`` clients have other GIDs."""

    def __init__(self, writer: Writer, definitions: Definitions) -> None:
        self.writer = writer
        self._definitions = definitions
        self._channels: dict[str, tuple[int, Structure]] = {}
        self._count = self.life = 0
        writer.start(profile="ros2", library="another")

    def declare(self, topic: str, type_name: str) -> tuple[int, Structure]:
        """Declare ``topic``, if it is not yet: its channel and its type."""
        known = self._channels.get(topic)
        if known is None:
            structure = self._definitions.structure(type_name)
            text = definition_text(structure).encode()
            schema = self.writer.register_schema(type_name, "ros2msg", text)
            channel = self.writer.register_channel(topic, "cdr", schema)
            known = self._channels[topic] = channel, structure
        return known

    def add(self, log_ns: int, published_ns: int, seen: Observation) -> None:
        """Add ``seen``."""
        topic, type_name, data = seen.channel, seen.type_name, seen.data
        if seen.kind is not ObservationKind.MESSAGE:
            topic, type_name = topic + EVENT_SUFFIX, type_name.rpartition("_")[0] + TYPE_SUFFIX
            data = _event(seen, published_ns, self.life)
        channel, structure = self.declare(topic, type_name)
        out = bytearray(HEADER)
        encoder(structure)(as_typed(data, structure), out)
        self._count += 1
        self.writer.add_message(channel, log_ns, bytes(out), published_ns, self._count)


def _event(seen: Observation, published_ns: int, life: int) -> dict[str, Any]:
    """The service event of ``seen``, stamped by its node."""
    sec, nanosec = divmod(published_ns, NS)
    gid = hashlib.sha256(f"{seen.client} {life}".encode()).digest()[:_PARTICIPANT_BYTES]
    is_request = "request" in seen.kind
    return {
        "info": {
            "event_type": KIND_OF_EVENT.index(seen.kind),
            "stamp": {"sec": sec, "nanosec": nanosec},
            "client_gid": [*gid, *bytes(_GID_BYTES - _PARTICIPANT_BYTES)],
            "sequence_number": seen.call,
        },
        "request": [seen.data] if is_request else [],
        "response": [] if is_request else [seen.data],
    }


class Flaw(StrEnum):
    """What may be wrong with a bag."""

    NONE = "nothing"
    OFF = "a clock that is off"
    SET = "a clock that is set"
    FOR_A_WHILE = "a clock that is off for a while"
    SLOW = "a clock that is slow, or fast"
    ALL_OFF = "clocks that are all off"
    UNSET = "stamps that nobody set"
    STOOD_STILL = "a recorder that stands still"
    LATE = "a recorder that comes late"
    SHORT = "a recorder that ends early"
    LEFT_OUT = "channels that are not recorded"
    AGAIN = "two runs in one"
    SHUFFLED = "entries out of order"
    PART = "a part of it"
    BY_RECEPTION = "judged by times of reception"


def draw_bag(chance: Random, run: Sequence[Observation]) -> Bag:
    """A bag of ``run`` with one or two flaws."""
    flaws = chance.sample(list(Flaw), chance.choice((1, 1, 2)))
    bag = Bag(seed=chance.randrange(10**6))
    sources = sorted({one.source for one in run}) or [""]
    channels = sorted({one.channel for one in run}) or ["/none"]
    for flaw in flaws:
        bag = _with(bag, flaw, chance, sources, channels)
    clocks = tuple(_as_long_as_shows(clock, run) for clock in bag.clocks)
    bag = msgspec.structs.replace(bag, clocks=clocks)
    if bag.stood_still[1] and (bag.clocks or bag.unset or bag.time):
        # where stamps are given up, how long something took is known by the times of reception only
        return msgspec.structs.replace(bag, stood_still=(0.0, 0.0))
    return bag


def _as_long_as_shows(clock: BagClock, run: Sequence[Observation]) -> BagClock:
    """``clock``, off for a while in which its node does two things at least, or from then on (decision 54)."""
    begin_ns = START_NS + round(clock.at_s * NS)
    own = [
        it.stamp_ns
        for it in run
        if clock.source in ("", it.source) and _is_told(it) and "response" not in it.kind
    ]
    left = sorted(stamp_ns for stamp_ns in own if stamp_ns >= begin_ns)
    if not clock.for_s or len(left) < 2:
        return msgspec.structs.replace(clock, for_s=0.0)
    least_s = (left[1] - begin_ns) / NS + 0.001
    return msgspec.structs.replace(clock, for_s=round(max(clock.for_s, least_s), 3))


def _with(
    bag: Bag, flaw: Flaw, chance: Random, sources: Sequence[str], channels: Sequence[str]
) -> Bag:
    replace = msgspec.structs.replace
    source, at_s = chance.choice(sources), round(chance.uniform(0.5, 7.0), 3)
    by_s = chance.choice(
        (-3600.0, -5.0, -0.9, -0.3, -0.08, 0.03, 0.09, 0.15, 0.3, 0.9, 5.0, 3600.0)
    )
    clocks = {
        Flaw.OFF: BagClock(source, by_s),
        Flaw.ALL_OFF: BagClock("", by_s),
        Flaw.SET: BagClock(source, by_s, at_s),
        Flaw.FOR_A_WHILE: BagClock(source, by_s, at_s, chance.choice((1.0, 3.0))),
        Flaw.SLOW: BagClock(source, drift=chance.choice((-0.3, -0.1, -0.02, 0.004))),
    }
    match flaw:
        case Flaw.UNSET:
            return replace(bag, unset=chance.choice((0.1, 1.0)))
        case Flaw.STOOD_STILL:
            return replace(bag, stood_still=(at_s, chance.choice((0.3, 1.0, 3.0))))
        case Flaw.LATE:
            latched = tuple(sorted(chance.sample(channels, chance.randint(0, len(channels)))))
            return replace(bag, begins_s=at_s, latched=latched)
        case Flaw.SHORT:
            return replace(bag, ends_s=round(at_s + 1.0, 3))
        case Flaw.LEFT_OUT:
            return replace(bag, left_out=(*bag.left_out, chance.choice(channels)))
        case Flaw.AGAIN:
            return replace(bag, again=True, is_same=bag.seed % 2 == 0)
        case Flaw.SHUFFLED:
            return replace(bag, shuffled=chance.choice((0.01, 0.5, 3.0)))
        case Flaw.PART:
            to_s = chance.choice((0.0, round(at_s + 2.0, 3)))
            return replace(bag, from_s=chance.choice((0.0, at_s)), to_s=to_s)
        case Flaw.BY_RECEPTION:
            return replace(bag, time="log")
        case Flaw.NONE:
            return bag
    return replace(bag, clocks=(*bag.clocks, clocks[flaw]))


def simpler(bag: Bag) -> list[Bag]:
    """The same with less wrong, for a shrinker."""
    usual = Bag(seed=bag.seed)
    names = [name for name in Bag.__struct_fields__ if getattr(bag, name) != getattr(usual, name)]
    return [msgspec.structs.replace(bag, **{name: getattr(usual, name)}) for name in names]
