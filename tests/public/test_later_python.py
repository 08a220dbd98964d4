"""What CONTRIBUTING.md says of later Pythons: m2c and moon install, and a system runs; where there is one."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
VERSIONS = ("3.12", pytest.param("3.13", marks=pytest.mark.soak))
"""The one that is promised in each run, the one after it in soak."""


def interpreter(version: str) -> str:
    """Of pyenv, whose commands are in PATH also where they run nothing, or of PATH; "" if there is none."""
    versions = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    built = [str(path) for path in sorted(versions.glob(f"{version}.*/bin/python"))]
    return "".join(built[-1:]) or shutil.which(f"python{version}") or ""


@pytest.mark.slow
@pytest.mark.timeout(900)  # pip's downloads
@pytest.mark.parametrize("version", VERSIONS)
def test_it_installs_and_runs_what_it_begins(tmp_path: Path, version: str) -> None:
    python = interpreter(version)
    if not python:
        pytest.skip(f"there is no Python {version}")

    def run(*words: object, folder: Path = tmp_path) -> str:
        done = subprocess.run(
            list(map(str, words)), cwd=folder, capture_output=True, text=True, check=False,
            env={**os.environ, "PYTHONPATH": "", "PIP_DISABLE_PIP_VERSION_CHECK": "1"},
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    source = tmp_path / "source"  # what pip builds stays out of the clone
    for part in ("m2c", "moon", "transports"):
        shutil.copytree(
            ROOT / part, source / part, ignore=shutil.ignore_patterns("*.so", "__pycache__")
        )
    for file in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / file, source / file)
    run(python, "-m", "venv", "robot")
    run("robot/bin/python", "-m", "pip", "install", "-q", source)
    m2c = tmp_path / "robot/bin/m2c"
    assert f"(Python {version}." in run(m2c, "--version")
    run(m2c, "new", "demo")
    demo = tmp_path / "demo"
    run(m2c, "check", folder=demo)
    recorded = ("--record", "run.mcap", "--monitor")
    said = run(m2c, "run", "--transport", "simulated", "--ticks", "20", *recorded, folder=demo)
    assert "0 violations" in said
    faults = ROOT / "examples/lab_tour/faults/run.py"
    said = run(tmp_path / "robot/bin/python", faults, "--transport", "simulated", "--brief")
    assert "6 of 6 found, no false alarm" in said
    run(tmp_path / "robot/bin/moon", "check", "run.mcap", "system.xml", folder=demo)
