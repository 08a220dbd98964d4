"""The whole comparison: ``python -m examples.overhead [--quick | --full] [--targets] [-o DIR] …``."""

from __future__ import annotations

import argparse
import datetime
import importlib.util
import os
import secrets
import sys
from collections.abc import Sequence
from pathlib import Path

from msgspec.structs import replace
from rich.console import Console
from rich.markdown import Markdown

from benchmarks.processes import ROOT, ChildError
from benchmarks.ticking import MiddlewareMissingError
from examples.overhead import blocks, measuring, results
from examples.overhead.brief import three_lines
from examples.overhead.machine import described, held_awake

PAGE = ROOT / "docs/overhead.md"
TRANSPORTS = ("zenoh", "ros2")

FULL = measuring.Plan(rounds=12, ticks={10.0: 30, 0.0: 150}, few=3)
SLOW = measuring.Plan(rounds=8, ticks={1.0: 8}, names=measuring.CORE, warm_up=2)
"""Of a full run, too: one tick a second takes its time."""
QUICK = measuring.Plan(
    rounds=2,
    ticks={10.0: 15, 0.0: 60},
    names=("none", "control", "models", "both", "both-websocket", "both-in-process"),
    settle=20,
    warm_up=5,
)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line.

    Exit code 0: measured; 1: a target is missed in a full run; 2: nothing could be measured.
    """
    chosen = parser().parse_args(arguments)
    missing = [] if chosen.summary or chosen.sources else missing_libraries()
    if missing:
        print(f"error: no {' and no '.join(missing)}: pip install '.[overhead]'", file=sys.stderr)
        return 2
    try:
        if chosen.summary:
            print("\n".join(three_lines()))
            return 0
        if chosen.sources:
            found = results.joined([results.read(source) for source in chosen.sources])
        else:
            with held_awake(wanted=not chosen.asleep) as is_awake:
                found = measure(chosen, is_awake)
    except (MiddlewareMissingError, ChildError, results.ResultsError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    if found.problems and not found.blocks:
        print(f"error: {found.problems[0]}", file=sys.stderr)
        return 2
    if chosen.output is not None:
        results.save(found, chosen.output)
    if chosen.update_docs:
        results.rewrite(PAGE, found)
    console = Console(width=None if sys.stdout.isatty() else 200)
    console.print(Markdown(results.document(found)))
    targets = blocks.targets(blocks.cells(found.blocks))
    return int(chosen.full and any(cell.ratio.value > most for cell, most in targets))


def parser() -> argparse.ArgumentParser:
    """The options."""
    made = argparse.ArgumentParser(
        prog="python -m examples.overhead",
        description="What monitoring costs: passive, and in the middle as in the paper's table III.",
        epilog="example: python -m examples.overhead --quick -o build/overhead",
    )
    size = made.add_mutually_exclusive_group()
    size.add_argument("--quick", action="store_true", help="under two minutes (the default)")
    size.add_argument("--full", action="store_true", help="35 minutes")
    size.add_argument("--summary", action="store_true", help="three lines, in 15 s, on Zenoh")
    size.add_argument(
        "--from",
        dest="sources",
        type=Path,
        action="append",
        metavar="FILE",
        help="show a results.json again; several: the rounds of all of them together",
    )
    made.add_argument(
        "--transport", choices=(*TRANSPORTS, "both"), help="[quick: zenoh; full: both]"
    )
    made.add_argument("--targets", action="store_true", help="only what there are targets for")
    made.add_argument("--rounds", type=int, help="how often each configuration has its turn")
    seed = secrets.randbelow(10_000)
    made.add_argument("--seed", type=int, default=seed, help="of the order [another each time]")
    made.add_argument(
        "--asleep",
        action="store_true",
        help="processors may sleep when idle [default: held awake, where root permits]",
    )
    made.add_argument("-o", "--output", type=Path, metavar="DIR", help="results.json, Markdown")
    made.add_argument("--update-docs", action="store_true", help="rewrite the tables in docs")
    return made


def missing_libraries() -> list[str]:
    """Those of the extra ``overhead`` that are not installed."""
    return [name for name in ("websocket", "websockets") if importlib.util.find_spec(name) is None]


def say(text: str) -> None:
    """Tell a person what is going on."""
    print(text, file=sys.stderr, flush=True)


def measure(chosen: argparse.Namespace, is_awake: bool) -> results.Results:
    """Everything that was asked for, on processors that are held awake or not."""
    wanted = chosen.transport or ("both" if chosen.full else "zenoh")
    machine, load = described(is_awake), os.getloadavg()[0]
    began = datetime.datetime.now(datetime.UTC)
    say(f"{machine}; load average {load:.2f}")
    found: list[blocks.Block] = []
    problems: list[str] = []
    for transport in TRANSPORTS if wanted == "both" else (wanted,):
        try:
            for plan in plans(chosen):
                for block in measuring.measure(transport, plan, say):
                    found.append(block)  # at once: what comes before an error is kept
        except (ChildError, MiddlewareMissingError) as error:
            say(f"{transport}: {error}")
            # what the process said last is for who is here; it may name files of this machine
            problems.append(f"{transport}: {str(error).partition(chr(10))[0].rstrip(':')}")
    when = began.strftime("%Y-%m-%d %H:%M")
    minutes = (datetime.datetime.now(datetime.UTC) - began).total_seconds() / 60
    what = command_of(chosen), when, minutes, tuple(found), tuple(problems)
    return results.Results(machine, load, *what)


def plans(chosen: argparse.Namespace) -> list[measuring.Plan]:
    """What is measured, one after the other."""
    return [
        replace(
            plan,
            seed=chosen.seed,
            rounds=chosen.rounds or plan.rounds,
            names=measuring.CORE if chosen.targets else plan.names,
        )
        for plan in ((FULL, SLOW) if chosen.full else (QUICK,))
    ]


def command_of(chosen: argparse.Namespace) -> str:
    """How to repeat it."""
    words = ["python -m examples.overhead", "--full" if chosen.full else "--quick"]
    words += [f"--transport {chosen.transport}"] if chosen.transport else []
    words += ["--targets"] if chosen.targets else []
    words += [f"--rounds {chosen.rounds}"] if chosen.rounds else []
    words += ["--asleep"] if chosen.asleep else []
    words += [f"--seed {chosen.seed}"]
    return " ".join(words)


if __name__ == "__main__":
    sys.exit(main())
