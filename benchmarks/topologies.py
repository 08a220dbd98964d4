"""A star around a router beside a mesh of peers: what a running system costs, and what a call does.

A star is ``m2c run --router``. Each system is started and ticked in both ways, in turns. ``--run`` gives both
runs their further options, e.g. ``--run "--processes 2"``; by default each node has a process.
"""

from __future__ import annotations

import contextlib
import functools
import shlex
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from pathlib import Path

import msgspec

from benchmarks import copies
from benchmarks.family import family, links, memory_mib, used_s
from benchmarks.page import Row, beside, command
from benchmarks.processes import BIN, Child, ChildError, free_endpoint
from benchmarks.sampling import Block, distribution, measured
from benchmarks.tick import call, serve
from benchmarks.ticking import WHOLE, Order, ordered

START_S = 900.0
"""So long a large system may take to come up."""
STAR, MESH = "star", "mesh"
CALLS = {"back to back": (0.0, 1000), "100 times a second": (100.0, 200)}
"""How often a service is called (Hz; 0: once the response is there), and how many times in each turn."""


class Cost(msgspec.Struct, frozen=True):
    """What one run took.

    Attributes:
        up_s: from its start until all nodes are up.
        starting_s: processor time of all processes until then.
        ticking_s: processor time of all processes in a second of ticking.
        memory_mib: of all processes.
        links: among them.
    """

    up_s: float
    starting_s: float
    ticking_s: float
    memory_mib: float
    links: float


def run(generated: Path, seconds: float, options: Sequence[str]) -> Cost | None:
    """Start a system, let it tick for so long, and end it; None, and why, if it does not come up."""
    arguments = ["run", str(generated), "--endpoint", free_endpoint(), *options]
    began = time.perf_counter()
    with Child(" ".join(["m2c run", *options]), [str(BIN / "m2c"), *arguments]) as process:
        try:
            process.wait_for(lambda line: line.endswith(" up"), START_S)
        except ChildError as error:
            print(error, file=sys.stderr)
            return None
        up_s = time.perf_counter() - began
        starting_s = used_s(family(process.pid))
        process.wait_for(lambda line: line.startswith("tick "), START_S)
        pids = family(process.pid)
        before, since = used_s(pids), time.perf_counter()
        threading.Event().wait(seconds)  # never set
        ticking_s = (used_s(pids) - before) / (time.perf_counter() - since)
        return Cost(up_s, starting_s, ticking_s, memory_mib(pids), links(pids))


def systems(
    nodes: int, seconds: float, count: int, options: Sequence[str], peer: str, theirs: Sequence[str]
) -> list[Row]:
    """Rows of one system, run with ``options`` and, as ``peer``, with ``theirs``, in turns."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        system, generated = copies.write(nodes, folder / "models"), folder / "generated"
        subprocess.run(
            [str(BIN / "m2c"), "generate", str(system), "-o", str(generated)],
            check=True,
            stdout=subprocess.DEVNULL,
        )
        sides = {"": options, peer: theirs}
        turns = {
            side: functools.partial(run, generated, seconds, given) for side, given in sides.items()
        }
        found = measured(turns, count)

    def row(what: str, unit: str, name: str) -> Row:
        own, other = (
            [[getattr(cost, name)] for cost in found[side] if cost is not None] for side in sides
        )
        what = f"{nodes} nodes, {what}"
        if len(own) == len(other) == count:
            return beside(what, unit, own, peer, other)
        if not own:
            sys.exit(f"{nodes} nodes do not come up with {' '.join(options)}")
        return Row(
            what, distribution(own).p50.value, unit, f"{peer}: {len(other)} of {count} came up"
        )

    return [
        row("until all are up", "s", "up_s"),
        row("processor time until then", "s", "starting_s"),
        row("processor time of a second of ticking", "s", "ticking_s"),
        row("memory", "MiB", "memory_mib"),
        row("links", "", "links"),
    ]


def calls(stack: contextlib.ExitStack, topology: str) -> Child:
    """Who calls a service of another process; all run until the end of ``stack``."""
    endpoint = free_endpoint()
    served = called = {"endpoint": endpoint, "mode": "client"}
    if topology == STAR:
        arguments = ["-m", "transports.zenoh_link.router", "--listen", endpoint]
        stack.enter_context(Child("router", arguments)).wait_for(lambda line: "listens" in line)
    else:
        served, called = {"listen": endpoint}, {"endpoint": endpoint}
    server = stack.enter_context(Child.calling(f"server, {topology}", serve, "zenoh", served))
    server.answer()
    client = stack.enter_context(Child.calling(f"client, {topology}", call, "zenoh", called))
    client.answer()
    return client


def call_rows(count: int) -> list[Row]:
    """What a call takes."""
    with contextlib.ExitStack() as stack:
        clients = {topology: calls(stack, topology) for topology in (STAR, MESH)}

        def turn(topology: str, said: str) -> Block:
            rate_hz, ticks = CALLS[said]
            found = ordered(clients[topology], Order(ticks, rate_hz, warm_up=20))
            assert not found.reasons, found.reasons
            return found.micros[WHOLE]

        turns = {
            (topology, said): functools.partial(turn, topology, said)
            for topology in clients
            for said in CALLS
        }
        found = measured(turns, count)
    return [
        beside(f"a call, {said}, p50", "µs", found[STAR, said], MESH, found[MESH, said])
        for said in CALLS
    ]


def rows(
    nodes: str = "4 17 47", seconds: float = 10.0, rounds: int = 1, run: str = "--processes each"
) -> list[Row]:
    """What is shown of systems of so many ``nodes``; each ticks for ``seconds``."""
    options = shlex.split(run)
    found = [
        row
        for number in nodes.split()
        for row in systems(int(number), seconds, rounds, ["--router", *options], MESH, options)
    ]
    return [*found, *call_rows(max(rounds, 5))]


if __name__ == "__main__":
    command(rows)
