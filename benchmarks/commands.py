"""What the commands cost: wall time of each as a process, beside a bare ``import click``."""

from __future__ import annotations

import functools
import itertools
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from benchmarks import copies
from benchmarks.page import Row, beside, command
from benchmarks.processes import BIN, ROOT
from benchmarks.sampling import measured

SYSTEM = ROOT / "examples/lab_tour/system.xml"
MANY = 47
"""Nodes of the larger system: the published one of a museum guide has as many."""
BARE = "import click"
TARGETS = {
    "m2c generate system.xml": 1.5,
    "m2c check system.xml": 0.25,
    f"m2c generate {MANY}-nodes.xml": 3.0,
    f"m2c check {MANY}-nodes.xml": 0.5,
    "m2c --help": 0.1,
    "moon --help": 0.1,
}
"""Seconds, by command."""


def taken(name: str, many: Path, folders: Iterator[Path]) -> list[float]:
    """Wall time in seconds of one run, which must succeed; ``many`` is the system of many nodes."""
    typed = name.replace("system.xml", str(SYSTEM)).replace(f"{MANY}-nodes.xml", str(many))
    first, *words = typed.split()
    if "generate" in words:  # into a new folder: writing the files is part of the cost
        words += ["-o", str(next(folders))]
    line = [sys.executable, "-c", BARE] if name == BARE else [str(BIN / first), *words]
    began = time.perf_counter()
    subprocess.run(line, check=True, stdout=subprocess.DEVNULL)
    return [time.perf_counter() - began]


def rows(runs: int = 5) -> list[Row]:
    """What is shown: medians of so many runs."""
    with tempfile.TemporaryDirectory() as scratch:
        folders = (Path(scratch) / str(number) for number in itertools.count())
        many = copies.write(MANY, Path(scratch) / "many")
        turns = {name: functools.partial(taken, name, many, folders) for name in (BARE, *TARGETS)}
        measured(turns, 1)  # which only warms the file cache
        found = measured(turns, runs)
    return [
        beside(f"`{name}`", "s", found[name], f"`{BARE}`", found[BARE], most, is_of_value=True)
        for name, most in TARGETS.items()
    ]


if __name__ == "__main__":
    command(rows)
