"""What generated code is held to: formatted, and typed under mypy's strict rules."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
UNTYPED = ("esprima", "behaviortreepy", "ruff")
"""Libraries of m2c's, which generated code imports, without types."""
CACHE = str(ROOT / "build" / "mypy-generated")
"""What mypy knows of the project's own modules serves all tests."""


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


def formatted(generated: Path) -> None:
    """Ruff would leave it as it is."""
    run("ruff", "format", "--isolated", "--line-length", "100", "--check", str(generated))


def strictly_typed(generated: Path, packages: list[Path]) -> None:
    """``mypy --strict`` finds nothing in these packages of what was generated."""
    chosen = [part for package in packages for part in ("-p", package.name)]
    typed(generated.parent, chosen, [ROOT, *packages])


def typed(scratch: Path, chosen: list[str], path: list[Path]) -> None:
    """``mypy --strict`` finds nothing in what is ``chosen``, whose modules are found in ``path``."""
    configuration = scratch / "mypy.ini"
    sections = (f"[mypy-{name}.*]\nignore_missing_imports = True\n" for name in UNTYPED)
    configuration.write_text("[mypy]\n" + "".join(sections))
    run(
        *("mypy", "--strict", "--config-file", str(configuration), "--cache-dir", CACHE, *chosen),
        MYPYPATH=os.pathsep.join(map(str, path)),
    )
