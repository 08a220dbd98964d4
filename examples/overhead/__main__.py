"""The whole comparison: ``python -m examples.overhead [--quick | --full] [--json] [-o DIR] …``."""

from __future__ import annotations

import argparse
import contextlib
import datetime
import importlib.util
import secrets
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec

from examples.overhead import growth, growth_points, node_cost, results, table3, tables
from examples.overhead.agreement import agreement
from examples.overhead.awake import held_awake
from examples.overhead.children import ROOT, ChildError
from examples.overhead.machine import described, this_machine
from examples.overhead.observers import CONFIGURATIONS
from examples.overhead.plant import MiddlewareMissingError

PAGE = ROOT / "docs/overhead.md"
IMAGES = ROOT / "docs/images"
TRANSPORTS = ("zenoh", "ros2")

FULL = table3.Plan(rounds=12, ticks={1.0: 8, 10.0: 30, 0.0: 150}, few=3)
SLOW_ROUNDS = 8
QUICK = table3.Plan(rounds=2, ticks={10.0: 15, 0.0: 60}, settle=20, warm_up=5)
QUICK_CONFIGURATIONS = ("none", "control", "models", "both", "both-websocket", "both-in-process")
EXPERIMENTS = {"zenoh": growth_points.EXPERIMENTS, "ros2": ("taps", "rate")}
"""Of a full run, by transport."""


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line.

    Exit code 0: measured; 1: a target is missed in a full run; 2: nothing could be measured.
    """
    parser = argparse.ArgumentParser(
        prog="python -m examples.overhead",
        description="What monitoring costs: passive, and in the middle as in the paper's table III.",
        epilog="examples: python -m examples.overhead --quick -o build/overhead; "
        "python -m examples.overhead --full -o again --against build/overhead/results.json",
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
    parser.add_argument(
        "--against", type=Path, metavar="FILE", help="a results.json: do the intervals overlap?"
    )
    parser.add_argument("--json", action="store_true", help="every figure as one JSON object")
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", help="CSV, Markdown, figures")
    parser.add_argument(
        "--asleep",
        action="store_true",
        help="processors may sleep when idle [default: held awake, where root permits]",
    )
    parser.add_argument("--update-docs", action="store_true", help=f"rewrite {PAGE.name}'s tables")
    parser.add_argument(
        "--only",
        choices=("targets", "table3", "growth", "cost"),
        action="append",
        help="targets: of table III what there are targets for (with --full: 25 minutes)",
    )
    parser.add_argument("--rounds", type=int, help="of table III and growth")
    parser.add_argument("--seed", type=int, help="of the order; another one each time by default")
    chosen = parser.parse_args(arguments)
    missing = [] if chosen.summary else missing_libraries()
    if missing:
        print(f"error: no {' and no '.join(missing)}: pip install '.[overhead]'", file=sys.stderr)
        return 2
    if chosen.seed is None:
        chosen.seed = secrets.randbelow(10_000)
    try:
        if chosen.summary:
            from examples.overhead.brief import three_lines

            print("\n".join(three_lines()))
            return 0
        other = results.read(chosen.against) if chosen.against is not None else None
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
    if found.problems and not (found.cells or found.growth or found.windows):
        print(f"error: {found.problems[0]}", file=sys.stderr)
        return 2
    if chosen.output is not None:
        results.save(found, chosen.output)
        from examples.overhead.figures import draw

        draw(found, chosen.output)
    if chosen.update_docs:
        update_docs(found)
    compared = agreement(found, other) if other is not None else None
    if chosen.json:
        short = results.summary(found)
        print(msgspec.json.encode({**short, "against": compared} if compared else short).decode())
    else:
        show(found)
        if compared is not None:
            tables.print_table(compared)
    missed = [item for item in table3.targets(found.cells) if not item.is_met]
    return 1 if chosen.full and missed else 0


def missing_libraries() -> list[str]:
    """Those of the extra ``overhead`` that are not installed."""
    wanted = ("matplotlib", "websocket", "websockets")
    return [name for name in wanted if importlib.util.find_spec(name) is None]


def say(text: str) -> None:
    """Tell a person what is going on."""
    print(text, file=sys.stderr, flush=True)


def measure(chosen: argparse.Namespace, is_awake: bool) -> results.Results:
    """Everything that was asked for, on processors that are held awake or not."""
    wanted = chosen.transport or ("both" if chosen.full else "zenoh")
    transports = TRANSPORTS if wanted == "both" else (wanted,)
    parts = chosen.only or ["table3", "growth", "cost"]
    machine, began = this_machine(is_awake), datetime.datetime.now(datetime.UTC)
    started = time.monotonic()
    say(described(machine))
    blocks: list[table3.Block] = []
    attachments: list[table3.Attachment] = []
    runs: list[growth_points.Run] = []
    windows: list[node_cost.Window] = []
    problems: list[str] = []
    for transport in transports:
        if "table3" in parts or "targets" in parts:
            for plan, names in plans(chosen):
                configurations = [item for item in CONFIGURATIONS if item.name in names]
                with tolerated(problems, f"table III on {transport}"):
                    part = table3.measure(transport, plan, say, configurations)
                    blocks += part.blocks
                    attachments += part.attachments
        if "growth" in parts:
            plan_of_growth = growth.GrowthPlan() if chosen.full else growth.QUICK
            plan_of_growth = msgspec.structs.replace(plan_of_growth, seed=chosen.seed)
            if chosen.rounds:
                plan_of_growth = msgspec.structs.replace(plan_of_growth, rounds=chosen.rounds)
            experiments = EXPERIMENTS[transport] if chosen.full else ("taps",)
            for experiment in experiments:
                with tolerated(problems, f"{experiment} on {transport}"):
                    for run in growth.MEASURES[experiment](transport, plan_of_growth, say):
                        runs.append(run)
        if "cost" in parts:
            plan_of_cost = node_cost.CostPlan() if chosen.full else node_cost.QUICK
            plan_of_cost = msgspec.structs.replace(plan_of_cost, seed=chosen.seed)
            with tolerated(problems, f"the node's own cost on {transport}"):
                windows += node_cost.measure(transport, plan_of_cost, say)
    return results.Results(
        machine,
        command_of(chosen),
        began.strftime("%Y-%m-%d %H:%M"),
        (time.monotonic() - started) / 60,
        table3.Measured(tuple(blocks), tuple(attachments)),
        tuple(runs),
        tuple(windows),
        tuple(problems),
    )


@contextlib.contextmanager
def tolerated(problems: list[str], what: str) -> Iterator[None]:
    """What goes wrong is noted and said; an hour's other figures are not lost for it."""
    try:
        yield
    except (ChildError, MiddlewareMissingError) as error:
        say(f"{what}: {error}")
        # what the process said last is for who is here; it may name files of this machine
        problems.append(f"{what}: {str(error).partition(chr(10))[0].rstrip(':')}")


def plans(chosen: argparse.Namespace) -> list[tuple[table3.Plan, Sequence[str]]]:
    """What table III is measured with, and which configurations: one tick a second is apart."""
    plan = msgspec.structs.replace(FULL if chosen.full else QUICK, seed=chosen.seed)
    if chosen.rounds:
        plan = msgspec.structs.replace(plan, rounds=chosen.rounds)
    targets_only = "table3" not in (chosen.only or ["table3"])
    if not chosen.full:
        return [(plan, table3.CORE if targets_only else QUICK_CONFIGURATIONS)]
    slow = {rate: count for rate, count in plan.ticks.items() if 0 < rate < 5}
    fast = {rate: count for rate, count in plan.ticks.items() if rate not in slow}
    names = table3.CORE if targets_only else [item.name for item in CONFIGURATIONS]
    return [
        (msgspec.structs.replace(plan, ticks=fast), names),
        (
            msgspec.structs.replace(
                plan, ticks=slow, warm_up=2, rounds=min(plan.rounds, SLOW_ROUNDS)
            ),
            table3.CORE,  # one tick a second takes its time
        ),
    ]


def command_of(chosen: argparse.Namespace) -> str:
    """How to repeat it."""
    words = ["python -m examples.overhead", "--full" if chosen.full else "--quick"]
    words += [f"--transport {chosen.transport}"] if chosen.transport else []
    words += [f"--only {part}" for part in chosen.only or ()]
    words += [f"--rounds {chosen.rounds}"] if chosen.rounds else []
    words += ["--asleep"] if chosen.asleep else []
    words += [f"--seed {chosen.seed}"]
    return " ".join(words)


def show(found: results.Results) -> None:
    """All tables on the terminal."""
    cells = found.cells
    print(f"{found.command}, {described(found.machine)}, {found.minutes:.1f} minutes")
    for table in (
        *tables.beside_the_paper(cells),
        *tables.details(found.table3, cells),
        *tables.growth_tables(found.points),
        *([tables.cost_table(found.windows)] if found.windows else []),
        *([tables.targets(cells)] if cells else []),
    ):
        tables.print_table(table)
    for attachment in found.table3.attachments:
        if attachment.deaf:
            where = f"round {attachment.round + 1}, {attachment.configuration}"
            print(f"{attachment.transport}, {where}: {attachment.deaf}")
    for problem in found.problems:
        print(f"not measured: {problem}")


def update_docs(found: results.Results) -> None:
    """Rewrite the page's tables and its figures (SVG only: the page shows those)."""
    from examples.overhead.figures import draw

    results.rewrite(PAGE, found)
    for path in draw(found, IMAGES):
        if path.suffix != ".svg":
            path.unlink()


if __name__ == "__main__":
    sys.exit(main())
