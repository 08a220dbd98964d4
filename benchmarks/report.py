"""How soon a report's page is there, by how much was observed.

From the start of navigation to the browser's first contentful paint, and to the timeline's first
paint; the median of five loads in headless Chromium. A page ought to be there within two seconds.
"""

from __future__ import annotations

import statistics
import tempfile
from pathlib import Path

from benchmarks.page import Row, command
from moon.report import write_report
from tests.report.browser import browser, opened, painted_ms
from tests.report.samples import machines, result, violation, write_log

LOADS = 5
MOST_MS = 2_000
"""The page is there so soon, with its timeline."""
SIZES = (1_000, 100_000, 1_000_000)


def rows() -> list[Row]:
    """What is shown."""
    said = tuple(violation(machine, 5 + 3 * n, n) for n, machine in enumerate(machines()))
    found: list[Row] = []
    with tempfile.TemporaryDirectory() as folder, browser() as driver:
        for size in SIZES:
            log = write_log(Path(folder) / "run.jsonl", size)
            page = Path(folder) / f"report{size}.html"
            write_report(result(log, size, said), page)
            loads = []
            for _ in range(LOADS):
                opened(driver, page)
                loads.append(painted_ms(driver))
            first, timeline = (statistics.median(column) for column in zip(*loads, strict=True))
            what = f"report of {size:,} observations, painted"
            found.append(Row(what, max(first, timeline), "ms", most=MOST_MS))
    return found


if __name__ == "__main__":
    command(rows)
