"""Generated Python as ruff writes it: imports sorted, those that nothing uses dropped, lines broken."""

from __future__ import annotations

import re
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path, PurePosixPath

from ruff import find_ruff_bin

_SETTINGS = (
    *("--isolated", "--no-cache", "--quiet", "--force-exclude", "--line-length", "100"),
    *("--target-version", "py311", "--config", "exclude=[]"),
)
_STEPS = (
    ("check", *_SETTINGS, "--fix-only", "--select", "F401,I001"),
    ("format", *_SETTINGS, "--config", "format.skip-magic-trailing-comma=true"),
)


class NotPythonError(Exception):
    """The text of ``file`` is not Python; ``line`` and ``what`` say where and why."""

    def __init__(self, file: str, line: int, what: str) -> None:
        super().__init__(f"{file}:{line}: {what}")
        self.file = file
        self.line = line
        self.what = what


def formatted(files: Mapping[str, str]) -> dict[str, str]:
    """``files`` (name → text) with every ``.py`` among them formatted.

    Raises:
        NotPythonError: one is not Python.
    """
    sources = [name for name in files if name.endswith(".py")]
    for name in sources:
        try:
            compile(files[name], name, "exec", dont_inherit=True)
        except (SyntaxError, ValueError) as error:
            line = error.lineno or 0 if isinstance(error, SyntaxError) else 0
            what = error.msg if isinstance(error, SyntaxError) else str(error)
            raise NotPythonError(name, line, what) from error
    if not sources:
        return dict(files)
    with tempfile.TemporaryDirectory(prefix="m2c-") as folder:
        # a folder of its own for each: nothing in a name of a model is a path here
        paths = {
            name: Path(folder, str(n), PurePosixPath(name).name) for n, name in enumerate(sources)
        }
        for name, path in paths.items():
            path.parent.mkdir()
            path.write_text(files[name], encoding="utf-8")
        for step in _STEPS:
            # within the folder: where ruff runs, what it finds there counts as the project's own
            ran = subprocess.run(
                [find_ruff_bin(), *step, "."],
                cwd=folder,
                capture_output=True,
                text=True,
                check=False,
            )
            if ran.returncode:
                of = re.search(r"\b([0-9]+)/", ran.stderr)
                file = sources[int(of[1])] if of is not None else sources[0]
                raise NotPythonError(file, 0, f"ruff says: {ran.stderr.strip()}")
        done = {name: path.read_text(encoding="utf-8") for name, path in paths.items()}
    return {name: done.get(name, text) for name, text in files.items()}
