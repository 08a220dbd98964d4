"""The whole comparison: ``python -m examples.overhead [--quick | --full] [--json] [-o DIR] …``."""

from __future__ import annotations

import argparse
import datetime
import importlib.util
import secrets
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import msgspec
from msgspec.structs import replace
from rich.console import Console
from rich.markdown import Markdown

from benchmarks.processes import ROOT, ChildError
from benchmarks.ticking import MiddlewareMissingError
from examples.overhead import blocks, measuring, node_cost, results
from examples.overhead.brief import three_lines
from examples.overhead.machine import described, held_awake, this_machine
from examples.overhead.observers import CONFIGURATIONS

PAGES = (ROOT / "docs/overhead.md", ROOT / "docs/overhead-growth.md")
TRANSPORTS = ("zenoh", "ros2")

FULL = measuring.Plan(rounds=12, ticks={1.0: 8, 10.0: 30, 0.0: 150}, few=3)
SLOW_ROUNDS = 8
QUICK = measuring.Plan(rounds=2, ticks={10.0: 15, 0.0: 60}, settle=20, warm_up=5)
QUICK_CONFIGURATIONS = ("none", "control", "models", "both", "both-websocket", "both-in-process")
GROWTH = {"zenoh": blocks.GROWTH, "ros2": ("taps", "rate")}
"""Of a full run, by transport."""


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line.

    Exit code 0: measured; 1: a target is missed in a full run; 2: nothing could be measured.
    """
    parser = argparse.ArgumentParser(
        prog="python -m examples.overhead",
        description="What monitoring costs: passive, and in the middle as in the paper's table III.",
        epilog="example: python -m examples.overhead --quick -o build/overhead",
    )
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--quick", action="store_true", help="under two minutes (the default)")
    size.add_argument("--full", action="store_true", help="55 minutes")
    size.add_argument("--summary", action="store_true", help="three lines, in 15 s, on Zenoh")
    size.add_argument(
        "--from",
        dest="sources",
        type=Path,
        action="append",
        metavar="FILE",
        help="show a results.json again; several: the rounds of all of them together",
    )
    parser.add_argument(
        "--transport", choices=(*TRANSPORTS, "both"), help="[quick: zenoh; full: both]"
    )
    parser.add_argument("--json", action="store_true", help="every figure as one JSON object")
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", help="results.json, Markdown")
    parser.add_argument(
        "--asleep",
        action="store_true",
        help="processors may sleep when idle [default: held awake, where root permits]",
    )
    parser.add_argument("--update-docs", action="store_true", help="rewrite the tables in docs")
    parser.add_argument(
        "--only",
        choices=("targets", blocks.TABLE3, "growth", *blocks.GROWTH, blocks.COST),
        action="append",
        help="targets: of table III what there are targets for (with --full: 25 minutes)",
    )
    parser.add_argument("--rounds", type=int, help="of table III and growth")
    parser.add_argument("--seed", type=int, help="of the order; another one each time by default")
    chosen = parser.parse_args(arguments)
    missing = [] if chosen.summary or chosen.sources else missing_libraries()
    if missing:
        print(f"error: no {' and no '.join(missing)}: pip install '.[overhead]'", file=sys.stderr)
        return 2
    if chosen.seed is None:
        chosen.seed = secrets.randbelow(10_000)
    try:
        if chosen.summary:
            print("\n".join(three_lines()))
            return 0
        if chosen.sources:
            found = results.joined([results.read(source) for source in chosen.sources])
        else:
            with held_awake(wanted=not chosen.asleep) as is_awake:
                found = measure(chosen, is_awake)
    except (
        MiddlewareMissingError,
        ChildError,
        results.ResultsError,
        OSError,
        msgspec.MsgspecError,
    ) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    if found.problems and not found.blocks:
        print(f"error: {found.problems[0]}", file=sys.stderr)
        return 2
    if chosen.output is not None:
        results.save(found, chosen.output)
    if chosen.update_docs:
        results.rewrite(PAGES, found)
    if chosen.json:
        print(msgspec.json.encode(results.summary(found)).decode())
    else:
        console = Console(width=None if sys.stdout.isatty() else 200)
        console.print(Markdown(results.document(found)))
    missed = [item for item in blocks.targets(found.cells) if not item.is_met]
    return 1 if chosen.full and missed else 0


def missing_libraries() -> list[str]:
    """Those of the extra ``overhead`` that are not installed."""
    return [name for name in ("websocket", "websockets") if importlib.util.find_spec(name) is None]


def say(text: str) -> None:
    """Tell a person what is going on."""
    print(text, file=sys.stderr, flush=True)


def measure(chosen: argparse.Namespace, is_awake: bool) -> results.Results:
    """Everything that was asked for, on processors that are held awake or not."""
    wanted = chosen.transport or ("both" if chosen.full else "zenoh")
    machine, began = this_machine(is_awake), datetime.datetime.now(datetime.UTC)
    started = time.monotonic()
    say(described(machine))
    found: list[blocks.Block] = []
    problems: list[str] = []
    for transport in TRANSPORTS if wanted == "both" else (wanted,):
        for what, run in parts(chosen, transport):
            try:
                for block in run():  # one after the other: what comes before an error is kept
                    found.append(block)
            except (ChildError, MiddlewareMissingError) as error:
                # an hour's other figures are not lost for it
                say(f"{what} on {transport}: {error}")
                # what the process said last is for who is here; it may name files of this machine
                text = str(error).partition("\n")[0].rstrip(":")
                problems.append(f"{what} on {transport}: {text}")
    when, minutes = began.strftime("%Y-%m-%d %H:%M"), (time.monotonic() - started) / 60
    return results.Results(
        machine, command_of(chosen), when, minutes, tuple(found), tuple(problems)
    )


def parts(
    chosen: argparse.Namespace, transport: str
) -> Iterator[tuple[str, Callable[[], Iterator[blocks.Block]]]]:
    """What was asked for on one transport, part by part: what it is, and what measures it."""
    only = set(chosen.only or (blocks.TABLE3, "growth", blocks.COST))
    if only & {blocks.TABLE3, "targets"}:
        for plan, names in plans(chosen):
            own = [item for item in CONFIGURATIONS if item.name in names]
            yield (
                "table III",
                lambda plan=plan, own=own: measuring.measure_table3(transport, plan, say, own),
            )
    growth = measuring.GrowthPlan() if chosen.full else measuring.QUICK_GROWTH
    growth = replace(growth, seed=chosen.seed, rounds=chosen.rounds or growth.rounds)
    for name in GROWTH[transport]:
        if name in only or ("growth" in only and (chosen.full or name == "taps")):
            yield name, lambda name=name: measuring.MEASURES[name](transport, growth, say)
    if blocks.COST in only:
        cost = node_cost.CostPlan() if chosen.full else node_cost.QUICK
        cost = replace(cost, seed=chosen.seed)
        yield "the node's own cost", lambda: iter(node_cost.measure(transport, cost, say))


def plans(chosen: argparse.Namespace) -> list[tuple[measuring.Plan, Sequence[str]]]:
    """What table III is measured with, and which configurations: one tick a second is apart."""
    plan = replace(FULL if chosen.full else QUICK, seed=chosen.seed)
    if chosen.rounds:
        plan = replace(plan, rounds=chosen.rounds)
    targets_only = blocks.TABLE3 not in (chosen.only or [blocks.TABLE3])
    if not chosen.full:
        return [(plan, measuring.CORE if targets_only else QUICK_CONFIGURATIONS)]
    names = measuring.CORE if targets_only else [item.name for item in CONFIGURATIONS]
    slow = {rate: count for rate, count in plan.ticks.items() if 0 < rate < 5}
    fast = {rate: count for rate, count in plan.ticks.items() if rate not in slow}
    slow_rounds = min(plan.rounds, SLOW_ROUNDS)  # one tick a second takes its time
    slowly = replace(plan, ticks=slow, warm_up=2, rounds=slow_rounds)
    return [(replace(plan, ticks=fast), names), (slowly, measuring.CORE)]


def command_of(chosen: argparse.Namespace) -> str:
    """How to repeat it."""
    words = ["python -m examples.overhead", "--full" if chosen.full else "--quick"]
    words += [f"--transport {chosen.transport}"] if chosen.transport else []
    words += [f"--only {part}" for part in chosen.only or ()]
    words += [f"--rounds {chosen.rounds}"] if chosen.rounds else []
    words += ["--asleep"] if chosen.asleep else []
    words += [f"--seed {chosen.seed}"]
    return " ".join(words)


if __name__ == "__main__":
    sys.exit(main())
