"""What one end of a call shows that the other end did."""

from __future__ import annotations

import pytest

from moon.judge import Gap
from moon.monitor.call_ends import CallEnds
from transports.interface import Observation, ObservationKind

MS = 1_000_000


def report(kind: ObservationKind, at_ms: int, call: int) -> Observation:
    source = "Client" if kind is ObservationKind.REQUEST_SENT else "Server"
    return Observation(
        stamp_ns=at_ms * MS, received_ns=at_ms * MS, channel="/ask", kind=kind, type_name="", data={},
        source=source, client="Client", call=call, sequence=call,
    )  # fmt: skip


def called_once() -> CallEnds:
    """After a call of which all was reported but that its response was received."""
    ends = CallEnds()
    for kind in (
        ObservationKind.REQUEST_SENT,
        ObservationKind.REQUEST_RECEIVED,
        ObservationKind.RESPONSE_SENT,
    ):
        ends.take(report(kind, 20, 1))
    return ends


@pytest.mark.parametrize(("knows_request", "from_ms"), [(True, 400), (False, 20)])
def test_what_is_missing_of_a_call_happened_after_it_was_asked(
    knows_request: bool, from_ms: int
) -> None:
    ends = called_once()
    if knows_request:
        ends.take(report(ObservationKind.REQUEST_SENT, 400, 2))
    ends.take(report(ObservationKind.RESPONSE_SENT, 500, 2))
    missing = list(ends.missing(1000 * MS))
    assert missing == [("/ask", from_ms * MS + 1, 500 * MS + 1)]
    assert list(ends.missing(1000 * MS)) == []


def test_what_is_missing_where_a_gap_is_known_is_missing_there() -> None:
    """A request that was received and not judged, as two nodes had the client's name, is not missing before."""
    ends = called_once()
    asked = ObservationKind.REQUEST_SENT
    ends.lost(Gap("/ask", "Client", 450 * MS, 510 * MS, "several claim to be Client", asked))
    ends.take(report(ObservationKind.REQUEST_RECEIVED, 500, 2))
    assert list(ends.missing(1000 * MS)) == [("/ask", 450 * MS + 1, 500 * MS + 1)]
