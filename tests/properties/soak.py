"""Long runs: many pairs against Reelay, losses against their completions, readers fuzzed from a corpus.

``python -m tests.properties.soak --pairs 50000 --losses 200000 --seconds 600`` exits with 1 if anything
differs or crashes; each failure is printed with what repeats it. What a fuzzing run finds belongs into ``corpus/``, which the normal suite reads, too.
"""

from __future__ import annotations

import argparse
import functools
import random
import sys
import time
import traceback
from pathlib import Path

from m2c.diagnostics import DiagnosticLog
from m2c.model import load
from moon.properties.compiler import network_code
from moon.properties.files.interfaces import Interfaces
from moon.properties.files.xml import parse_property_xml
from moon.properties.files.yaml import parse_property_yaml
from moon.properties.monitor import PropertyMonitor, PropertySet
from moon.properties.network import build_network
from moon.properties.predicates import PredicateError
from moon.properties.syntax import FormulaError, parse_formula
from tests.properties import differential, losses

EXAMPLE = Path(__file__).parents[2] / "examples" / "lab_tour"
CORPUS = Path(__file__).parent / "corpus"
PIECES = [
    *("historically", "once", "since", " not ", " and ", " or ", "->", "{p}", "{x > 3}", "(", ")"),
    *(
        "[1:2]",
        "[:",
        ":]",
        "{",
        "}",
        "'",
        '"',
        ",",
        ":",
        "!",
        "*",
        "&a",
        "*a",
        "\t",
        "\n",
        "\r",
        "  ",
        "- ",
    ),
    *(
        "<",
        "/>",
        "&lt;",
        "<event>",
        "</event>",
        "\x00",
        "é",
        "\ud7ff",
        "9" * 30,
        "1e999",
        "?",
        ".",
        "[0]",
    ),
]
SLOW_S = 5.0
"""Longer than this for one input of a few kilobytes counts as a hang."""


@functools.cache
def known() -> Interfaces:
    """What the files are held against: the lab tour."""
    system = load([EXAMPLE / "system.xml"], DiagnosticLog())
    assert system is not None
    return Interfaces(system.library, system)


def read(kind: str, source: str) -> None:
    """Read ``source`` as a file of ``kind`` is read, and begin to monitor what is in it; only the
    readers' own errors may come of it.
    """
    log = DiagnosticLog()
    match kind:
        case ".xml":
            found = parse_property_xml(source.encode("utf-8", "replace"), "fuzz.xml", log)
            PropertySet(found).advance(0)
            parse_property_xml(source.encode("utf-8", "replace"), "fuzz.xml", log, known())
        case ".yaml":
            found = parse_property_yaml(source.encode("utf-8", "replace"), "fuzz.yaml", log)
            PropertySet(found).advance(0)
            parse_property_yaml(source.encode("utf-8", "replace"), "fuzz.yaml", log, known())
        case _:
            try:
                network_code(build_network([parse_formula(source)])).program().step(0)
                PropertyMonitor(source)
            except (FormulaError, PredicateError):
                return


def damage(choice: random.Random, source: str, others: list[str]) -> str:
    """``source`` with a few cuts, insertions, repetitions and transplants."""
    for _ in range(choice.randint(1, 8)):
        place = choice.randint(0, len(source))
        length = choice.choice([1, 1, 2, 5, 20, 100])
        match choice.randrange(5):
            case 0:
                source = source[:place] + source[place + length :]
            case 1:
                source = source[:place] + choice.choice(PIECES) + source[place:]
            case 2:
                source = (
                    source[:place]
                    + source[place : place + length] * choice.choice([2, 3, 40])
                    + source[place:]
                )
            case 3:
                other = choice.choice(others)
                start = choice.randint(0, len(other))
                source = source[:place] + other[start : start + length] + source[place:]
            case _:
                source = (
                    source[:place]
                    + choice.choice(PIECES) * choice.choice([3, 50, 400])
                    + source[place:]
                )
    return source[:30_000]


def fuzz(seconds: float, seed: int = 0) -> int:
    """Feed damaged corpus entries to the readers for so long; returns how many crash or hang."""
    corpus = [(path.suffix, path.read_text()) for path in sorted(CORPUS.iterdir())]
    texts = [text for _, text in corpus]
    choice = random.Random(seed)
    end = time.monotonic() + seconds
    failures = count = 0
    while time.monotonic() < end:
        kind, text = choice.choice(corpus)
        source = damage(choice, text, texts)
        begin = time.monotonic()
        try:
            read(kind, source)
        except Exception:
            failures += 1
            print(f"{kind}: {source!r} (seed {seed})")
            traceback.print_exc()
        if time.monotonic() - begin > SLOW_S:
            failures += 1
            print(f"{kind}: {time.monotonic() - begin:.1f} s for {source!r}")
        count += 1
    print(f"{count} damaged inputs in {seconds:.0f} s, {failures} crash or hang", flush=True)
    return failures


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=0, help="against Reelay")
    parser.add_argument("--seconds", type=float, default=0.0, help="of damaged files")
    parser.add_argument("--losses", type=int, default=0, help="formulas, traces and losses")
    parser.add_argument("--seed", type=int, default=0, help="the first one")
    arguments = parser.parse_args()
    failures = fuzz(arguments.seconds, arguments.seed) if arguments.seconds else 0
    if arguments.losses:
        failures += losses.soak(arguments.losses, arguments.seed)
    if arguments.pairs:
        failures += differential.soak(arguments.pairs, arguments.seed)
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
