"""Attacks on live lab tours, for hours: ``python -m tests.attacks.soak --seconds 3600 [--seed S]``.

A round is a fresh tour with monitor and recorder, and some attacks on it, alone and together, which the round's seed
decides. Prints a line a round; of the first that fails what failed, and the command that repeats that round. Exit
code 1 then.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from tests.attacks.lab import Lab
from tests.attacks.strangers import ATTACKS

ROUND_S = 60.0
"""How long the attacks of one round take."""
MOST_AT_ONCE = 3
MOST_S = 15.0
"""How long one attack goes on at most."""


def attack_round(seed: int, seconds: float) -> dict[str, float]:
    """One tour, attacked for so many seconds; what each process took at most (MB).

    Raises:
        AssertionError: something does not hold that must.
    """
    chosen = random.Random(seed)
    with tempfile.TemporaryDirectory(prefix="attacks") as scratch:
        lab = Lab(Path(scratch))
        try:
            left_s = seconds
            while left_s > 0:
                names = chosen.sample(sorted(ATTACKS), chosen.randint(1, MOST_AT_ONCE))
                takes_s = min(chosen.uniform(1.0, MOST_S), left_s)
                left_s -= takes_s
                lab.attack(names, chosen.getrandbits(32), takes_s)
            lab.end()
            return lab.peaks
        finally:
            lab.close()


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; the exit code."""
    parser = argparse.ArgumentParser(prog="tests.attacks.soak", description=__doc__)
    parser.add_argument("--seconds", type=float, default=3600.0)
    parser.add_argument("--seed", type=int, default=None, help="of the first round (default: any)")
    options = parser.parse_args(arguments)
    seed = int(time.time()) if options.seed is None else options.seed
    end_s = time.monotonic() + options.seconds
    while (left_s := end_s - time.monotonic()) > 0:
        seconds = min(ROUND_S, left_s)
        try:
            peaks = attack_round(seed, seconds)
        except AssertionError as error:
            print(f"round {seed} failed: {error}")
            print(f"again: python -m tests.attacks.soak --seconds {seconds:.0f} --seed {seed}")
            return 1
        most = max(peaks, key=lambda name: peaks[name])
        print(f"round {seed}: all held; {most} took the most, {peaks[most]:.0f} MB", flush=True)
        seed += 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
