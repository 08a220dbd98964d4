"""What is true of properties: the monitor's rule of when they begin, on everything that happened."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from moon.properties.files import parse_properties
from tests.campaign.truth import TrueProperties
from transports.interface import Observation, ObservationKind
from transports.simulated.world import START_NS

FOUND_NS = START_NS + 200_000_000
END_NS = START_NS + 4 * 10**9


def _at(seconds: float) -> Observation:
    stamp_ns = START_NS + round(seconds * 1e9)
    return Observation(
        stamp_ns=stamp_ns,
        received_ns=stamp_ns,
        channel="/beat",
        kind=ObservationKind.MESSAGE,
        type_name="",
        data={},
        source="Part0",
    )


def _is_broken(body: str, seconds: Sequence[float]) -> int:
    text = f"ports:\n  beat: {{topic: /beat}}\nproperties:\n  - {{id: p, {body}}}\n"
    true = TrueProperties(parse_properties(text, "properties.yaml"))
    return true.of([_at(one) for one in seconds], END_NS, FOUND_NS)["p"].is_broken


@pytest.mark.parametrize("pattern", ["recurrence", "existence"])
@pytest.mark.parametrize(
    ("seconds", "broken_s"),
    [
        ((1.1, 2.0, 3.0, 3.9), None),  # in time for a monitor that found the nodes
        ((0.1, 1.1, 2.1, 3.1), None),
        ((1.3, 2.0, 3.0, 3.9), 1.2),
        ((), 1.2),
    ],
)
def test_what_is_due_in_time_is_due_once_the_nodes_were_found(
    pattern: str, seconds: Sequence[float], broken_s: float | None
) -> None:
    broken_ns = _is_broken(f"pattern: {pattern}, of: beat, within: 1 s", seconds)
    assert broken_ns == (0 if broken_s is None else START_NS + round(broken_s * 1e9))


def test_what_recurs_begins_with_its_first_occurrence() -> None:
    assert _is_broken("pattern: recurrence, of: beat, within: 1 s", (0.1, 1.15, 2.1, 3.1))


def test_what_a_scope_begins_waits_for_no_node() -> None:
    body = "pattern: recurrence, of: beat, within: 1 s, before: beat"
    assert _is_broken(body, (1.1, 2.0, 3.0, 3.9)) < START_NS + 1_100_000_000
