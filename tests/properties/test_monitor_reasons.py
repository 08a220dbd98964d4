"""Why a property is inconclusive, in words that say what would settle it."""

from __future__ import annotations

from pathlib import Path

import pytest

from moon.properties import PropertySet, load_properties
from transports.interface import Observation, ObservationKind

FILE = """
ports:
  left: {{topic: /left, field: data{initial}}}
  began: {{topic: /began}}
  ended: {{topic: /ended}}
properties:
  - {{id: P, pattern: absence, of: left < 0, between: [began, ended]}}
"""


@pytest.mark.parametrize(
    ("initial", "status", "reason"),
    [
        (
            "",
            "inconclusive",
            "what `left < 0` was before its first message is not known; an initial value of its port says it",
        ),
        (", initial: 1", "true so far", ""),
    ],
)
def test_a_state_without_a_value_is_told_what_would_give_it_one(
    tmp_path: Path, initial: str, status: str, reason: str
) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(FILE.format(initial=initial))
    properties = PropertySet(load_properties(path))
    for second, channel in enumerate(("/began", "/left", "/ended"), 1):
        properties.observe(
            Observation(
                stamp_ns=second * 10**9,
                received_ns=second * 10**9,
                channel=channel,
                kind=ObservationKind.MESSAGE,
                type_name="t/msg/T",
                data={"data": 5},
                source="robot",
            )
        )
    properties.advance(10 * 10**9)
    verdict = properties.verdicts()["P"]
    assert (verdict.status, verdict.reason) == (status, reason)
