"""One observation lost, of every kind and at every place of random small systems: nobody is accused.

``python -m tests.offline.single_losses [SYSTEMS] [FIRST]`` tries every single loss of that many systems.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from moon.recording.entries import Entry
from moon.verdict import Outcome
from tests.offline.small_systems import judged, ordered_only, per_channel, run
from transports.interface import Observation

FORMS = {"reports": tuple, "order": ordered_only, "channels": per_channel}
"""How the nodes' doing is told: all in order with what they take, without that, or numbered per channel."""


def accusations(seed: int, form: str, every: int = 1) -> Iterator[str]:
    """Who is accused of what as one of ``every`` so many observations of the system ``seed`` is lost."""
    with tempfile.TemporaryDirectory() as folder:
        found = run(Path(folder), seed)
        entries: tuple[Entry, ...] = FORMS[form](found.entries)
        seen = [i for i, entry in enumerate(entries) if isinstance(entry, Observation)]
        for place in (None, *seen[seed % every :: every]):
            left = [entry for i, entry in enumerate(entries) if i != place]
            for verdict in judged(found.subject, left):
                if verdict.outcome is Outcome.VIOLATED:
                    lost = "nothing" if place is None else f"{place}: {entries[place]}"
                    yield f"seed {seed}, {form}, lost {lost}: {verdict.machine} {verdict.reason}"
                    break


def kinds(seed: int) -> set[str]:
    """Channel and kind of all that is observed of the system ``seed``."""
    with tempfile.TemporaryDirectory() as folder:
        entries = run(Path(folder), seed).entries
    return {f"{entry.channel} {entry.kind}" for entry in entries if isinstance(entry, Observation)}


def main(arguments: list[str]) -> int:
    """The command line; the exit code."""
    count = int(arguments[0]) if arguments else 20
    first = int(arguments[1]) if len(arguments) > 1 else 0
    wrong = 0
    for seed in range(first, first + count):
        for form in FORMS:
            for text in accusations(seed, form):
                wrong += 1
                print(text, flush=True)
        print(f"{seed}: {wrong} wrong", flush=True)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
