"""Skills that are killed under ``m2c run --restart on-failure``, one every ten seconds: the tour goes on.

``python -m tests.launch.restarts [--transport zenoh|ros2] [--seconds 600] [--every 10] [--all] [--seed N]``. The
lab tour is run and monitored. Every skill has its turn (with ``--all``, every node but the policy), in an order that
``seed`` decides. Ends with 1 if one of them is not started again, if the tour stands still, if the monitor finds a
violation, or if a process that was not killed has more files, threads or memory at the end than it may.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import os
import random
import re
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec

from m2c.rosidl.build import build_interfaces
from tests.monitor.processes import Process, free_endpoint
from tests.transports import ros2_network, shared_memory

ROOT = Path(__file__).parents[2]
LAB_TOUR = ROOT / "examples" / "lab_tour"
BUILT = ROOT / "build" / "interfaces"
VISITED = "SetCurrentPoiDone ok"
"""What stands in a tick's line when a point of interest was visited."""
VISIT_S = 90.0
"""A point of interest is visited at least so often, on a busy machine and with skills that die on the way there."""
TICKS = 10
"""The tree is ticked so often at least between two kills: far less than it would be in ten seconds."""
MORE_FILES = 20
MORE_THREADS = 4
MORE_MIB = 60.0
"""So much more a process may have at the end than after a minute, or a quarter of the time. Files come and go: two
peers are linked once or twice. Memory grows for some minutes, of a monitor by 4 MiB in each, killed nodes or
none."""


class Size(msgspec.Struct, frozen=True):
    """Of a process: open files, threads, resident memory in MiB."""

    files: int
    threads: int
    mib: float

    @classmethod
    def of(cls, pid: int) -> Size:
        status = Path(f"/proc/{pid}/status").read_text()

        def number(field: str) -> int:
            found = re.search(rf"^{field}:\s+(\d+)", status, re.MULTILINE)
            assert found is not None
            return int(found[1])

        files = len(os.listdir(f"/proc/{pid}/fd"))
        return cls(files, number("Threads"), number("VmRSS") / 1024)


def children(pid: int) -> dict[str, int]:
    """The process of each node, of the monitor (``moon``) and of the policy."""
    found = {}
    for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
        words = Path(f"/proc/{child}/cmdline").read_bytes().decode().split("\0")
        name = words[words.index("--node-name") + 1] if "--node-name" in words else "moon"
        found[name] = int(child)
    return found


class Tour:
    """A lab tour that is run and monitored."""

    def __init__(self, arguments: Sequence[str]) -> None:
        of_its_own = ("--processes", "each")  # one is killed at a time
        watched = ("--restart", "on-failure", "--monitor")
        self.run = Process("m2c", "run", LAB_TOUR / "system.xml", *of_its_own, *watched, *arguments)
        self.run.until(lambda: self.ticks > TICKS)

    @property
    def ticks(self) -> int:
        """How often the tree was ticked."""
        for line in reversed(self.run.out):
            if line.startswith("tick "):
                return int(line.split()[1])
        return 0

    def kill(self, node: str) -> str:
        """Kill ``node``, and wait until it was started again; what was wrong, or ""."""
        before = len(self.run.out)
        os.kill(children(self.run.process.pid)[node], signal.SIGKILL)
        said = f"{node} was killed by SIGKILL; it is started again."
        try:
            self.run.until(lambda: any(said in line for line in self.run.out[before:]))
        except AssertionError:
            return f"{node} was killed and is not started again"
        return ""

    def sizes(self) -> dict[str, Size]:
        """Of all its processes, the launcher included."""
        pid = self.run.process.pid
        found = children(pid)
        return {name: Size.of(child) for name, child in {"m2c": pid, **found}.items()}


def grown(before: dict[str, Size], after: dict[str, Size], killed: set[str]) -> Iterator[str]:
    """Who has more at the end than it may."""
    for name, size in after.items():
        if name in killed:
            continue
        at = before[name]
        more = (size.files - at.files, size.threads - at.threads, size.mib - at.mib)
        print(f"  {name:<28} {at.files:3} → {size.files:3} files, {at.threads:2} → {size.threads:2} threads, "
              f"{at.mib:6.1f} → {size.mib:6.1f} MiB")  # fmt: skip
        if more[0] > MORE_FILES or more[1] > MORE_THREADS or more[2] > MORE_MIB:
            yield f"{name} had {at}, and has {size}"


def tour(
    arguments: Sequence[str], seconds: float, every_s: float, of_all: bool, seed: int
) -> list[str]:
    """Run the tour for ``seconds``, with a node killed every ``every_s``; what was wrong."""
    wrong: list[str] = []
    it = Tour(arguments)
    with contextlib.closing(it.run):
        nodes = sorted(set(children(it.run.process.pid)) - {"moon", "policy"})
        nodes = [name for name in nodes if of_all or name.endswith("Skill")]
        assert nodes, "the nodes have no processes of their own"
        random.Random(seed).shuffle(nodes)
        began_s = time.monotonic()
        before: dict[str, Size] | None = None
        killed: set[str] = set()
        for number, node in enumerate(itertools.cycle(nodes)):
            due_s = began_s + number * every_s
            if due_s > began_s + seconds or wrong:
                break
            if before is None and due_s > began_s + min(seconds / 4, 60.0):
                before = it.sizes()
            with contextlib.suppress(AssertionError):  # it ends before: the exit code says why
                it.run.until(lambda: False, max(due_s - time.monotonic(), 0.0))
            ticks = it.ticks
            wrong += filter(None, [it.kill(node)])
            killed.add(node)
            try:
                it.run.until(lambda: it.ticks >= ticks + TICKS)  # noqa: B023
            except AssertionError:
                wrong.append(f"the tree is not ticked any more, {node} was killed last")
        with contextlib.suppress(AssertionError):
            it.run.until(lambda: False, every_s)
        passed_s = time.monotonic() - began_s
        if it.run.process.poll() is None and before is not None:
            wrong += grown(before, it.sizes(), killed)
        code = it.run.end(signal.SIGINT)
        visits = sum(VISITED in line for line in it.run.out)
        print(
            f"{number} kills, {it.ticks} ticks, {visits} points of interest visited in {passed_s:.0f} s"
        )
        if visits < passed_s // VISIT_S:
            wrong.append(f"only {visits} points of interest were visited in {passed_s:.0f} s")
        print("\n".join(line for line in it.run.out if "moon | " in line and not _is_passing(line)))
        if code or wrong:
            wrong.append(f"m2c run ended with {code}; its last lines:")
            wrong += it.run.said.splitlines()[-60:]
    return wrong


def _is_passing(line: str) -> bool:
    """Whether a monitor's line says what is to be expected of nodes that come and go."""
    return any(word in line for word in ("linked to", "has started again", "  conforming"))


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.launch.restarts", description=__doc__)
    parser.add_argument("--transport", choices=("zenoh", "ros2"), default="zenoh")
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--every", type=float, default=10.0, help="seconds between two kills")
    parser.add_argument("--all", action="store_true", help="kill components, too")
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args(arguments)
    with contextlib.ExitStack() as around:
        options = ["--transport", chosen.transport]
        if chosen.transport == "zenoh":
            options += ["--endpoint", free_endpoint()]
        else:
            shared_memory.separate()
            around.enter_context(ros2_network.own_domain())
            os.environ.update(
                build_interfaces([LAB_TOUR / "interfaces"], BUILT).environment(os.environ)
            )
        wrong = tour(options, chosen.seconds, chosen.every, chosen.all, chosen.seed)
    for sentence in wrong:
        print(sentence)
    print("wrong" if wrong else "the tour went on, and nothing was left behind")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
