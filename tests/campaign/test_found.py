"""What a campaign found is mended: each case in ``found.jsonl`` was wrong once."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from tests.campaign.circumstances import Circumstances
from tests.campaign.shrink import Case, run

pytestmark = pytest.mark.slow


class Found(msgspec.Struct):
    """A case as the campaign printed it."""

    seed: int
    size: int
    made: Circumstances
    less: tuple[int, ...] = ()


FOUND = [
    msgspec.json.decode(line, type=Found)
    for line in Path(__file__).with_name("found.jsonl").read_text().splitlines()
]


@pytest.mark.parametrize("found", FOUND, ids=lambda found: str(found.seed))
def test_what_was_wrong_once_is_not(found: Found) -> None:
    assert run(Case(found.seed, found.size, found.made, found.less)).failures == ()
