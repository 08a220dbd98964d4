"""Imports generated packages as a node's process does: ``python -m tests.hostile.importing FOLDER…``.

Each folder has a ``launch.json``. What cannot be imported is printed, one JSON object a line; the
exit code is then 1. A process of its own, as an import that goes wrong may leave anything behind.
"""

from __future__ import annotations

import importlib
import json
import subprocess
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path

from m2c.codegen.writer import write_files
from tests.hostile.judging import Accepted
from tests.hostile.running import no_payload_runs


def import_all(accepted: Sequence[Accepted], scratch: Path) -> None:
    """Write and import the packages of every system, in one further process.

    Raises:
        AssertionError: one cannot be imported.
    """
    folders = {}
    for number, item in enumerate(accepted):
        for packaging, files in item.files.items():
            folder = scratch / f"{number}{packaging}"
            write_files(files, folder)
            folders[str(folder)] = item.case
    done = subprocess.run(
        [sys.executable, "-B", "-m", "tests.hostile.importing", *folders],
        capture_output=True,
        text=True,
        check=False,
        cwd=Path(__file__).parents[2],
    )
    for line in done.stdout.splitlines():
        found = json.loads(line)
        raise AssertionError(f"{folders[found['folder']]!r} cannot be imported: {found['why']}")
    assert done.returncode == 0, done.stderr


def main(folders: Sequence[str]) -> int:
    """Import what is generated in ``folders``; the exit code."""
    failed = False
    for folder in folders:
        launch = json.loads((Path(folder) / "launch.json").read_text(encoding="utf-8"))
        for item in [*launch["nodes"], *filter(None, [launch["policy"]])]:
            why = _import(Path(folder) / item["path"], item["package"])
            if why:
                failed = True
                print(json.dumps({"folder": folder, "why": why}), flush=True)
    return int(failed)


def _import(path: Path, package: str) -> str:
    """Import ``package`` with its program from ``path``; what went wrong, or nothing."""
    sys.path.insert(0, str(path))
    before = set(sys.modules)
    importlib.invalidate_caches()
    try:
        with no_payload_runs():
            importlib.import_module(f"{package}.__main__")
    except Exception:  # whatever it is, it is the finding
        return traceback.format_exc()
    finally:
        sys.path.remove(str(path))
        for name in set(sys.modules) - before:
            if name.partition(".")[0] == package:
                del sys.modules[name]
    return ""


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
