"""``m2c generate`` on files somebody has edited, on files that are there already, and run twice.

``test_sealed_files.py`` tests the writer itself; here is what a person at the command line gets.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from m2c.codegen.command import generate

ROOT = Path(__file__).parents[2]
MODEL = ROOT / "examples" / "lab_tour" / "skills" / "BatteryLevelSkill.scxml"
SYSTEM = ROOT / "examples" / "lab_tour" / "system.xml"
INTERFACES = ROOT / "examples" / "lab_tour" / "interfaces"


def run(output: Path, *options: str) -> Result:
    return CliRunner().invoke(generate, [str(MODEL), "-o", str(output), *options])


def contents(folder: Path) -> dict[str, bytes]:
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


def times(folder: Path) -> dict[str, int]:
    return {str(path): path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def output(tmp_path: Path) -> Path:
    folder = tmp_path / "generated"
    done = run(folder)
    assert done.exit_code == 0, done.output
    for path in folder.rglob("*"):
        os.utime(path, (1, 1))
    return folder


def of(output: Path, name: str) -> Path:
    (found,) = output.rglob(name)
    return found


def test_an_edited_file_is_never_overwritten(output: Path) -> None:
    edited, missing = of(output, "machine.py"), of(output, "node.py")
    text = edited.read_text()
    edited.write_text(text.replace("self.percentage: int = 100", "self.percentage: int = 99"))
    assert edited.read_text() != text
    missing.unlink()
    before = contents(output)
    done = run(output)
    assert done.exit_code == 2
    assert done.stderr == (
        "error: 1 generated file was edited by hand and would be lost; nothing was written:\n"
        f"  {edited}\nmove the changes into the model, or use --force to overwrite them\n"
    )
    assert contents(output) == before
    assert not missing.exists()


def test_every_edited_file_is_named(output: Path) -> None:
    edited = sorted([of(output, "machine.py"), of(output, "node.py")])
    for path in edited:
        path.write_text(path.read_text() + "# mine\n")
    done = run(output)
    assert done.stderr.startswith("error: 2 generated files were edited by hand")
    assert [line.strip() for line in done.stderr.splitlines()[1:3]] == [str(p) for p in edited]


def test_a_file_of_somebody_elses_in_the_same_place_is_kept(output: Path) -> None:
    of(output, "machine.py").write_text("print('mine')\n")
    assert run(output).exit_code == 2
    assert of(output, "machine.py").read_text() == "print('mine')\n"


def test_a_launch_description_that_was_edited_is_not_overwritten(output: Path) -> None:
    edited = of(output, "launch.json")
    edited.write_text(edited.read_text().replace('"system": "', '"system": "my '))
    (output.parent / "other.scxml").write_text(MODEL.read_text().replace("BatteryLevel", "Other"))
    other = CliRunner().invoke(
        generate,
        [str(output.parent / "other.scxml"), "-o", str(output), "--interfaces", str(INTERFACES)],
    )
    for done in (run(output), other):
        assert done.exit_code == 2
        assert f"  {edited}\n" in done.stderr


def test_another_system_may_be_generated_into_the_same_folder(output: Path) -> None:
    for _ in range(2):
        done = CliRunner().invoke(generate, [str(SYSTEM), "-o", str(output)])
        assert done.exit_code == 0, done.output
        assert run(output).exit_code == 0
    policy = of(output, "policy.xml")
    policy.write_text(policy.read_text() + "<!-- mine -->")
    done = CliRunner().invoke(generate, [str(SYSTEM), "-o", str(output)])
    assert done.exit_code == 2
    assert f"  {policy}\n" in done.stderr


def test_the_list_of_hashes_can_be_checked_with_sha256sum(output: Path) -> None:
    subprocess.run(["sha256sum", "--check", "generated.sha256"], cwd=output, check=True)


@pytest.mark.parametrize("text", ["no list", "0  launch.json\n", "\x00\n  \n"])
def test_a_broken_list_of_hashes_overwrites_nothing_of_somebody_elses(
    output: Path, text: str
) -> None:
    (output / "generated.sha256").write_text(text)
    of(output, "launch.json").write_text("{}")
    assert run(output).exit_code == 2
    assert of(output, "launch.json").read_text() == "{}"


def test_a_file_with_other_bytes_than_text_is_an_edited_file(output: Path) -> None:
    edited = of(output, "machine.py")
    edited.write_bytes(edited.read_bytes() + b"# caf\xe9\n")
    done = run(output)
    assert done.exit_code == 2
    assert f"  {edited}\n" in done.stderr


@pytest.mark.parametrize(
    "place", ["battery_level_skill", "launch.json/more", "battery_level_skill/battery_level_skill"]
)
def test_a_place_where_nothing_can_be_written_is_one_line(tmp_path: Path, place: str) -> None:
    folder = tmp_path / "generated"
    folder.mkdir()
    blocked = folder / place
    if "more" in place:
        blocked.mkdir(parents=True)
    else:
        blocked.parent.mkdir(exist_ok=True)
        blocked.write_text("")
    done = run(folder)
    assert done.exit_code == 2
    assert done.stderr.startswith(f"error: cannot write {folder}")
    assert done.stderr.count("\n") == 1


def test_force_overwrites_it_and_nothing_else(output: Path) -> None:
    before = contents(output)
    edited = of(output, "machine.py")
    edited.write_text("mine\n")
    times_before = times(output)
    done = run(output, "--force")
    assert done.exit_code == 0, done.output
    assert contents(output) == before
    changed = {path for path, time in times(output).items() if times_before[path] != time}
    assert changed == {str(edited)}


def test_unchanged_files_are_not_written_again(output: Path) -> None:
    before = times(output)
    done = run(output)
    assert done.exit_code == 0, done.output
    counted = len(before) - 1  # the list of hashes
    assert f"(0 files written, {counted} unchanged)" in done.output
    assert times(output) == before


@pytest.mark.slow
def test_the_output_is_the_same_byte_for_byte_in_every_process(tmp_path: Path) -> None:
    # two hash seeds: an order that hangs on a set shows only across processes
    for seed in ("1", "2"):
        subprocess.run(
            [sys.executable, "-m", "m2c.cli", "generate", str(SYSTEM), "-o", str(tmp_path / seed)],
            check=True,
            capture_output=True,
            env={**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": str(ROOT)},
        )
    first = contents(tmp_path / "1")
    assert len(first) > 100
    assert first == contents(tmp_path / "2")
