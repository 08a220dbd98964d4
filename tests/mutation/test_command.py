"""``python -m tests.mutation``."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tests.mutation import mutants
from tests.systems import EXAMPLES, LAB_TOUR, read


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "tests.mutation", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_the_table_counts_every_mutant_of_the_system_in_a_folder() -> None:
    done = run(str(EXAMPLES / LAB_TOUR))
    assert done.returncode == 0, done.stderr
    last = done.stdout.splitlines()[-1].split()
    wanted = sum(1 for machine in read(LAB_TOUR).nodes for _ in mutants(machine))
    assert last[0] == "all"
    assert int(last[-1]) == wanted
    assert sum(map(int, last[1:-1])) == wanted


def test_every_mutant_is_listed_on_request() -> None:
    model = EXAMPLES / LAB_TOUR / "skills" / "WaitSkill.scxml"
    lines = run(str(model), "--list").stdout.splitlines()
    machine = read(LAB_TOUR).node("WaitSkill")
    assert machine is not None
    assert len(lines) == len(list(mutants(machine)))
    assert all(line.startswith(f"{model}:") for line in lines)


def test_what_is_not_a_model_is_one_message_and_exit_code_2(tmp_path: Path) -> None:
    path = tmp_path / "broken.scxml"
    path.write_text("<scxml><state></scxml>")
    done = run(str(path))
    assert done.returncode == 2
    assert done.stderr.startswith(f"{path}:1:")
    assert "Traceback" not in done.stderr
