"""Random formulas over random traces, ours against Reelay 25.

Reelay is given a stamp at every tick. With fewer it answers differently on its own, refined input:
``since`` forgets what held earlier in the same stretch when its left side ends in it, and the printed
result drops a false stretch that begins exactly at an observation. Bounds that end at 0 are left out
(it reads them as unbounded), as are instants without duration (it forgets them).
"""

from __future__ import annotations

import random
import re
from typing import Any

import reelay

from moon.properties.compiler import network_code
from moon.properties.network import build_network
from moon.properties.syntax import parse_formula

NAMES = "pqr"


def random_formula(choice: random.Random, depth: int, longest: int = 5, edges: bool = False) -> str:
    """A formula over p, q, r in the common syntax; with ``edges`` also of ours: rises and falls."""
    if depth == 0 or choice.random() < 0.12:
        return choice.choice(["{p}", "{q}", "{r}", "{n > 2}", "{n <= 1}"])

    def inner(edges: bool = edges) -> str:
        return random_formula(choice, depth - 1, longest, edges)

    def bound() -> str:
        low = choice.randrange(longest)
        high = max(1, low + choice.randrange(longest))
        return choice.choice(["", f"[{low}:{high}]", f"[{low}:]", f"[:{high}]"])

    match choice.randrange(9 if edges else 7):
        case 0:
            return f"(not ({inner()}))"
        case 1:
            return f"(({inner()}) and ({inner()}))"
        case 2:
            return f"(({inner()}) or ({inner()}))"
        case 3:
            return f"(({inner()}) -> ({inner()}))"
        case 4:
            return f"(once{bound()}({inner()}))"
        case 5:
            return f"(historically{bound()}({inner()}))"
        case 6:
            return f"(({inner()}) since{bound()} ({inner()}))"
        case 7:
            return f"(rises({inner(False)}))"
        case _:
            return f"(falls({inner(False)}))"


def for_reelay(formula: str) -> str:
    """``formula`` with its rises and falls in Reelay's words, for bounds that count ticks."""
    while (match := re.search(r"(rises|falls)\(", formula)) is not None:
        depth, end = 1, match.end()
        while depth:
            depth += {"(": 1, ")": -1}.get(formula[end], 0)
            end += 1
        inside = formula[match.end() - 1 : end]
        now, before = (inside, f"(not {inside})")[:: 1 if match[1] == "rises" else -1]
        formula = f"{formula[: match.start()]}({now} and (once[1:1]{before})){formula[end:]}"
    return formula


def random_trace(choice: random.Random, length: int) -> dict[int, dict[str, Any]]:
    """Changes at some ticks; tick 0 has them all. Missing names keep their value."""

    def values(share: float) -> dict[str, Any]:
        found: dict[str, Any] = {
            name: choice.random() < 0.5 for name in NAMES if choice.random() < share
        }
        if choice.random() < share:
            found["n"] = choice.randrange(5)
        return found

    density = choice.choice([0.2, 0.5, 0.9])
    trace = {0: values(1.1)}
    trace |= {t: values(0.6) for t in range(1, length) if choice.random() < density}
    return trace


def reelay_dense(formula: str, trace: dict[int, dict[str, Any]], length: int) -> list[bool]:
    """Reelay's value over (t, t + 1] for every tick t: ours at t."""
    monitor = reelay.dense_timed_monitor(pattern=formula)
    changes: dict[float, bool] = {}
    for t in range(length + 1):
        for change in monitor.update({"time": t, **trace.get(t, {})}):
            changes[change["time"]] = change["value"]
    values, value = [], False
    for t in range(length):
        value = changes.get(t, value)
        values.append(value)
    return values


def ours(formula: str, trace: dict[int, dict[str, Any]], length: int) -> list[bool]:
    """The compiled network's value at every tick, told only the ticks that have observations."""
    network = build_network([parse_formula(formula, ticks_per_unit=1)])
    program = network_code(network).program()
    nodes = {node.text: index for index, node in enumerate(network.nodes) if node.kind == "atom"}
    known: dict[str, Any] = {}
    values = []
    for t in range(length):
        if t in trace:
            program.before(t)
            known |= trace[t]
            atoms = {
                **known,
                "n > 2": known["n"] > 2,
                "n <= 1": known["n"] <= 1,
            }
            program.write({f"p{nodes[text]}": atoms[text] for text in nodes} | {"now": t})
            program.step(t)
        else:
            program.settle(t)
        values.append(program.values()[0])
    return values


def disagreement(seed: int, edges: bool = False) -> str | None:
    """What differs for the pair of a formula and a trace that ``seed`` makes; None: nothing.

    ``edges``: the formula may have rises and falls. (A seed makes other pairs with them.)
    """
    choice = random.Random(seed)
    formula = random_formula(choice, choice.randint(1, 4), edges=edges)
    length = choice.randint(2, 20)
    trace = random_trace(choice, length)
    theirs = reelay_dense(for_reelay(formula), trace, length)
    mine = ours(formula, trace, length)
    if mine == theirs:
        return None
    return (
        f"seed {seed}: {formula}\n{trace}\nreelay {theirs}\nours   {mine}\n"
        f"again: python -m tests.properties.soak --pairs 2 --seed {seed}"
    )


def soak(pairs: int = 50_000, first_seed: int = 0) -> int:
    """Compare ``pairs`` pairs, half of them with rises and falls; returns how many differ, printing each."""
    different = 0
    for seed in range(first_seed, first_seed + (pairs + 1) // 2):
        for edges in (False, True):
            found = disagreement(seed, edges)
            if found is not None:
                different += 1
                print(found, flush=True)
    print(f"{pairs} pairs, {different} differ", flush=True)
    return different


if __name__ == "__main__":
    import sys

    sys.exit(1 if soak(int(sys.argv[1])) else 0)
