"""What a tap and all model monitors cost a tick on ROS 2: the lab tour's BatteryLevelSkill, ticked.

The skill is the generated node in a process of its own; the ticks come from this process, as the
policy's do; in a third nothing, ``moon tap`` of everything, or ``moon monitor`` of the whole lab tour. The
three take turns, so that the machine's moods hit them alike. Loopback only. (``monitor.py`` has the same on
Zenoh.)

Usage: ``python benchmarks/ros2_monitor.py [--rate HZ] [--blocks N] [--ticks N]``.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

from loopback import moon_hearing, spinning
from monitor import SYSTEM, TARGET, block, interval
from row import publish, slower

from m2c.codegen.package import system_files
from m2c.codegen.writer import write_files
from m2c.model import DiagnosticLog, load
from m2c.rosidl.build import begin_again_with
from m2c.runtime.messages import message_class
from transports.interface import Service

ROOT = SYSTEM.parents[2]
READY_S = 60.0
MODES = {
    "no monitor": [],
    "tap": ["tap", "--json"],
    "all monitors": ["monitor", str(SYSTEM), "--json"],
}
"""Arguments of ``moon`` in the third process; none: there is no third process."""


def listening(mode: str) -> AbstractContextManager[None]:
    """``moon`` at work, from when it hears the skill to its end."""
    if not MODES[mode]:
        return nullcontext()
    return moon_hearing("BatteryLevelSkill", *MODES[mode], "--transport", "ros2")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rate", type=float, default=10.0)
    parser.add_argument("--blocks", type=int, default=6)
    parser.add_argument("--ticks", type=int, default=50)
    options = parser.parse_args()
    begin_again_with([SYSTEM.parent / "interfaces"], ROOT / "build" / "interfaces")
    from transports.ros2 import connect

    os.environ.setdefault("ROS_DOMAIN_ID", str(os.getpid() % 100 + 1))
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    system = load([SYSTEM], DiagnosticLog())
    assert system is not None
    kind = system.library.service("bt_interfaces/srv/TickCondition")
    request, response = message_class(kind.request), message_class(kind.response)
    tick = Service("/BatteryLevelSkill/tick", kind.name, request, response)
    found: dict[str, list[list[float]]] = {mode: [] for mode in MODES}
    policy = connect("policy", {})
    client = policy.client(tick)
    with tempfile.TemporaryDirectory() as scratch, spinning(policy):
        write_files(system_files(system), Path(scratch) / "generated")
        policy.announce()
        folder = Path(scratch) / "generated/battery_level_skill"
        path = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])
        node = subprocess.Popen(
            [sys.executable, "-m", "battery_level_skill", "--transport", "ros2"],
            env={**os.environ, "PYTHONPATH": path},
        )
        try:
            assert not policy.wait_for_nodes(["BatteryLevelSkill"], READY_S), "it does not come up"
            block(client, request(), options.rate, 20)
            for _ in range(options.blocks):
                for mode, blocks in found.items():
                    with listening(mode):
                        block(client, request(), options.rate, 10)
                        blocks.append(block(client, request(), options.rate, options.ticks))
        finally:
            node.terminate()
            node.wait()
    report(found, options.rate)


def report(found: dict[str, list[list[float]]], rate_hz: float) -> None:
    """Print and publish the figures."""
    values = {mode: [value for part in parts for value in part] for mode, parts in found.items()}
    alone = statistics.median(values["no monitor"])
    print(f"{rate_hz:g} ticks/s, {len(values['no monitor'])} ticks each")
    rows = []
    for mode, taken in values.items():
        median, last = statistics.median(taken), sorted(taken)[int(len(taken) * 0.99)]
        print(f"{mode:<14}p50 {median:7.0f} µs   p99 {last:7.0f} µs")
        if mode == "no monitor":
            continue
        low, high = interval(found[mode], found["no monitor"])
        print(
            f"  ratio       {median / alone:.2f}  (95 % {low:.2f} to {high:.2f}; "
            f"target ≤ {TARGET:.2f})"
        )
        what = (
            f"a tick on ROS 2 at {rate_hz:g} ticks/s, {mode}, p50 (95 %: {low:.2f} to {high:.2f})"
        )
        rows.append(slower(what, median, "µs", "no monitor", alone, TARGET))
    publish(rows)


if __name__ == "__main__":
    main()
