"""Two states that are published at different times: what one of them did before the other had a value."""

from __future__ import annotations

import pytest

from moon.properties.monitor import PropertySet
from moon.properties.property import Status
from transports.interface import Observation, ObservationKind

S = 1_000_000_000
PORTS = """
ports:
  a: {topic: /a, field: data}
  b: {topic: /b, field: data%s}
  done: {topic: /done}
properties:
  - {id: p, %s}
"""
SCOPED = [
    "pattern: absence, of: done, within: 0.3 s, after_until: [{rises: a > 1}, {falls: b > 1}]",
    "pattern: absence, of: done, within: 0.3 s, after_until: [{rises: a > 1}, {rises: b < 2}]",
    "pattern: absence, of: done, within: 0.3 s, after_until: [{rises: a > 1}, b < 2]",
    "pattern: bounded_existence, of: done, at_most: 0, within: 0.3 s, "
    "after_until: [{rises: a > 1}, {falls: b > 1}]",
]


def _outcomes(stated: str, first: str, b: int) -> set[Status]:
    """Of a run in which the scope begins before ``b`` is published; ``first``: what it was before."""
    properties = PropertySet.from_text(PORTS % (first, stated))
    found = set()
    trace = [(0.5, "/a", 0), (1.0, "/a", 3), (2.0, "/b", b), (3.0, "/a", 0), (4.0, "/a", 3)]
    for at_s, channel, value in [*trace, (4.1, "/done", 0)]:
        stamp = int(at_s * S)
        changes = properties.observe(
            Observation(
                stamp_ns=stamp,
                received_ns=stamp,
                channel=channel,
                kind=ObservationKind.MESSAGE,
                type_name="",
                data={"data": value},
                source="node",
            )
        )
        found |= {verdict.status for _, verdict in changes}
    return found


@pytest.mark.parametrize("stated", SCOPED)
@pytest.mark.parametrize("b", [3, 0])
def test_nothing_is_violated_that_is_not_whatever_a_state_was_before(stated: str, b: int) -> None:
    known = [_outcomes(stated, f", initial: {value}", b) for value in (0, 3)]
    is_certain = all(Status.FALSE in found for found in known)
    assert is_certain or Status.FALSE not in _outcomes(stated, "", b)
