"""What was recorded, as a monitor that was never late would have received it.

A recorder that stood still for a second, as the processor was busy elsewhere, received a second's worth
of events afterwards. A monitor knows when it stands still, and its turns are in its recording; any other
recording has none, and played as it was received it would have silences in which nothing came that was
owed. But it is all there: what was received late is moved to where it would have been received.

That the recorder stood still is seen by what it received next: at once, what one source sent all the while.
Anything else that is late may be late by the network, or by the clock of its host, which was set back: that
stays where it is, and is judged as a monitor judges what is late.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain

from msgspec.structs import replace

from moon.feed.clock import SET_NS
from moon.recording.entries import Began, Entry, Pulse, set_by_ns
from transports.interface import Observation

USUAL_NS = 50_000_000
"""An event is received within this time of its stamp, if nothing is the matter: a quarter of the latency
bound."""
LATEST_NS = 10_000_000_000
"""A recorder may stand still, and receive late; what is later than this was not late: clocks differ."""
MAX_HELD = 200_000
"""Entries held at once, whatever the time."""


def received_on_time(entries: Iterable[Entry]) -> Iterator[Entry]:
    """``entries``, each when it would have been received; those of a monitor as they are.

    Args:
        entries: a recording, in the order in which it was received.
    """
    source = iter(entries)
    first = next(source, None)
    if first is None:
        return iter(())
    everything = chain((first,), source)
    return everything if isinstance(first, Began) and first.paced else _moving(everything)


def _moving(source: Iterator[Entry]) -> Iterator[Entry]:
    """All of ``source``, each entry where it belongs."""
    first = next(source)
    yield first
    held: list[tuple[int, int, Entry]] = []
    newest_ns = first.received_ns
    lags: dict[str, int] = {}
    looked: Pulse | None = None
    for number, (entry, is_excused) in enumerate(_excused(source, first.received_ns)):
        is_set_back = entry.received_ns < newest_ns - LATEST_NS
        if type(entry) is Pulse:
            is_set_back = is_set_back or set_by_ns(looked, entry) < -SET_NS
            looked = entry
        if is_set_back:
            while held:
                yield heapq.heappop(held)[2]
            newest_ns = entry.received_ns
        newest_ns = max(newest_ns, entry.received_ns)
        moved = _moved(entry, lags, is_excused)
        heapq.heappush(held, (moved.received_ns, number, moved))
        while held and (held[0][0] <= newest_ns - LATEST_NS or len(held) > MAX_HELD):
            yield heapq.heappop(held)[2]
    while held:
        yield heapq.heappop(held)[2]


def _excused(source: Iterable[Entry], last_ns: int) -> Iterator[tuple[Entry, bool]]:
    """Each entry of ``source``, and whether the recorder stood still when it was to be received.

    Args:
        source: entries in the order in which they were received.
        last_ns: when the one before them was received.
    """
    still = (0, 0)  # the last time in which it stood still, from and to
    turn: list[Entry] = []  # received within USUAL_NS, after nothing was for longer
    asleep_ns = last_ns
    for entry in source:
        if turn and (
            not 0 <= entry.received_ns - turn[0].received_ns <= USUAL_NS or len(turn) > MAX_HELD
        ):
            still = _stood_still(asleep_ns, turn) or still
            yield from ((one, _falls_in(one, still)) for one in turn)
            turn = []
        if turn:
            turn.append(entry)
        elif entry.received_ns - last_ns > USUAL_NS:
            asleep_ns, turn = last_ns, [entry]
        else:
            yield entry, _falls_in(entry, still)
        last_ns = entry.received_ns
    still = _stood_still(asleep_ns, turn) or still
    yield from ((one, _falls_in(one, still)) for one in turn)


def _stood_still(asleep_ns: int, turn: Sequence[Entry]) -> tuple[int, int] | None:
    """From when to when the recorder stood still, if ``turn`` shows that it did after ``asleep_ns``.

    What one source sent in most of that time came at once. One whose clock was set back sends that in
    so short a time as it comes.
    """
    stamps: dict[str, tuple[int, int]] = {}
    for entry in turn:
        if isinstance(entry, Observation):
            low, high = stamps.get(entry.source, (entry.stamp_ns, entry.stamp_ns))
            stamps[entry.source] = min(low, entry.stamp_ns), max(high, entry.stamp_ns)
    widest_ns = max((high - low for low, high in stamps.values()), default=0)
    if not turn or widest_ns <= max(USUAL_NS, (turn[0].received_ns - asleep_ns) // 2):
        return None
    return asleep_ns, turn[0].received_ns


def _falls_in(entry: Entry, still: tuple[int, int]) -> bool:
    """Whether ``entry`` would have been received in that time (ns), had the recorder not stood still."""
    if not isinstance(entry, Observation):
        return False
    return still[0] - USUAL_NS <= entry.stamp_ns <= still[1]


def _moved(entry: Entry, lags: dict[str, int], is_excused: bool) -> Entry:
    """``entry``, not later than usual: as late as what came last of its source and was not.

    Args:
        entry: as it was received.
        lags: how late that was, by source (ns).
        is_excused: whether the recorder stood still when it was to be received.
    """
    if not isinstance(entry, Observation):
        return entry
    late_ns = entry.received_ns - entry.stamp_ns
    if is_excused and USUAL_NS < late_ns <= LATEST_NS:
        return replace(entry, received_ns=entry.stamp_ns + lags.get(entry.source, USUAL_NS))
    if 0 <= late_ns <= USUAL_NS:
        lags[entry.source] = late_ns
    return entry
