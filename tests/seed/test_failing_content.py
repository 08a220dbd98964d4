"""Small cases of conditions that fail, and of events that raise one another (``../shared/cases``)."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.launch.test_simulated import code, run

CASES = Path(__file__).parents[3] / "shared" / "cases"
pytestmark = [
    pytest.mark.seed,
    pytest.mark.skipif(not CASES.is_dir(), reason="the cases are not beside the checkout"),
]


@pytest.mark.parametrize(
    ("case", "model", "fault"),
    [
        ("failed_condition", "P.scxml", "cannot read `x`"),
        ("many_raises", "P.scxml", ""),
        ("many_raises", "endless.scxml", "an endless loop"),
    ],
)
def test_a_node_whose_content_fails_lives_and_conforms(
    tmp_path: Path, case: str, model: str, fault: str
) -> None:
    folder = tmp_path / case
    folder.mkdir()
    for file in (CASES / case).iterdir():
        shutil.copyfile(file, folder / file.name)
    shutil.copyfile(CASES / case / model, folder / "P.scxml")
    made = run(folder / "sys.xml", "--monitor", "--for", 10)
    assert code(made) == 0, made.output
    assert "2 machines: 2 conforming" in made.output, made.output
    reported = [line for line in made.lines if "ERROR P: " in line]
    assert len(reported) == bool(fault)
    assert all(fault in line for line in reported)
