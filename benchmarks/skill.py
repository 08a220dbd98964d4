"""What a tap and all model monitors cost a tick: the lab tour's BatteryLevelSkill, on Zenoh and on ROS 2.

The skill is the generated node in a process of its own; the ticks come from this process, as the policy's
do; in a third nothing, ``moon tap`` of everything, or ``moon monitor`` of the whole lab tour. The three take
turns.

Usage: ``python -m benchmarks.skill [--transport zenoh|ros2] [--rate HZ] [--rounds N] [--ticks N]``.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import tempfile
import threading
import time
from pathlib import Path

import msgspec

from benchmarks.page import Row, publish
from benchmarks.processes import ROOT, Child, free_endpoint, spinning
from benchmarks.sampling import distribution, ratio, rounds
from m2c.codegen.package import system_files
from m2c.codegen.writer import write_files
from m2c.model import DiagnosticLog, load
from m2c.rosidl.build import begin_again_with
from m2c.runtime.messages import message_class
from transports.interface import CallOutcome, Client, Service
from transports.registry import connect

SYSTEM = ROOT / "examples/lab_tour/system.xml"
SKILL, PACKAGE = "BatteryLevelSkill", "battery_level_skill"
ALONE = "no monitor"
MODES = {ALONE: [], "tap": ["tap"], "all monitors": ["monitor", str(SYSTEM)]}
"""Arguments of ``moon`` in the third process; none: there is no third process."""
NAMES = {"zenoh": "Zenoh", "ros2": "ROS 2"}
TARGET = 1.10


def block(client: Client, request: msgspec.Struct, rate_hz: float, ticks: int) -> list[float]:
    """Latencies of ``ticks`` ticks, in µs."""
    found = []
    due = time.perf_counter()
    pause = threading.Event()
    for _ in range(ticks):
        due += 1 / rate_hz
        pause.wait(max(0.0, due - time.perf_counter()))
        began = time.perf_counter()
        result = client.call_and_wait(request)
        found.append((time.perf_counter() - began) * 1e6)
        assert result.outcome is CallOutcome.RESPONSE, result
    return found


def measure(transport: str, rate_hz: float, count: int, ticks: int) -> list[Row]:
    """A tick by who listens, in ``count`` rounds."""
    system = load([SYSTEM], DiagnosticLog())
    assert system is not None
    kind = system.library.service("bt_interfaces/srv/TickCondition")
    request, response = message_class(kind.request), message_class(kind.response)
    meeting = free_endpoint() if transport == "zenoh" else ""
    policy = connect(transport, "policy", {"listen": meeting} if meeting else {})
    where = ["--transport", transport, *(["--endpoint", meeting] if meeting else [])]
    client = policy.client(Service(f"/{SKILL}/tick", kind.name, request, response))
    taken: dict[str, list[list[float]]] = {mode: [] for mode in MODES}
    with contextlib.ExitStack() as stack:
        scratch = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        stack.enter_context(spinning(policy))
        write_files(system_files(system), scratch)
        policy.announce()
        path = os.pathsep.join([str(scratch / PACKAGE), os.environ.get("PYTHONPATH", "")])
        stack.enter_context(Child(SKILL, ["-m", PACKAGE, *where], {"PYTHONPATH": path}))
        assert not policy.wait_for_nodes([SKILL], 60.0), "the skill does not come up"
        block(client, request(), rate_hz, 20)
        for _, mode in rounds(list(MODES), count, seed=1):
            with contextlib.ExitStack() as turn:
                if MODES[mode]:
                    arguments = ["-m", "moon.cli", *MODES[mode], "--json", *where]
                    moon = turn.enter_context(Child("moon", arguments))
                    moon.wait_for(lambda line: line.startswith("linked to") and SKILL in line)
                block(client, request(), rate_hz, 10)
                taken[mode].append(block(client, request(), rate_hz, ticks))
    median = {mode: distribution(blocks).p50.value for mode, blocks in taken.items()}
    rows = []
    for mode in list(MODES)[1:]:
        found = ratio(taken[mode], taken[ALONE])
        interval = f"(95 %: {found.low:.2f} to {found.high:.2f})"
        what = f"a tick on {NAMES[transport]} at {rate_hz:g} ticks/s, {mode}, p50 {interval}"
        rows.append(Row(what, median[mode], "µs", ALONE, median[ALONE], found.value, most=TARGET))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--transport", choices=("zenoh", "ros2"), action="append")
    parser.add_argument("--rate", type=float, default=10.0)
    parser.add_argument("--rounds", type=int, default=6)
    parser.add_argument("--ticks", type=int, default=50)
    options = parser.parse_args()
    wanted = options.transport or ["zenoh", "ros2"]
    if "ros2" in wanted:
        begin_again_with([SYSTEM.parent / "interfaces"], ROOT / "build" / "interfaces")
        os.environ.setdefault("ROS_DOMAIN_ID", str(os.getpid() % 100 + 1))
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    publish(
        [
            row
            for name in wanted
            for row in measure(name, options.rate, options.rounds, options.ticks)
        ]
    )


if __name__ == "__main__":
    main()
