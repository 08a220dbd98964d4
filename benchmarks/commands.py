"""What the commands cost: wall time of each as a process, beside a bare ``import click``.

Usage: ``python -m benchmarks.commands [--runs N]``. Prints medians, their targets and ratios.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.page import Row, publish, slower
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=5)
    runs = parser.parse_args().runs
    m2c, moon = str(BIN / "m2c"), str(BIN / "moon")
    bare = 'python -c "import click"'
    with tempfile.TemporaryDirectory() as scratch:
        commands: dict[str, tuple[list[str], float | None]] = {
            bare: ([sys.executable, "-c", "import click"], None),
            "m2c generate system.xml": ([m2c, "generate", str(SYSTEM), "-o"], 1.5),
            "m2c check system.xml": ([m2c, "check", str(SYSTEM)], 0.7),
            "m2c --help": ([m2c, "--help"], 0.2),
            "moon --help": ([moon, "--help"], 0.2),
        }
        taken: dict[str, list[float]] = {name: [] for name in commands}
        for run in range(runs + 1):  # in turns, so that a busy moment hits all of them alike
            for name, (command, _) in commands.items():
                # into a new folder each time: writing the files is part of the cost
                folder = [str(Path(scratch) / str(run))] if command[-1] == "-o" else []
                elapsed = seconds([*command, *folder])
                if run:  # the first run only warms the file cache
                    taken[name].append(elapsed)
    medians = {name: statistics.median(values) for name, values in taken.items()}
    rows = [
        Row(
            f"`{name}`",
            medians[name],
            "s",
            "`import click`",
            medians[bare],
            medians[name] / medians[bare],
            most=target,
            is_of_value=True,
        )
        for name, (_, target) in commands.items()
        if name != bare
    ]
    publish([*rows, per_model(runs)])


if __name__ == "__main__":
    main()
