"""What more and more nodes cost: in as many processes as there are processors, beside one for each node."""

from __future__ import annotations

from benchmarks.page import Row, command
from benchmarks.topologies import systems


def rows(nodes: str = "4 17 47 150", seconds: float = 10.0, rounds: int = 1) -> list[Row]:
    """What is shown of systems of so many ``nodes``; each ticks for ``seconds``."""
    return [
        row
        for number in nodes.split()
        for row in systems(int(number), seconds, rounds, [], "one each", ["--processes", "each"])
    ]


if __name__ == "__main__":
    command(rows)
