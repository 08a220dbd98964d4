"""What is too long for every change, with fresh seeds: ``python -m tests.soak`` (``make soak``), hours.

The oracle against a brute-force checker, properties against Reelay and their readers against damaged
files and lost observations, recordings of every form damaged, the nominal tour under every condition, on a
busy machine and with observations lost, systems and circumstances made at random, strangers against a live tour, models of hostile text, nodes started
and stopped a thousand times, skills killed for ten minutes and started again, and what is tested on ROS 2
twenty times. A step that fails prints the command that repeats it, and the others go on; exit code 1 then.
"""

from __future__ import annotations

import argparse
import random
import shlex
import subprocess
import sys
from collections.abc import Sequence

from tests.systems import SYSTEMS

SEEDS = 2**31
"""A fresh seed is less: it, and the seeds counted up from it, are a machine's integers everywhere."""
LONG_PROPERTIES = ("--pairs", "100000", "--losses", "200000", "--seconds", "600")
CAMPAIGN = 4000
"""Systems made at random; each is run under five circumstances."""
ROUNDS = 10
"""So often every property that hypothesis tests is tested with other examples."""


def steps(seed: int) -> list[list[str]]:
    """The command lines of all steps, for ``sys.executable``."""
    first = str(seed)
    pytest = ["-m", "pytest", "-q", "-n", "2", "-m", "hypothesis", "--hypothesis-profile", "soak"]
    return [
        ["-m", "tests.oracle.agreement", "--pairs", "100000", "--first", first],
        ["-m", "tests.oracle.agreement", "--nested", "--pairs", "20000", "--first", first],
        ["-m", "tests.oracle.agreement", "--delays", "--pairs", "10000", "--first", first],
        [
            "-m",
            "tests.oracle.agreement",
            "--delays",
            "--nested",
            "--pairs",
            "2000",
            "--first",
            first,
        ],
        *(
            ["-m", "tests.oracle.test_no_false_alarm", "10000", first, "--system", name]
            for name in SYSTEMS
        ),
        ["-m", "tests.properties.soak", *LONG_PROPERTIES, "--seed", first],
        ["-m", "tests.offline.losing", "--patterns", "10000", "--seed", first],
        ["-m", "tests.offline.single_losses", "200", first],
        ["-m", "tests.attacks.soak", "--seconds", "3600", "--seed", first],
        ["-m", "tests.recording.damage", "--seconds", "1800", "--seed", first],
        ["-m", "pytest", "-q", "-n", "2", "--dist", "loadfile", "-m", "soak"],
        *([*pytest, "--hypothesis-seed", str(seed + number)] for number in range(ROUNDS)),
        ["examples/lab_tour/faults/run.py", "--nominal", "1800", "--busy", "2"],
        ["-m", "tests.campaign.differential", first, str(CAMPAIGN)],
        ["-m", "tests.campaign", "--seeds", f"{first}:{seed + CAMPAIGN}"],
        ["-m", "tests.hostile.soak", "20000", "--seed", first],
        ["-m", "tests.codegen.limits", "--models", "20000", "--seed", first],
        *(
            ["-m", "tests.launch.starts", "--transport", name, "--seed", first]
            for name in ("zenoh", "ros2")
        ),
        ["-m", "tests.launch.restarts", "--seed", first],
        ["-m", "tests.transports.ros2_soak", "20"],
        ["-m", "tests.launch.busy_ros2", "100"],
    ]


def soak(commands: Sequence[Sequence[str]]) -> list[str]:
    """Run ``commands`` one after the other; those that failed, as they are typed."""
    failed = []
    for arguments in commands:
        typed = shlex.join(["python", *arguments])
        print(f"--- {typed}", flush=True)
        if subprocess.run([sys.executable, *arguments], check=False).returncode:
            failed.append(typed)
            print(f"--- failed; this repeats it: {typed}", flush=True)
    return failed


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.soak", description=__doc__)
    parser.add_argument("--seed", type=int, help="of all steps; by default a fresh one")
    chosen = parser.parse_args(arguments).seed
    seed = random.SystemRandom().randrange(SEEDS) if chosen is None else chosen
    print(f"--- the seed is {seed}", flush=True)
    failed = soak(steps(seed))
    for typed in failed:
        print(f"failed: {typed}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
