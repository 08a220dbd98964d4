"""Some random systems and circumstances: nothing that is said is wrong, and enough is said.

What takes hours is ``make soak``'s: ``python -m tests.campaign --seeds FROM:TO``.
"""

from __future__ import annotations

import pytest

from tests.campaign.__main__ import Summary, cases

SEEDS = (0, 5, 7, 9)
EACH = 3


@pytest.mark.parametrize("seed", SEEDS)
def test_nothing_that_is_said_is_wrong(seed: int) -> None:
    summary, wrong = Summary(), []
    for tried in cases(seed, EACH):
        summary.take(tried.result)
        wrong += [
            f"{failure.fault}: {failure.about}: {failure.text}\n  again: {tried.case.command()}"
            for failure in tried.result.failures
        ]
    assert not wrong, "\n".join(wrong)
    assert summary.judged > summary.trials
