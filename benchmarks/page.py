"""Figures of benchmarks beside a peer's of the same run: on a terminal, and on the page of all figures.

A benchmark tells its rows by :func:`publish`; ``python -m benchmarks`` collects them.
"""

from __future__ import annotations

import argparse
import inspect
import os
import sys
import typing
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import msgspec

from benchmarks.sampling import Block, Estimate, distribution, ratio

TOLD_TO = "BENCHMARK_ROWS"
"""The environment variable that names the file into which rows are written."""


class Row(msgspec.Struct, frozen=True):
    """One figure.

    Attributes:
        what: is measured.
        value: of ours, in ``unit``.
        peer: what it is compared with; "" if with nothing.
        theirs: the peer's value, in the same unit, in the same run.
        ratio: of ours to the peer's, with its interval.
        most, least: the target, of the ratio where there is one, else of the value.
        is_of_value: the target is of the value, though there is a ratio.
    """

    what: str
    value: float
    unit: str
    peer: str = ""
    theirs: float | None = None
    ratio: Estimate | None = None
    most: float | None = None
    least: float | None = None
    is_of_value: bool = False

    @property
    def is_met(self) -> bool | None:
        """Whether the target is reached; None if there is none."""
        ratio = None if self.is_of_value else self.ratio
        figure = self.value if ratio is None else ratio.value
        if self.most is not None:
            return figure <= self.most
        return None if self.least is None else figure >= self.least


def beside(
    what: str,
    unit: str,
    own: Sequence[Block],
    peer: str,
    theirs: Sequence[Block],
    most: float | None = None,
    least: float | None = None,
    is_of_value: bool = False,
) -> Row:
    """A figure beside a peer's: medians of blocks, and their ratio, each round's of its own two blocks."""
    value, other = (distribution(blocks).p50.value for blocks in (own, theirs))
    return Row(what, value, unit, peer, other, ratio(own, theirs), most, least, is_of_value)


def publish(rows: Sequence[Row]) -> None:
    """Print ``rows``, and tell them to who runs all benchmarks, if anybody does."""
    for row in rows:
        print(": ".join([row.what, ", ".join(filter(None, _cells(row)))]), flush=True)
    path = os.environ.get(TOLD_TO)
    if path:
        Path(path).write_bytes(msgspec.json.encode(rows))


def command(rows: Callable[..., Sequence[Row]]) -> None:
    """A benchmark's command: ``rows`` makes its figures, and each of its arguments is an option.

    Each has a default, which says its type; one that is a ``Literal`` has only these values.
    """
    about = inspect.getdoc(sys.modules[rows.__module__]) or ""
    parser = argparse.ArgumentParser(
        description=about, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for name, option in inspect.signature(rows, eval_str=True).parameters.items():
        default, choices = option.default, typing.get_args(option.annotation) or None
        parser.add_argument(
            f"--{name}", type=type(default), default=default, choices=choices, help=f"[{default}]"
        )
    publish(rows(**vars(parser.parse_args())))


def as_markdown(rows: Sequence[Row], said: str) -> str:
    """A table of ``rows``; ``said`` heads their names."""
    header = (said, "ours", "peer", "ratio", "target", "")
    return markdown_table([header, *((row.what, *_cells(row)) for row in rows)])


def markdown_table(rows: Sequence[Sequence[str]]) -> str:
    """A table in Markdown; the first row heads it."""
    lines = [f"| {' | '.join(cells)} |" for cells in rows]
    return "\n".join([lines[0], "|" + "---|" * len(rows[0]), *lines[1:]])


def _cells(row: Row) -> tuple[str, ...]:
    """Value, the peer's, ratio, target, and whether it is reached."""
    theirs = f"{row.peer} {_number(row.theirs, row.unit)}" if row.theirs is not None else row.peer
    ratio = "" if row.ratio is None else row.ratio.shown(".2f")
    met = {None: "", True: "reached", False: "**not reached**"}[row.is_met]
    return _number(row.value, row.unit), theirs, ratio, _target(row), met


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


def page_with(texts: Mapping[Path, str], name: str) -> Path:
    """The page, by its text, that has the markers of ``name``; the first one if none has."""
    return next(
        (page for page, text in texts.items() if f"<!-- begin {name} -->" in text),
        next(iter(texts)),
    )


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
