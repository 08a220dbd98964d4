"""A figure of a benchmark beside a peer's of the same run, for the page of all figures.

A benchmark tells its rows by :func:`publish`; ``python -m benchmarks`` collects them.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import msgspec

TOLD_TO = "BENCHMARK_ROWS"
"""The environment variable that names the file into which rows are written."""


class Row(msgspec.Struct, frozen=True):
    """One figure.

    Attributes:
        what: is measured.
        value: of ours, in ``unit``.
        peer: what it is compared with; "" if with nothing.
        theirs: the peer's value, in the same unit, in the same run.
        ratio: of ours to the peer's.
        most, least: the target, of the ratio where there is one, else of the value.
        is_of_value: the target is of the value, though there is a ratio.
    """

    what: str
    value: float
    unit: str
    peer: str = ""
    theirs: float | None = None
    ratio: float | None = None
    most: float | None = None
    least: float | None = None
    is_of_value: bool = False

    @property
    def is_met(self) -> bool | None:
        """Whether the target is reached; None if there is none."""
        figure = self.value if self.ratio is None or self.is_of_value else self.ratio
        if self.most is not None:
            return figure <= self.most
        return None if self.least is None else figure >= self.least


def slower(
    what: str, value: float, unit: str, peer: str, theirs: float, most: float | None = None
) -> Row:
    """A figure of which less is better; the ratio says how many times the peer's it is."""
    return Row(what, value, unit, peer, theirs, value / theirs, most=most)


def faster(
    what: str, value: float, unit: str, peer: str, theirs: float, least: float | None = None
) -> Row:
    """A figure of which more is better; the ratio says how many times the peer's it is."""
    return Row(what, value, unit, peer, theirs, value / theirs, least=least)


def publish(rows: Sequence[Row]) -> None:
    """Tell ``rows`` to who runs all benchmarks, if anybody does."""
    path = os.environ.get(TOLD_TO)
    if path:
        Path(path).write_bytes(msgspec.json.encode(rows))
