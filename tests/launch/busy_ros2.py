"""A system of a new user's size on ROS 2, monitored beside two busy processes: no alarm without a fault, each fault found.

``python -m tests.launch.busy_ros2 [RUNS] [--system FILE --interfaces FOLDER] [--ticks N] [--seconds S]`` runs the greenhouse
(``tests.launch.greenhouse``) so many times as it is, then once with each of its five faults. With ``--system`` another
system is run, without faults. Ends with 1 if a run without a fault was violated, or a fault was not found.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from examples.lab_tour.faults.busy import busy
from m2c.rosidl.build import build_interfaces
from tests.launch import greenhouse
from tests.transports import ros2_network, shared_memory

ROOT = Path(__file__).parents[2]
BUILD = ROOT / "build" / "greenhouse-interfaces"
BUILD_OF_ANOTHER = ROOT / "build" / "busy-interfaces"
RUN_TIMEOUT_S = 300.0
"""A run that takes longer hangs."""


def violated(
    system: Path, environment: Mapping[str, str], ticks: int, more: Sequence[str] = ()
) -> tuple[set[str], str]:
    """Who was violated in one run of ``system``, and what the run printed.

    Args:
        system: the system file.
        environment: of the run.
        ticks: of the tree.
        more: further options of ``m2c run``.
    """
    command = [
        sys.executable,
        "-m",
        "m2c.cli",
        "run",
        "--transport",
        "ros2",
        "--quiet",
        "--monitor",
    ]
    done = subprocess.run(
        [*command, "--ticks", str(ticks), *more, str(system)],
        env=dict(environment), capture_output=True, text=True, timeout=RUN_TIMEOUT_S, check=False,
    )  # fmt: skip
    printed = done.stdout + done.stderr
    said = [line.split() for line in printed.splitlines()]
    found = {words[words.index("VIOLATED") - 1] for words in said if "VIOLATED" in words}
    if done.returncode and not found:
        print(f"the run ended with {done.returncode}\n{printed}", flush=True)
    if "ticking the tree" not in printed:
        raise RuntimeError("the system did not come up")
    return found, printed


CERTAIN = 30
"""So many ticks more has a run with a fault: a violation that a late report on a call could explain becomes
certain 5 s after it (``LINKED_NS``), if no report comes."""


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; the exit code."""
    parser = argparse.ArgumentParser(description="A system on ROS 2 beside two busy processes.")
    parser.add_argument("runs", type=int, nargs="?", default=100)
    parser.add_argument("--system", type=Path, help="another system's file")
    parser.add_argument("--interfaces", type=Path, help="its interface packages")
    parser.add_argument("--ticks", type=int, default=40)
    parser.add_argument("--seconds", type=float, default=float("inf"), help="begin no run later")
    parser.add_argument("--faults", action=argparse.BooleanOptionalAction, default=True)
    chosen = parser.parse_args(arguments)
    shared_memory.separate()
    began_s = time.monotonic()
    wrong = runs = 0
    with tempfile.TemporaryDirectory() as name, busy(2), ros2_network.own_domain():
        folder = Path(name)
        system = chosen.system or greenhouse.write(folder)
        if chosen.interfaces is None:
            built = build_interfaces([folder / "interfaces"], BUILD)
        else:
            built = build_interfaces([chosen.interfaces], BUILD_OF_ANOTHER)
        environment = {**os.environ, **built.environment()}
        for number in range(chosen.runs):
            if time.monotonic() - began_s > chosen.seconds:
                break
            runs += 1
            found, printed = violated(system, environment, chosen.ticks)
            wrong += bool(found)
            print(f"{number}: {', '.join(sorted(found)) or 'nobody'}", flush=True)
            if found:
                print(printed, flush=True)
        print(f"{wrong} of {runs} runs without a fault were violated", flush=True)
        faults = greenhouse.FAULTS if chosen.system is None and chosen.faults else {}
        for what, fault in faults.items():
            path = greenhouse.write_faulty(folder, fault)
            replace = ["--replace", f"{fault.node}={path}"]
            found, printed = violated(system, environment, chosen.ticks + CERTAIN, replace)
            print(f"{what}: {', '.join(sorted(found)) or 'nobody'}", flush=True)
            if fault.node not in found:
                wrong += 1
                print(printed, flush=True)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
