"""Everything that one run of the comparison has measured, as a file, and its place on the page."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
from msgspec.structs import replace

from benchmarks.page import page_with, put
from examples.overhead import blocks, tables
from examples.overhead.machine import Machine, described

FILE = "results.json"
BUSY = 1.0
"""A load average before the run from which on its figures are marked."""


class Results(msgspec.Struct, frozen=True, dict=True):
    """Every single tick, so that all tables can be made again from it.

    Attributes:
        command: how to repeat it.
        began: when, as ``YYYY-MM-DD HH:MM`` UTC.
        minutes: how long it took.
        problems: what could not be measured, one sentence each.
    """

    machine: Machine
    command: str
    began: str
    minutes: float
    blocks: tuple[blocks.Block, ...]
    problems: tuple[str, ...] = ()

    @functools.cached_property
    def cells(self) -> list[blocks.Cell]:
        """The figures."""
        return blocks.cells(self.blocks)


def made_tables(results: Results) -> dict[str, list[tables.Table]]:
    """All tables with something in them, by the name of their section."""
    found = results.cells
    made = {
        "targets": [tables.targets(found)],
        "table3": [tables.paper(), *tables.table3(found)],
        "growth": [tables.growth(found)],
        "cost": [tables.cost(found)],
    }
    return {name: [table for table in part if table.rows] for name, part in made.items()}


def sections(results: Results) -> dict[str, str]:
    """Markdown by the name of its section."""
    said = [
        f"`{results.command}`, {results.began} UTC, {results.minutes:.0f} minutes, on "
        f"{described(results.machine)}."
    ]
    if results.machine.load > BUSY:
        said.append(
            "**Others were at work on the machine: these figures say how it is measured, not what it "
            "costs.** How far *no monitor, again* is from 1 says how little they say."
        )
    said += [f"- not measured: {text}" for text in results.problems]
    parts = {
        name: "\n\n".join(map(tables.as_markdown, part)) or "Not measured."
        for name, part in made_tables(results).items()
    }
    return {"machine": "\n\n".join(said), **parts}


def document(results: Results) -> str:
    """All sections, and what does not count."""
    parts = [f"## {name}\n\n{text}" for name, text in sections(results).items()]
    for block in results.blocks:
        if block.deaf:
            where = f"round {block.round + 1}, {block.experiment}, {block.configuration}"
            parts.append(f"{block.transport}, {where}: {block.deaf}")
    return "\n\n".join(["# Overhead", *parts]) + "\n"


def summary(results: Results) -> dict[str, Any]:
    """For machines: every figure, without the single ticks."""
    shown: dict[str, Any] = msgspec.to_builtins(results)
    del shown["blocks"]
    figures = {"targets": blocks.targets(results.cells), "cells": results.cells}
    return {**shown, "paper": blocks.PAPER, **msgspec.to_builtins(figures)}


def save(results: Results, folder: Path) -> None:
    """Write results and their tables in Markdown into ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / FILE).write_bytes(msgspec.json.encode(results))
    (folder / "overhead.md").write_text(document(results), encoding="utf-8")


class ResultsError(ValueError):
    """A file that is no run's results, or runs whose rounds are not those of one."""


def read(path: Path) -> Results:
    """What :func:`save` wrote.

    Raises:
        OSError: it cannot be read.
        ResultsError: somebody else wrote it, or it was cut off.
    """
    try:
        return msgspec.json.decode(path.read_bytes(), type=Results)
    except msgspec.MsgspecError as error:
        raise ResultsError(f"{path}: not the results of a run: {error}") from error


def joined(runs: Sequence[Results]) -> Results:
    """The rounds of several runs, as if one run had made all of them.

    A ratio is of the same round in it, too, so that what differs between runs is no more than what
    differs between rounds.

    Args:
        runs: one or more.

    Raises:
        ResultsError: their machines differ in more than their load, or one run is there twice.
    """
    first = runs[0]
    seen: set[tuple[str, str]] = set()
    together: list[blocks.Block] = []
    for run in runs:
        if replace(run.machine, load=first.machine.load) != first.machine:
            raise ResultsError(
                f"the run of {run.began} UTC is of another machine: {described(run.machine)}; "
                f"that of {first.began}: {described(first.machine)}"
            )
        if (run.began, run.command) in seen:
            raise ResultsError(f"the run of {run.began} UTC is there twice")
        seen.add((run.began, run.command))
        before = max((item.round for item in together), default=-1) + 1
        together += [replace(item, round=item.round + before) for item in run.blocks]
    return Results(
        replace(first.machine, load=max(run.machine.load for run in runs)),
        "; ".join(run.command for run in runs),
        ", ".join(run.began for run in runs),
        sum(run.minutes for run in runs),
        tuple(together),
        tuple(problem for run in runs for problem in run.problems),
    )


def rewrite(pages: Sequence[Path], results: Results) -> None:
    """Put every section between its markers, on the page that has them; the rest stays as it is.

    Raises:
        ValueError: no page has the markers of a section; no page was changed then.
    """
    texts = {page: page.read_text(encoding="utf-8") for page in pages}
    for name, content in sections(results).items():
        page = page_with(texts, name)
        texts[page] = put(texts[page], name, content)
    for page, text in texts.items():
        page.write_text(text, encoding="utf-8")
