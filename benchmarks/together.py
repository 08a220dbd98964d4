"""A system and its monitor, started together: whether every machine conforms soon and to the end.

Each round is ``m2c run --monitor``. It is good if every machine conforms by ``BY_S`` after all are up and is
nothing else from then on, no judge starts anew, and the end is clean.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import msgspec

from benchmarks import copies
from benchmarks.page import Row, command
from benchmarks.processes import BIN, Child, free_endpoint
from benchmarks.sampling import distribution
from benchmarks.topologies import START_S
from moon.verdict import Outcome, Verdict

BY_S = 5.0
"""So long after all are up every machine is to conform."""
TICKS = 50
"""Of each round, at five a second: longer than that."""
END_S = 60.0


class Round(msgspec.Struct, frozen=True):
    """What came of one.

    Attributes:
        why_not: what was not as it should be; empty if all was.
        conforming_s: from when all were up until every machine conformed.
    """

    why_not: list[str]
    conforming_s: float


def held(system: Path, machines: int, folder: Path) -> Round:
    """One round; its verdicts are logged in ``folder``."""
    log = folder / "verdicts.jsonl"
    log.unlink(missing_ok=True)
    arguments = ["run", str(system), "--endpoint", free_endpoint(), "--quiet"]
    arguments += ["--ticks", str(TICKS), f"--monitor=--log {log}"]
    with Child("m2c run", [str(BIN / "m2c"), *arguments]) as process:
        process.wait_for(lambda line: line.endswith(" up"), START_S)
        up_ns = time.time_ns()
        end = process.wait_for(lambda line: line.startswith("stopped after "), END_S)
        said = process.last_lines
    by_ns = up_ns + int(BY_S * 1e9)
    verdicts = msgspec.json.Decoder(Verdict).decode_lines(log.read_bytes())
    conforming: dict[str, int] = {}
    """Since when each is, without interruption."""
    for verdict in verdicts:
        if verdict.outcome is Outcome.CONFORMING:
            conforming.setdefault(verdict.machine, verdict.stamp_ns)
        else:
            conforming.pop(verdict.machine, None)
    why_not = []
    if len(conforming) < machines:
        why_not.append(f"{machines - len(conforming)} of {machines} do not conform at the end")
    if late := sorted(name for name, since_ns in conforming.items() if since_ns > by_ns):
        why_not.append(f"not conforming {BY_S:g} s after all are up: {', '.join(late)}")
    if f"{machines} conforming until they ended" not in said:
        why_not.append("not all conform until they ended")
    if "resynchronised" in said:
        why_not.append("the judges started anew")
    if end != f"stopped after {TICKS} ticks; all nodes have ended":
        why_not.append(end)
    return Round(why_not, max(0.0, max(conforming.values(), default=0) - up_ns) / 1e9)


def rows(nodes: int = 47, rounds: int = 20) -> list[Row]:
    """What came of so many ``rounds`` of a system of ``nodes``."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        system = copies.write(nodes, folder / "models")
        found = [held(system, nodes + 1, folder) for _ in range(rounds)]
    for number, one in enumerate(found, 1):
        for text in one.why_not:
            print(f"round {number}: {text}", file=sys.stderr)
    good = sum(not one.why_not for one in found)
    what = f"{nodes} nodes and their monitor started together"
    last = distribution([[one.conforming_s for one in found]]).p50.value
    return [
        Row(f"{what}: rounds of {rounds} in which all conform", good, "", least=rounds),
        Row("from when all are up until all conform, p50", last, "s", most=BY_S),
    ]


if __name__ == "__main__":
    command(rows)
