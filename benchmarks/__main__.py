"""Every benchmark, and the pages of their figures.

``python -m benchmarks [NAME …] [--page FILE …]`` runs each module of this folder and puts its
figures between the markers of a page ``<!-- begin NAME -->`` and ``<!-- end NAME -->``. Exit code 1 if one of
them fails; what it said is shown.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import msgspec

from benchmarks.page import TOLD_TO, Row, as_markdown, page_with, put

HERE = Path(__file__).parent
PAGES = tuple(
    HERE.parent / "docs" / page
    for page in ("performance.md", "performance-monitors.md", "fleet.md")
)
NO_BENCHMARKS = ("__main__", "copies", "family", "page", "processes", "sampling", "ticking")


def names() -> list[str]:
    """Of all benchmarks."""
    return sorted(path.stem for path in HERE.glob("*.py") if path.stem not in NO_BENCHMARKS)


def run(name: str, arguments: Sequence[str] = ()) -> tuple[list[Row], bool]:
    """Run one benchmark, its output shown; its rows, and whether it went well."""
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / "rows.json"
        command = [sys.executable, "-m", f"benchmarks.{name}", *arguments]
        told = {**os.environ, TOLD_TO: str(path)}
        done = subprocess.run(command, cwd=HERE.parent, env=told, check=False)
        rows = msgspec.json.decode(path.read_bytes(), type=list[Row]) if path.exists() else []
    return rows, done.returncode == 0


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description="Run every benchmark and rewrite the pages of their figures.",
        epilog="example: python -m benchmarks tick tap",
    )
    parser.add_argument("name", nargs="*", help="only these")
    parser.add_argument("--page", type=Path, nargs="+", default=PAGES, help="pages with markers")
    chosen = parser.parse_args(arguments)
    unknown = sorted(set(chosen.name) - set(names()))
    if unknown:
        print(f"error: no benchmark {unknown[0]}; there are {', '.join(names())}", file=sys.stderr)
        return 2
    failed = []
    for name in chosen.name or names():
        print(f"== {name}", flush=True)
        load = os.getloadavg()[0]
        rows, went_well = run(name)
        if not went_well:
            failed.append(f"{name} did not go to its end")
            continue
        if not rows:
            print(f"{name} told no figures for the page")
            continue
        day = time.strftime("%Y-%m-%d", time.gmtime())
        said = f"`python -m benchmarks {name}`, {day}; load {load:.2f}"
        try:
            # read anew each time: somebody may edit a page meanwhile
            texts = {page: page.read_text(encoding="utf-8") for page in chosen.page}
            page = page_with(texts, name)
            text = put(texts[page], name, as_markdown(rows, said))
        except ValueError as error:
            failed.append(f"{name}: {error}")
            continue
        except OSError as error:
            print(f"error: {error.filename}: {error.strerror}", file=sys.stderr)
            return 2
        page.write_text(text, encoding="utf-8")
    for what in failed:
        print(f"error: {what}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
