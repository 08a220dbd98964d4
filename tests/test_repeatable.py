"""The suite gives the same answer twice; the soak tries something else each time, and says what."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.soak import main, soak, steps

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]

DRAWN = """
from hypothesis import given, strategies

@given(strategies.lists(strategies.integers(0, 10**9), min_size=5, max_size=5))
def test_drawn(numbers):
    print("drawn", numbers)
    assert sum(numbers) % 97 != 3
"""
"""It fails for one list in 97: which one is found first is chance, unless it is not."""


def run(path: Path, *options: str) -> str:
    """With ``CI`` set, where hypothesis has settings of its own: the suite's count there, too."""
    done = subprocess.run(
        [
            *(sys.executable, "-m", "pytest", "-n", "0", "-p", "no:cacheprovider"),
            *("-p", "tests.conftest", "-c", ROOT / "pyproject.toml", "--rootdir", path.parent),
            *(path, *options),
        ],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
        cwd=ROOT,
        env=os.environ | {"CI": "true"},
    )
    assert done.returncode in (0, 1), done.stdout + done.stderr
    return done.stdout


def drawn(output: str) -> list[str]:
    return re.findall(r"^drawn .*$", output, re.MULTILINE)


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("drawn") / "test_case.py"
    path.write_text(DRAWN)
    return path


@pytest.fixture(scope="module")
def of_the_suite(case: Path) -> list[str]:
    return drawn(run(case, "-s"))


def test_the_suite_draws_the_same_examples_every_time(case: Path, of_the_suite: list[str]) -> None:
    assert len(of_the_suite) > 50
    assert drawn(run(case, "-s")) == of_the_suite


def test_a_seed_draws_others_and_what_it_finds_is_repeated_by_the_command_that_is_shown(
    case: Path, of_the_suite: list[str]
) -> None:
    options = ["--hypothesis-profile", "soak", "--hypothesis-seed", "7"]
    first = run(case, "-s", *options)
    assert drawn(first) != of_the_suite
    (shown,) = re.findall(r"^this repeats it: pytest (.*)$", first, re.MULTILINE)
    assert shown == f"test_case.py::test_drawn {' '.join(options)}"
    assert drawn(run(case, "-s", *options)) == drawn(first)


def test_a_step_of_the_soak_that_fails_is_shown_and_the_others_go_on(
    capfd: pytest.CaptureFixture[str],
) -> None:
    fails, works = ["-c", "raise SystemExit(3)"], ["-c", "print('done')"]
    typed = "python -c 'raise SystemExit(3)'"
    assert soak([fails, works]) == [typed]
    said = capfd.readouterr().out
    assert f"--- failed; this repeats it: {typed}\n" in said
    assert said.endswith("done\n")


def test_all_that_the_soak_draws_is_drawn_from_its_seed() -> None:
    unseeded = (
        "examples/lab_tour/faults/run.py",
        "tests.transports.ros2_soak",
        "tests.launch.busy_ros2",
        "soak",
    )
    for one, other in zip(steps(1), steps(2), strict=True):
        assert one != other or any(name in one for name in unseeded)
    with pytest.raises(SystemExit):
        main(["--help"])
