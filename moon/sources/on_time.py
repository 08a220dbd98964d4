"""What was recorded, as a monitor that was never late would have received it.

A recorder that stood still for a second, as the processor was busy elsewhere, received a second's worth
of events afterwards. A monitor knows when it stands still, and its turns are in its recording; any other
recording has none, and played as it was received it would have silences in which nothing came that was
owed. But it is all there: what was received late is moved to where it would have been received.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator
from itertools import chain

from msgspec.structs import replace

from moon.feed.clock import SET_NS
from moon.recording.entries import Began, Entry, Pulse, set_by_ns
from transports.interface import Observation

USUAL_NS = 50_000_000
"""An event is received within this time of its stamp, if nothing is the matter: a quarter of the latency
bound."""
LATEST_NS = 10_000_000_000
"""What is later than this was not late: clocks differ."""
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
    for number, entry in enumerate(source):
        is_set_back = entry.received_ns < newest_ns - LATEST_NS
        if type(entry) is Pulse:
            is_set_back = is_set_back or set_by_ns(looked, entry) < -SET_NS
            looked = entry
        if is_set_back:
            while held:
                yield heapq.heappop(held)[2]
            newest_ns = entry.received_ns
        newest_ns = max(newest_ns, entry.received_ns)
        moved = _moved(entry, lags)
        heapq.heappush(held, (moved.received_ns, number, moved))
        while held and (held[0][0] <= newest_ns - LATEST_NS or len(held) > MAX_HELD):
            yield heapq.heappop(held)[2]
    while held:
        yield heapq.heappop(held)[2]


def _moved(entry: Entry, lags: dict[str, int]) -> Entry:
    """``entry``, not later than usual: as late as what came last of its source and was not.

    Args:
        entry: as it was received.
        lags: how late that was, by source (ns).
    """
    if not isinstance(entry, Observation):
        return entry
    late_ns = entry.received_ns - entry.stamp_ns
    if USUAL_NS < late_ns <= LATEST_NS:
        return replace(entry, received_ns=entry.stamp_ns + lags.get(entry.source, USUAL_NS))
    if 0 <= late_ns <= USUAL_NS:
        lags[entry.source] = late_ns
    return entry
