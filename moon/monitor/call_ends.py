"""What one end of a call shows that the other end did, where that was not received.

Where each node numbers each channel for itself (ROS 2), the last report of a node before its silence can be
lost without a number that shows it. The other end of the call does: who received a response shows that one
was sent.
"""

from __future__ import annotations

from collections.abc import Iterator

from moon.judge import Gap
from transports.bounded import BoundedDict
from transports.interface import CLIENT_END, Observation, ObservationKind

MOST_CALLS = 4096
"""Reports that are remembered, and places of them; their names come from the wire, and never end."""

CallEnd = tuple[str, ObservationKind, str]
"""A channel, what is reported there, and by which client; "" for a server."""
Report = tuple[CallEnd, tuple[str, int, int]]
"""Of a call, by its client, its number, and the client's life."""

_IMPLIED = {
    ObservationKind.REQUEST_RECEIVED: (ObservationKind.REQUEST_SENT,),
    ObservationKind.RESPONSE_SENT: (ObservationKind.REQUEST_RECEIVED,),
    ObservationKind.RESPONSE_RECEIVED: (
        ObservationKind.REQUEST_RECEIVED,
        ObservationKind.RESPONSE_SENT,
    ),
}
"""What was reported before by an end of which everything is received."""


class CallEnds:
    """Compares what both ends of calls report."""

    def __init__(self) -> None:
        self._reports: BoundedDict[Report, int] = BoundedDict(MOST_CALLS)
        """When each happened (ns)."""
        self._last: BoundedDict[CallEnd, int] = BoundedDict(MOST_CALLS)
        """When each place reported something last (ns)."""
        self._implied: BoundedDict[Report, int] = BoundedDict(MOST_CALLS)
        """What is not reported, and happened by then (ns)."""

    def take(self, seen: Observation) -> None:
        """``seen`` was received. A call that failed shows nothing of its other end.

        Who numbers all that it does needs no other end; what has no number is taken for whole.
        """
        if seen.kind is ObservationKind.MESSAGE or not seen.client:
            return
        if seen.order >= 0 or seen.sequence < 0:
            return
        report = _report(seen, seen.kind)
        self._reports[report] = seen.stamp_ns
        self._implied.pop(report, None)
        self._last[report[0]] = max(self._last.get(report[0], 0), seen.stamp_ns)
        for kind in () if seen.error else _IMPLIED.get(seen.kind, ()):
            implied = _report(seen, kind)
            if implied not in self._reports and implied[0] in self._last:
                self._implied[implied] = seen.stamp_ns

    def lost(self, gap: Gap) -> None:
        """What is missing of a place is missing in ``gap``: it is known where, and not before that."""
        if gap.kind is None:
            return
        place = (gap.channel, gap.kind, gap.source if gap.kind in CLIENT_END else "")
        if place in self._last:
            self._last[place] = max(self._last[place], gap.from_ns)

    def missing(self, known_ns: int) -> Iterator[tuple[str, int, int]]:
        """What is missing of all that happened until ``known_ns`` (ns), which was received or is lost.

        Returns:
            A channel, and between which stamps something of it is missing: each once.
        """
        for report, until_ns in tuple(self._implied.items()):
            if until_ns > known_ns:
                continue
            del self._implied[report]
            (channel, _, _), call = report
            last_ns = self._last.get(report[0], until_ns)
            if last_ns < until_ns:  # else numbers show it
                asked = (channel, ObservationKind.REQUEST_SENT, call[0]), call
                yield channel, max(last_ns, self._reports.get(asked, 0)) + 1, until_ns + 1

    def clear(self) -> None:
        """Stamps begin elsewhere."""
        self._reports.clear()
        self._last.clear()
        self._implied.clear()


def _report(seen: Observation, kind: ObservationKind) -> Report:
    client = seen.client if kind in CLIENT_END else ""
    return (seen.channel, kind, client), (seen.client, seen.call, seen.client_life)
