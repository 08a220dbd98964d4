"""What a campaign found is mended: each case in ``regressions.jsonl`` was wrong once."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from tests.campaign.circumstances import Circumstances
from tests.campaign.shrink import Case, run
from tests.campaign.systems import Trait

pytestmark = pytest.mark.slow


class Regression(msgspec.Struct):
    """A case as the campaign printed it."""

    seed: int
    size: int
    made: Circumstances
    less: tuple[int, ...] = ()
    traits: tuple[Trait, ...] = ()


LONG = frozenset({1320065, 1000387})
"""Half a minute each."""
REGRESSIONS = [
    msgspec.json.decode(line, type=Regression)
    for line in Path(__file__).with_name("regressions.jsonl").read_text().splitlines()
]


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, id=str(case.seed), marks=[pytest.mark.soak] * (case.seed in LONG))
        for case in REGRESSIONS
    ],
)
def test_what_was_wrong_once_is_not(case: Regression) -> None:
    again = Case(case.seed, case.size, case.made, case.less, case.traits)
    assert run(again).failures == ()
