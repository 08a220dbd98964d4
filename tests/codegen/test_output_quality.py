"""Generated code is code one would have written: formatted, clean, and typed under the strict rules."""

from __future__ import annotations

from pathlib import Path

import pytest

from m2c.codegen.package import system_files
from m2c.codegen.writer import write_files
from m2c.model import DiagnosticLog, load
from tests.codegen.quality import ROOT, formatted, run, strictly_typed

SYSTEM = ROOT / "examples" / "lab_tour" / "system.xml"
POLICY = "lab_tour_policy"

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def generated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    system = load([SYSTEM], DiagnosticLog())
    assert system is not None
    folder = tmp_path_factory.mktemp("quality") / "generated"
    write_files(system_files(system), folder)
    return folder


def test_the_generated_code_is_formatted(generated: Path) -> None:
    formatted(generated)


def test_the_generated_code_is_clean(generated: Path) -> None:
    rules = ["--line-length", "100", "--select", "E,F,UP,B"]
    run("ruff", "check", "--isolated", "--no-cache", *rules, str(generated))


def test_the_generated_nodes_are_strictly_typed(generated: Path) -> None:
    folders = [path for path in generated.iterdir() if path.is_dir() and path.name != POLICY]
    assert len(folders) == 17
    strictly_typed(generated, sorted(folders))


def test_the_generated_policy_is_strictly_typed(generated: Path) -> None:
    strictly_typed(generated, [generated / POLICY])
