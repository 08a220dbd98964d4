"""Whatever the check accepts runs, and no text of a model becomes code, whatever the text."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, seed, settings

from tests.hostile.importing import import_all
from tests.hostile.judging import Accepted, Refused, judge
from tests.hostile.models import SHAPES, Case, cases, slots_of

pytestmark = pytest.mark.slow

EXAMPLES = 20
BLOCKS = 2
LEAST_ACCEPTED = 0.8
"""A net whose models the check refuses catches nothing."""

SETTINGS = settings(
    max_examples=EXAMPLES,
    deadline=None,
    database=None,
    phases=[Phase.generate],  # ``tests.hostile.soak --seed N`` makes what fails small, in minutes
    report_multiple_bugs=False,
    suppress_health_check=list(HealthCheck),
)


@pytest.mark.parametrize("block", range(BLOCKS))
def test_what_the_check_accepts_is_generated_imported_and_runs_as_its_model_says(
    block: int, tmp_path: Path
) -> None:
    accepted: list[Accepted] = []
    refused: list[Refused] = []

    @seed(block)
    @SETTINGS
    @given(case=cases())
    def judged(case: Case) -> None:
        found = judge(case)
        if isinstance(found, Accepted):
            accepted.append(found)
        else:
            refused.append(found)

    judged()
    assert len(accepted) >= LEAST_ACCEPTED * (len(accepted) + len(refused))
    import_all(accepted, tmp_path)


@pytest.mark.parametrize("shape", SHAPES)
def test_a_harmless_system_of_every_shape_is_accepted_and_runs(
    shape: tuple[str, ...], tmp_path: Path
) -> None:
    found = judge(Case(shape, {}))
    assert isinstance(found, Accepted)
    import_all([found], tmp_path)


@pytest.mark.parametrize("shape", SHAPES)
def test_every_slot_of_a_shape_reaches_what_is_written(shape: tuple[str, ...]) -> None:
    plain = Case(shape, {}).files()
    for slot in slots_of(shape):
        text = {"type": "Yy", "constant": "YY"}.get(slot.kind, "yy")
        assert Case(shape, {slot.name: text}).files() != plain, slot
