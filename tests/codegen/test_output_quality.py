"""Generated code is code one would have written: formatted, clean, and typed under the strict rules."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from m2c.codegen.package import system_files
from m2c.codegen.writer import write_files
from m2c.model import DiagnosticLog, load

ROOT = Path(__file__).parents[2]
SYSTEM = ROOT / "examples" / "lab_tour" / "system.xml"
POLICY = "lab_tour_policy"
UNTYPED = "".join(
    f"[mypy-{name}.*]\nignore_missing_imports = True\n" for name in ("esprima", "behaviortreepy")
)

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def generated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    system = load([SYSTEM], DiagnosticLog())
    assert system is not None
    folder = tmp_path_factory.mktemp("quality") / "generated"
    write_files(system_files(system), folder)
    return folder


def run(*arguments: str, **environment: str) -> None:
    """``python -m …`` succeeds; its findings are the failure's message."""
    done = subprocess.run(
        [sys.executable, "-m", *arguments],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **environment},
    )
    assert done.returncode == 0, done.stdout + done.stderr


def strictly_typed(generated: Path, packages: list[Path]) -> None:
    configuration = generated.parent / "mypy.ini"
    configuration.write_text(f"[mypy]\n{UNTYPED}")
    cache = str(generated.parent / "mypy_cache")
    chosen = [part for package in packages for part in ("-p", package.name)]
    path = os.pathsep.join(map(str, [ROOT, *packages]))
    run("mypy", "--strict", "--config-file", str(configuration), "--cache-dir", cache, *chosen, MYPYPATH=path)  # fmt: skip


def test_the_generated_code_is_formatted(generated: Path) -> None:
    run("ruff", "format", "--isolated", "--line-length", "100", "--check", str(generated))


def test_the_generated_code_is_clean(generated: Path) -> None:
    rules = ["--line-length", "100", "--select", "E,F,UP,B"]
    run("ruff", "check", "--isolated", "--no-cache", *rules, str(generated))


def test_the_generated_nodes_are_strictly_typed(generated: Path) -> None:
    folders = [path for path in generated.iterdir() if path.is_dir() and path.name != POLICY]
    assert len(folders) == 17
    strictly_typed(generated, sorted(folders))


def test_the_generated_policy_is_strictly_typed(generated: Path) -> None:
    strictly_typed(generated, [generated / POLICY])
