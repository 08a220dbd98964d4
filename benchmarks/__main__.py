"""Every benchmark, and the page of their figures.

``python -m benchmarks [NAME …] [--page docs/performance.md]`` runs each script of this folder and puts its
figures between the page's markers ``<!-- begin NAME -->`` and ``<!-- end NAME -->``. Exit code 1 if one of
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

HERE = Path(__file__).parent
PAGE = HERE.parent / "docs/performance.md"
sys.path.insert(0, str(HERE))  # the benchmarks are scripts, which find each other there

from row import TOLD_TO, Row  # noqa: E402

NO_BENCHMARKS = ("__main__", "loopback", "row")
HEADER = ("", "ours", "peer", "ratio", "target", "")


def names() -> list[str]:
    """Of all benchmarks."""
    return sorted(path.stem for path in HERE.glob("*.py") if path.stem not in NO_BENCHMARKS)


def run(name: str, arguments: Sequence[str] = ()) -> tuple[list[Row], bool]:
    """Run one benchmark, its output shown; its rows, and whether it went well."""
    with tempfile.TemporaryDirectory() as scratch:
        path = Path(scratch) / "rows.json"
        command = [sys.executable, str(HERE / f"{name}.py"), *arguments]
        done = subprocess.run(command, env={**os.environ, TOLD_TO: str(path)}, check=False)
        rows = msgspec.json.decode(path.read_bytes(), type=list[Row]) if path.exists() else []
    return rows, done.returncode == 0


def as_markdown(rows: Sequence[Row], said: str) -> str:
    """A table of ``rows``; ``said`` stands below it."""
    lines = [f"| {' | '.join(HEADER)} |", "|" + "---|" * len(HEADER), *map(_line, rows)]
    return "\n".join([*lines, "", said])


def _line(row: Row) -> str:
    theirs = f"{row.peer} {_number(row.theirs, row.unit)}" if row.theirs is not None else row.peer
    ratio = "" if row.ratio is None else f"{row.ratio:.2f}"
    target = _target(row)
    met = {None: "", True: "reached", False: "**not reached**"}[row.is_met]
    cells = (row.what, _number(row.value, row.unit), theirs, ratio, target, met)
    return f"| {' | '.join(cells)} |"


def _number(value: float, unit: str) -> str:
    digits = 0 if abs(value) >= 100 or value == int(value) else 1 if abs(value) >= 10 else 2
    return f"{value:,.{digits}f} {unit}".rstrip()


def _target(row: Row) -> str:
    limit = row.most if row.most is not None else row.least
    if limit is None:
        return ""
    is_ratio = row.ratio is not None and not row.is_of_value
    shown = f"{limit:.2f}" if is_ratio else _number(limit, row.unit)
    return f"{'≤' if row.most is not None else '≥'} {shown}"


def put(text: str, name: str, content: str) -> str:
    """``text`` with ``content`` between the markers of ``name``.

    Raises:
        ValueError: they are not there.
    """
    first, last = f"<!-- begin {name} -->", f"<!-- end {name} -->"
    head, begun, rest = text.partition(first)
    _, ended, tail = rest.partition(last)
    if not begun or not ended:
        raise ValueError(f"the page has no {first} … {last}")
    return f"{head}{first}\n{content}\n{last}{tail}"


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description="Run every benchmark and rewrite the page of their figures.",
        epilog="example: python -m benchmarks tick tap",
    )
    parser.add_argument("name", nargs="*", help="only these")
    parser.add_argument("--page", type=Path, default=PAGE)
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
        said = f"`python -m benchmarks {name}`, {day}; load average before it {load:.2f}."
        try:
            # read anew each time: somebody may edit the page meanwhile
            text = put(chosen.page.read_text(encoding="utf-8"), name, as_markdown(rows, said))
        except ValueError as error:
            failed.append(f"{name}: {error}")
            continue
        except OSError as error:
            print(f"error: {chosen.page}: {error.strerror}", file=sys.stderr)
            return 2
        chosen.page.write_text(text, encoding="utf-8")
    for what in failed:
        print(f"error: {what}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
