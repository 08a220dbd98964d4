"""Generated files are reproducible, and an edit is never lost."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from m2c.codegen.package import system_files
from m2c.codegen.writer import EditedFilesError, is_edited, sealed, write_files
from m2c.model import DiagnosticLog, load

SYSTEM = Path(__file__).parents[2] / "examples" / "lab_tour" / "system.xml"


def files() -> dict[str, str]:
    system = load([SYSTEM], DiagnosticLog())
    assert system is not None
    return system_files(system)


def test_the_whole_example_is_generated_byte_for_byte_the_same() -> None:
    assert files() == files()


def test_an_edited_file_stops_everything_and_nothing_is_written(tmp_path: Path) -> None:
    write_files({"a.py": sealed("x = 1\n"), "b.py": sealed("y = 1\n")}, tmp_path)
    edited = tmp_path / "a.py"
    edited.write_text(edited.read_text() + "# mine\n")
    before = {path.name: path.read_text() for path in tmp_path.iterdir()}
    with pytest.raises(EditedFilesError) as caught:
        write_files({"a.py": sealed("x = 2\n"), "b.py": sealed("y = 2\n")}, tmp_path)
    assert str(caught.value) == (
        "1 generated file was edited by hand and would be lost; nothing was written:\n"
        f"  {edited}\nmove the changes into the model, or use --force to overwrite them"
    )
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == before


def test_force_overwrites_an_edited_file(tmp_path: Path) -> None:
    write_files({"a.py": sealed("x = 1\n")}, tmp_path)
    (tmp_path / "a.py").write_text("mine\n")
    assert write_files({"a.py": sealed("x = 2\n")}, tmp_path, force=True) == (1, 0)
    assert not is_edited((tmp_path / "a.py").read_text())


def test_an_unchanged_file_is_not_written_again(tmp_path: Path) -> None:
    write_files({"a.py": sealed("x = 1\n")}, tmp_path)
    assert write_files({"a.py": sealed("x = 1\n")}, tmp_path) == (0, 1)


def test_code_written_twice_in_a_second_is_the_code_that_runs(tmp_path: Path) -> None:
    """Both are of one size: to Python, what it compiled of the first would be that of the second."""
    path = tmp_path / "answer.py"
    for answer in "12":
        write_files({path.name: f"print({answer})\n"}, tmp_path, force=True)
        os.utime(path, ns=(0, 0))
        done = subprocess.run(
            [sys.executable, "-c", "import answer"],
            cwd=tmp_path,
            env={**os.environ, "PYTHONDONTWRITEBYTECODE": ""},
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stdout == f"{answer}\n"
