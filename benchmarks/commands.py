"""What the commands cost: wall time of each as a process, beside a bare ``import click``."""

from __future__ import annotations

import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.page import Row, command, slower
from benchmarks.processes import ROOT

SYSTEM = ROOT / "examples/lab_tour/system.xml"
BIN = Path(sys.executable).parent


def seconds(command: list[str]) -> float:
    """Wall time of one run of ``command``, which must succeed."""
    began = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - began


def per_model(rounds: int) -> Row:
    """Filling in the templates of a node, beside what CPython takes to compile what comes out.

    Without ruff, which formats a whole system at once: its time is in that of ``m2c generate``.
    """
    from m2c.codegen.package import node_texts
    from m2c.model import DiagnosticLog, load

    system = load([SYSTEM], DiagnosticLog())
    assert system is not None
    ours, theirs = [], []
    for _ in range(rounds):
        for machine in system.nodes:
            began = time.perf_counter()
            files = node_texts(machine, system.library, "package")
            ours.append(time.perf_counter() - began)
            began = time.perf_counter()
            for name, text in files.items():
                if name.endswith(".py"):
                    compile(text, name, "exec")
            theirs.append(time.perf_counter() - began)
    mine, peer = statistics.median(ours) * 1e3, statistics.median(theirs) * 1e3
    return slower(
        "filling in the templates of a node", mine, "ms", "CPython compiling the result", peer
    )


TARGETS = {
    "m2c generate system.xml": 1.5,
    "m2c check system.xml": 0.7,
    "m2c --help": 0.2,
    "moon --help": 0.2,
}
"""Seconds, by command."""


def rows(runs: int = 5) -> list[Row]:
    """What is shown: medians of so many runs."""
    bare = "import click"
    taken: dict[str, list[float]] = {name: [] for name in (bare, *TARGETS)}
    with tempfile.TemporaryDirectory() as scratch:
        for run in range(runs + 1):  # in turns, so that a busy moment hits all of them alike
            for name, times in taken.items():
                words = name.replace("system.xml", str(SYSTEM)).split()
                if "generate" in words:  # into a new folder: writing the files is part of the cost
                    words += ["-o", str(Path(scratch) / str(run))]
                ours = [str(BIN / words[0]), *words[1:]]
                elapsed = seconds([sys.executable, "-c", bare] if name == bare else ours)
                if run:  # the first run only warms the file cache
                    times.append(elapsed)
    theirs, *medians = map(statistics.median, taken.values())
    peer = f"`{bare}`"
    found = [
        Row(f"`{name}`", own, "s", peer, theirs, own / theirs, most=most, is_of_value=True)
        for (name, most), own in zip(TARGETS.items(), medians, strict=True)
    ]
    return [*found, per_model(runs)]


if __name__ == "__main__":
    command(rows)
