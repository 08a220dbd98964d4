"""What a tick of the lab tour costs in one process, in two, and with one for each node; monitored and not.

The tick is that of ``PolicyRunner``: five skills are called, two of which call a component: seven calls.
The floor is BehaviorTree.CPP with the same leaves as plain functions.
"""

from __future__ import annotations

import contextlib
import functools
import itertools
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.page import Row, beside, command
from benchmarks.processes import BIN, ROOT, Child, free_endpoint, say
from benchmarks.sampling import Block, measured
from benchmarks.ticking import at_rate
from m2c.launch.description import read_description, read_policy_of
from m2c.launch.grouping import Group, grouped
from transports.options import LAUNCHER

SYSTEM = ROOT / "examples/lab_tour/system.xml"
RATES = {10.0: 100, 0.0: 1000}
"""Ticks that are made at each rate (a second; 0: saturated)."""
WARM_UP = 20
MOST_MS = {10.0: 1.5, 0.0: 0.8}
MOST_MONITORED = 1.15
_AT_ONCE_HZ = 1e6


def inside(arguments: list[str]) -> None:
    """Run a process of the system, and say at its end how long each tick of its policy took."""
    from m2c.launch import composed
    from m2c.policy.runner import PolicyRunner, TreeTick

    millis: list[float] = []
    tick = PolicyRunner.tick

    def timed(runner: PolicyRunner) -> TreeTick:
        began = time.perf_counter()
        record = tick(runner)
        millis.append((time.perf_counter() - began) * 1e3)
        return record

    PolicyRunner.tick = timed  # type: ignore[method-assign]
    try:
        composed.main(arguments)
    finally:
        say({"millis": millis})


def started(stack: contextlib.ExitStack, folder: Path, group: Group, words: list[str]) -> Child:
    """A process of the generated system."""
    path = os.pathsep.join(str(folder / package.path) for package in group.packages)
    for node in group.nodes:
        words = [*words, "--node", f"{node.name}={node.package}"]
    if group.policy is not None:
        words += ["--policy", f"{group.policy.name}={group.policy.package}"]
    return stack.enter_context(
        Child.calling(group.name, inside, words, environment={"PYTHONPATH": path})
    )


def ticks(
    folder: Path,
    processes: int | None,
    rate_hz: float,
    is_monitored: bool = False,
    keys: Path | None = None,
) -> list[float]:
    """How long each tick took, in ms; with the certificates in ``keys`` if they are given."""
    from transports.registry import connect

    endpoint, secure = free_endpoint(), {}
    if keys is not None:
        endpoint, secure = endpoint.replace("tcp/", "tls/"), {"secure": str(keys)}
    description = read_description(folder)
    with contextlib.ExitStack() as stack:
        meeting = connect("zenoh", LAUNCHER, {"listen": endpoint, **secure})
        stack.enter_context(contextlib.closing(meeting))
        meeting.announce()
        if is_monitored:
            arguments = ["-m", "moon.cli", "monitor", str(SYSTEM), "--endpoint", endpoint]
            monitor = stack.enter_context(Child("moon", arguments))
            monitor.wait_for(lambda line: "linked to" in line and "not" not in line)
        policy = None
        for group in grouped(description, processes):
            words = ["--endpoint", endpoint]
            words += ["--secure", str(keys)] if keys is not None else []
            if group.policy is not None:
                words += ["--rate", str(rate_hz or _AT_ONCE_HZ)]
                words += ["--ticks", str(RATES[rate_hz] + WARM_UP)]
                for node in description.nodes:
                    words += ["--wait-for", node.name]
            child = started(stack, folder, group, words)
            policy = child if group.policy is not None else policy
        assert policy is not None
        took: list[float] = policy.answer()["millis"]
    return took[WARM_UP:]


def floor(folder: Path) -> list[float]:
    """The same tree in BehaviorTree.CPP, whose leaves are functions that return at once; in ms."""
    import behaviortreepy

    from m2c.policy.ticking import tick_tree

    policy = read_policy_of(read_description(folder), folder)
    assert policy is not None
    statuses = behaviortreepy.NodeStatus
    running, failing = {"GoToPoi"}, {"IsPoiDone1", "IsPoiDone2"}
    factory = behaviortreepy.BehaviorTreeFactory()
    for leaf in policy.leaves:
        status = statuses.RUNNING if leaf.name in running else statuses.SUCCESS
        status = statuses.FAILURE if leaf.name in failing else status

        def tick(_: Any, status: Any = status) -> Any:
            return status

        if leaf.action:
            factory.register_simple_stateful_action(leaf.id, tick, tick, lambda _: None)
        else:
            factory.register_simple_condition(leaf.id, tick)
    factory.register_behavior_tree_from_text(policy.xml)
    tree = factory.create_tree(policy.main)
    took = []
    for _ in range(WARM_UP + RATES[0.0]):
        began = time.perf_counter()
        tick_tree(tree, False)
        took.append((time.perf_counter() - began) * 1e3)
    return took[WARM_UP:]


SECURED = "with --secure"
NAMES = {1: "one process", 2: "two processes", None: "one for each node"}


@contextlib.contextmanager
def generated() -> Iterator[Path]:
    """The lab tour's packages."""
    from m2c.codegen.package import system_files
    from m2c.codegen.writer import write_files
    from m2c.model import DiagnosticLog, load

    system = load([SYSTEM], DiagnosticLog())
    assert system is not None
    with tempfile.TemporaryDirectory() as scratch:
        write_files(system_files(system), Path(scratch))
        yield Path(scratch)


def rows(rounds: int = 1) -> list[Row]:
    """What is shown, of so many rounds."""
    with generated() as folder, tempfile.TemporaryDirectory() as keys:
        secured = Path(keys) / "keys"
        subprocess.run(
            [BIN / "moon", "keys", "init", secured, SYSTEM], check=True, stdout=sys.stderr
        )
        turns: dict[Any, Any] = {"floor": functools.partial(floor, folder)}
        for rate_hz, processes, is_monitored in itertools.product(RATES, NAMES, (False, True)):
            turn = functools.partial(ticks, folder, processes, rate_hz, is_monitored)
            turns[rate_hz, processes, is_monitored] = turn
        for rate_hz in RATES:
            turns[rate_hz, SECURED] = functools.partial(ticks, folder, None, rate_hz, keys=secured)
        found: dict[Any, list[Block]] = measured(turns, rounds)
    shown = []
    for rate_hz, processes in itertools.product(RATES, NAMES):
        plain, watched = (found[rate_hz, processes, is_it] for is_it in (False, True))
        what = f"a tick of the lab tour {'at ' if rate_hz else ''}{at_rate(rate_hz)}, {NAMES[processes]}, p50"
        most = MOST_MS[rate_hz] if processes else None
        tree = "BehaviorTree.CPP with functions"
        shown.append(beside(what, "ms", plain, tree, found["floor"], most, is_of_value=True))
        most = MOST_MONITORED if processes else None
        shown.append(beside("the same monitored", "ms", watched, "unmonitored", plain, most))
        if processes is None:
            ours = found[rate_hz, SECURED]
            shown.append(beside("the same with --secure", "ms", ours, "without", plain))
    return shown


if __name__ == "__main__":
    sys.exit(command(rows))
