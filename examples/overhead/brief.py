"""Three lines for the end of the demo: a fast part of the comparison, with what a plain install has."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.processes import ChildError
from benchmarks.ticking import WHOLE
from examples.overhead import measuring
from examples.overhead.blocks import PAPER, Block, cells

NAMES = ("none", "both", "models-in-process")
"""Without the WebSocket, whose libraries a plain install does not have."""
PLAN = measuring.Plan(rounds=1, ticks={20.0: 25}, names=NAMES, settle=20, warm_up=5, run_in=50)


def three_lines() -> list[str]:
    """Measure on Zenoh (12 s) and say it.

    Raises:
        ChildError: something could not be measured.
    """
    said: list[str] = []
    blocks = list(measuring.measure("zenoh", PLAN, said.append))
    if missing := set(NAMES) - {block.configuration for block in blocks}:
        raise ChildError(f"{', '.join(sorted(missing))}: not measured; {'; '.join(said[-1:])}")
    return lines(blocks)


def lines(blocks: Sequence[Block]) -> list[str]:
    """What the demo says of ``blocks``, of which there are those of all three configurations."""
    found = {cell.configuration: cell for cell in cells(blocks) if cell.series == WHOLE}
    none, both, middle = (found[name] for name in NAMES)
    paper = PAPER[WHOLE]
    failed = sum(cell.failures for cell in found.values())
    doubts = [f"{failed} ticks failed"] if failed else []
    doubts += [f"{item.configuration}: {item.deaf}" for item in blocks if item.deaf]
    doubt = f" ({'; '.join(doubts)})" if doubts else ""
    return [
        f"a tick of four skills: {none.found.p50.value:,.0f} µs, with all of it monitored passively "
        f"{both.found.p50.value:,.0f} µs ({both.ratio.value:.2f} times){doubt}",
        f"by a monitor in the middle of each call, the best we could write: "
        f"{middle.found.p50.value:,.0f} µs ({middle.ratio.value:.2f} times)",
        f"by the paper's, on its machine: {paper['none']:,} µs without, {paper['both']:,} µs with "
        f"({paper['both'] / paper['none']:.1f} times)",
    ]
