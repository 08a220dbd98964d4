"""Some random systems and circumstances: nothing that is said is wrong, and enough is said.

What takes hours is ``make soak``'s: ``python -m tests.campaign --seeds FROM:TO``.
"""

from __future__ import annotations

import pytest

from tests.campaign.__main__ import Summary, cases

pytestmark = pytest.mark.slow

SEEDS = (*range(11), 12)
"""11 is still open (``docs/campaign.md``)."""
EACH = 3


def test_nothing_that_is_said_is_wrong_and_enough_is_said() -> None:
    summary, wrong = Summary(), []
    for tried in (tried for seed in SEEDS for tried in cases(seed, EACH)):
        summary.take(tried)
        wrong += [
            f"{failure.fault}: {failure.about}: {failure.text}\n  again: {tried.case.command()}"
            for failure in tried.result.failures
        ]
    assert not wrong, "\n".join(wrong)
    assert summary.judged > summary.trials
    assert not summary.is_too_silent, summary.table()
