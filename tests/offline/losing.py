"""Recorded tours of which something was lost: no loss may make a healthy node look broken.

``python -m tests.offline.losing --patterns 10000 --seed S`` tries that many random patterns of loss, and
every single loss, on each of the tours. It ends with 1 if anything is called a violation.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from random import Random

import msgspec

from moon.recording.entries import Entry
from moon.recording.reader import open_recording
from moon.run import Run
from moon.sources.on_time import received_on_time
from moon.sources.played import Player
from moon.sources.source import Outputs
from moon.verdict import Outcome, Verdict
from tests.offline.live import live_run, monitored, program
from transports.interface import Observation, ObservationKind
from transports.simulated import Conditions

RECORDINGS = Path(__file__).parents[1] / "recordings"
UNNUMBERED = ("ros2",)
"""Middlewares whose nodes number what they report per channel only."""


class Tour(msgspec.Struct, frozen=True):
    """A recorded tour in which nothing is wrong.

    Attributes:
        name: what it is called.
        entries: the recording.
        numbered: whether the nodes number all that they report.
    """

    name: str
    entries: tuple[Entry, ...]
    numbered: bool = True

    @property
    def observations(self) -> list[int]:
        """Places of the observations in ``entries``."""
        return [i for i, entry in enumerate(self.entries) if isinstance(entry, Observation)]

    def without(self, lost: Iterable[int]) -> list[Entry]:
        """The recording, had the entries at ``lost`` not been heard."""
        missing = set(lost)
        return [entry for i, entry in enumerate(self.entries) if i not in missing]


def recorded(name: str, case: str = "nominal") -> Tour:
    """One of the golden recordings: of the nominal tour, or of one with a fault."""
    recording = open_recording(RECORDINGS / f"{name}-{case}.mcap", monitored().system.library)
    return Tour(name, tuple(recording.entries()), name not in UNNUMBERED)


def simulated(folder: Path, seconds: float = 40.0, seed: int = 3) -> Tour:
    """A whole tour on virtual time, the alarm included."""
    path = folder / "tour.mcap"
    conditions = Conditions(delay_s=(0.0, 0.01), tap_delay_s=(0.0, 0.01))
    live_run(path, program(), seed, seconds, conditions)
    return Tour("simulated", tuple(open_recording(path, monitored().system.library).entries()))


class _Kept:
    def __init__(self) -> None:
        self.verdicts: list[Verdict] = []

    def take(self, verdict: Verdict) -> None:
        self.verdicts.append(verdict)


def verdicts(entries: Sequence[Entry], properties: bool = False) -> list[Verdict]:
    """What a monitor of all machines and of the tree says of ``entries``."""
    subject = monitored()
    player, kept = Player(subject.bounds.latency), _Kept()
    if not properties:
        subject = msgspec.structs.replace(subject, properties=())
    watch = Run(player, subject, Outputs([kept]))
    for number, entry in enumerate(received_on_time(entries)):
        if number == 0:
            player.start(entry, watch.start)
        player.play(entry)
    player.finish()
    return kept.verdicts


def accusations(entries: Sequence[Entry], properties: bool = False) -> list[str]:
    """The violations among them."""
    return [
        f"{verdict.machine}: {verdict.reason}"
        for verdict in verdicts(entries, properties)
        if verdict.outcome is Outcome.VIOLATED
    ]


# --- patterns of loss ------------------------------------------------------------------------------

Pattern = Callable[[Tour, Random], list[int]]


def _here_and_there(tour: Tour, draw: Random) -> list[int]:
    rate = draw.choice((0.002, 0.01, 0.05, 0.2, 0.5, 0.9))
    return [i for i in tour.observations if draw.random() < rate]


def _for_a_while(tour: Tour, draw: Random) -> list[int]:
    """All, or all of one source, in some windows of time."""
    found = tour.observations
    lost: set[int] = set()
    for _ in range(draw.randint(1, 4)):
        first = draw.choice(found)
        source = _of(tour, first).source if draw.random() < 0.7 else ""
        until_ns = _of(tour, first).stamp_ns + draw.choice((1, 10, 300, 1500, 10**6)) * 1_000_000
        lost |= {
            i
            for i in found
            if i >= first
            and _of(tour, i).stamp_ns <= until_ns
            and source in ("", _of(tour, i).source)
        }
    return sorted(lost)


def _of_a_channel(tour: Tour, draw: Random) -> list[int]:
    """The first, some or all of a few channels, of all sources or of one."""
    lost: set[int] = set()
    for _ in range(draw.randint(1, 3)):
        one = _of(tour, draw.choice(tour.observations))
        alone = draw.random() < 0.5
        found = [
            i
            for i in tour.observations
            if _of(tour, i).channel == one.channel
            and (not alone or (_of(tour, i).source, _of(tour, i).kind) == (one.source, one.kind))
        ]
        lost |= set(found[: draw.choice((1, 1, 2, 5, len(found)))])
    return sorted(lost)


def _of_calls(tour: Tour, draw: Random) -> list[int]:
    """Some of the four reports on a few calls, each on one call all the same."""
    calls = [i for i in tour.observations if _of(tour, i).kind is not ObservationKind.MESSAGE]
    kinds = [kind for kind in ObservationKind if draw.random() < 0.6]
    lost: set[int] = set()
    for _ in range(draw.randint(1, 4)):
        one = _of(tour, draw.choice(calls))
        key = (one.channel, one.client, one.call)
        lost |= {
            i
            for i in calls
            if (_of(tour, i).channel, _of(tour, i).client, _of(tour, i).call) == key
            and _of(tour, i).kind in kinds
        }
    return sorted(lost)


PATTERNS: tuple[Pattern, ...] = (_here_and_there, _for_a_while, _of_a_channel, _of_calls)


def _of(tour: Tour, index: int) -> Observation:
    entry = tour.entries[index]
    assert isinstance(entry, Observation)
    return entry


def pattern(tour: Tour, seed: int) -> list[int]:
    """What is lost of ``tour`` in the random case ``seed``."""
    draw = Random(f"{tour.name} {seed}")
    lost = draw.choice(PATTERNS)(tour, draw)
    if draw.random() < 0.2:
        lost = sorted({*lost, *draw.choice(PATTERNS)(tour, draw)})
    return lost


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Lose observations of healthy tours.")
    parser.add_argument("--patterns", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=int(time.time()), help="of the first pattern")
    parser.add_argument("--every", type=int, default=1, help="each so many-th single loss only")
    parser.add_argument("--tour", default="", help="one of them only")
    arguments = parser.parse_args()
    wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        tours = [recorded("zenoh"), recorded("ros2"), simulated(Path(folder))]
    tours = [tour for tour in tours if arguments.tour in ("", tour.name)]
    for tour in tours:
        for index in tour.observations[:: arguments.every]:
            if found := accusations(tour.without([index])):
                wrong += 1
                print(f"{tour.name} without {tour.entries[index]}: {found[0]}", flush=True)
        print(f"{tour.name}: every single loss tried, {wrong} wrong", flush=True)
    numbered = [tour for tour in tours if tour.numbered]
    for count in range(arguments.patterns if numbered else 0):
        tour, seed = numbered[count % len(numbered)], arguments.seed + count
        if found := accusations(tour.without(pattern(tour, seed))):
            wrong += 1
            print(
                f"{found[0]}\n  again: python -m tests.offline.losing --tour {tour.name} "
                f"--every 1000000 --patterns 1 --seed {seed}",
                flush=True,
            )
        if (count + 1) % 500 == 0:
            print(f"{count + 1} patterns, {wrong} wrong", flush=True)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
