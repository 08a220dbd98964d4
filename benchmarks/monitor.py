"""What all model monitors cost a tick: the lab tour's BatteryLevelSkill, ticked with and without.

The skill is the generated node in a process of its own; the ticks come from this process, as the
policy's do; the monitor is ``moon monitor`` of the whole lab tour in a third. Blocks without and with
it alternate, so that the machine's moods hit both alike. Loopback only.

Usage: ``python benchmarks/monitor.py [--rate HZ] [--blocks N] [--ticks N]``.
"""

from __future__ import annotations

import argparse
import os
import random
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import msgspec
from loopback import free_endpoint, moon_hearing, spinning
from row import publish, slower

from m2c.codegen.package import system_files
from m2c.codegen.writer import write_files
from m2c.model import DiagnosticLog, load
from m2c.runtime.messages import message_class
from transports.interface import CallOutcome, Client, Service
from transports.zenoh import connect

SYSTEM = Path(__file__).parents[1] / "examples/lab_tour/system.xml"
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


def interval(values: list[list[float]], others: list[list[float]]) -> tuple[float, float]:
    """95 % bootstrap interval of the ratio of medians (blocks resampled with their ticks)."""
    draw = random.Random(1)
    ratios = []
    for _ in range(1000):
        first = [v for b in draw.choices(values, k=len(values)) for v in draw.choices(b, k=len(b))]
        second = [v for b in draw.choices(others, k=len(others)) for v in draw.choices(b, k=len(b))]
        ratios.append(statistics.median(first) / statistics.median(second))
    ratios.sort()
    return ratios[25], ratios[974]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rate", type=float, default=10.0)
    parser.add_argument("--blocks", type=int, default=6)
    parser.add_argument("--ticks", type=int, default=50)
    options = parser.parse_args()
    system = load([SYSTEM], DiagnosticLog())
    assert system is not None
    kind = system.library.service("bt_interfaces/srv/TickCondition")
    request, response = message_class(kind.request), message_class(kind.response)
    tick = Service("/BatteryLevelSkill/tick", kind.name, request, response)
    where = free_endpoint()
    policy = connect("policy", {"listen": where})
    with tempfile.TemporaryDirectory() as scratch, spinning(policy):
        write_files(system_files(system), Path(scratch) / "generated")
        folder = Path(scratch) / "generated/battery_level_skill"
        node = subprocess.Popen(
            [sys.executable, "-m", "battery_level_skill", "--endpoint", where],
            env={**os.environ, "PYTHONPATH": str(folder)},
        )
        try:
            missing = policy.wait_for_nodes(["BatteryLevelSkill"], 30.0)
            assert not missing, "the skill does not come up"
            client = policy.client(tick)
            policy.announce()
            block(client, request(), options.rate, 20)
            bare: list[list[float]] = []
            monitored: list[list[float]] = []
            for _ in range(options.blocks):
                bare.append(block(client, request(), options.rate, options.ticks))
                with moon_hearing("BatteryLevelSkill", "monitor", SYSTEM, "--endpoint", where):
                    block(client, request(), options.rate, 5)
                    monitored.append(block(client, request(), options.rate, options.ticks))
        finally:
            node.terminate()
            node.wait()
    without = [v for part in bare for v in part]
    within = [v for part in monitored for v in part]
    ratio = statistics.median(within) / statistics.median(without)
    low, high = interval(monitored, bare)
    print(f"{options.rate:g} ticks/s, {len(without)} ticks each")
    for name, values in (("no monitor", without), ("all monitors", within)):
        ordered = sorted(values)
        print(
            f"{name:<14}p50 {statistics.median(values):7.0f} µs   "
            f"p99 {ordered[int(len(ordered) * 0.99)]:7.0f} µs"
        )
    print(f"ratio         {ratio:.2f}  (95 % {low:.2f} to {high:.2f}; target ≤ {TARGET:.2f})")
    publish(
        [
            slower(
                f"a tick at {options.rate:g} ticks/s, all models monitored, p50 "
                f"(95 % of the ratio: {low:.2f} to {high:.2f})",
                statistics.median(within),
                "µs",
                "no monitor",
                statistics.median(without),
                TARGET,
            )
        ]
    )


if __name__ == "__main__":
    main()
