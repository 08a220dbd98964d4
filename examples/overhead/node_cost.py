"""What a tap costs the node that is tapped: its own processor time, and the bytes that it sends.

For BatteryLevelSkill and per tick. Both come from the operating system: processor time from the process's
clock, bytes from the counters of its network interface. For these the node has a network namespace of
its own, joined to the others' by a virtual cable; everything on that cable counts, with all headers,
acknowledgements and discovery, on Zenoh and on ROS 2 alike. (The counters of single sockets, as ``ss``
shows them, exist for TCP only; DDS speaks UDP, and would use shared memory if it were on one host, which
is switched off here: between robots there is none.) What an idle node does in the same time is measured
too, and taken off.

It needs ``unshare`` and ``ip`` (util-linux, iproute2) and user namespaces, not root.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import msgspec

from benchmarks.processes import Child, ChildError, bytes_sent, processor_s, say
from benchmarks.sampling import rounds
from benchmarks.ticking import (
    WHOLE,
    Middleware,
    MiddlewareMissingError,
    Order,
    listeners,
    ros_environment,
)
from examples.overhead.blocks import COST, NOBODY, Block
from examples.overhead.plant import Plant, generate, start_node
from m2c.launch.description import Package

NODE = "BatteryLevelSkill"
HERE, THERE = "10.77.0.1", "10.77.0.2"
"""The two ends of the cable; the namespaces hold nothing else."""
PORT = 7447
CABLE = "cable0"
OTHER_END = "cable1"


class CostPlan(msgspec.Struct, frozen=True):
    """How much is measured: in each round, untapped and tapped, ``ticks`` at each rate."""

    rounds: int = 6
    ticks: int = 60
    rates: tuple[float, ...] = (10.0, 0.0)
    idle_s: float = 2.0
    seed: int = 7


QUICK = CostPlan(rounds=2, ticks=15, idle_s=1.0)


def measure(transport: str, plan: CostPlan, tell: Callable[[str], None]) -> list[Block]:
    """Measure in namespaces of one's own.

    Raises:
        MiddlewareMissingError: the system does not let one have them, or ROS 2 is not installed.
        ChildError: a process does not come up or dies.
    """
    for command in ("unshare", "ip", "nsenter"):
        if shutil.which(command) is None:
            raise MiddlewareMissingError(f"bytes cannot be counted: there is no command {command}")
    alone = ["unshare", "--user", "--map-root-user", "--net", "--"]
    tried = subprocess.run([*alone, "ip", "link"], capture_output=True, text=True, check=False)
    if tried.returncode:
        raise MiddlewareMissingError(
            f"bytes cannot be counted: no network namespace for us ({tried.stderr.strip()})"
        )
    if transport == "ros2":
        ros_environment()  # builds the interface packages, if need be, where there is a network
    tell(f"{transport}: the node's own cost, in a network namespace")
    with Child.calling("the measurement", inside, transport, plan, prefix=alone) as child:
        answer = child.answer(timeout_s=600.0)
    return msgspec.convert(answer["blocks"], list[Block])


# -- inside the namespace ---------------------------------------------------------------------------


def _ip(*arguments: str, inside: int | None = None) -> None:
    where = ["nsenter", "-t", str(inside), "-n"] if inside is not None else []
    subprocess.run([*where, "ip", *arguments], check=True)


def _start_apart(where: Middleware, node: Package, folder: Path) -> Child:
    """The node in a namespace of its own, with a cable to this one."""
    meeting = ["--transport", where.transport]
    if where.endpoint:
        config = folder / "apart.json5"
        ends = {
            "connect": {"endpoints": [where.endpoint]},
            "listen": {"endpoints": [f"tcp/{THERE}:{PORT}"]},
        }
        config.write_bytes(msgspec.json.encode(ends))
        meeting += ["--zenoh-config", str(config)]
    # a shell that becomes the node when it is told that the cable is there
    waiting = ("sh", "-c", 'read -r _ && exec "$@"', "sh")
    child = start_node(where, node, folder, meeting, ("unshare", "--net", "--", *waiting))
    own = os.readlink("/proc/self/ns/net")
    pause = threading.Event()
    while os.readlink(f"/proc/{child.pid}/ns/net") == own:  # unshare has not done it yet
        pause.wait(0.01)
    pid = child.pid
    _ip("link", "add", CABLE, "type", "veth", "peer", "name", OTHER_END, "netns", str(pid))
    _ip("addr", "add", f"{HERE}/24", "dev", CABLE)
    _ip("link", "set", CABLE, "up")
    _ip("link", "set", "lo", "up", inside=pid)
    _ip("addr", "add", f"{THERE}/24", "dev", OTHER_END, inside=pid)
    _ip("link", "set", OTHER_END, "up", inside=pid)
    child.tell("the cable is there")
    return child


def _where(transport: str) -> Middleware:
    if transport == "zenoh":
        return Middleware(transport, f"tcp/{HERE}:{PORT}")
    environment = {
        **ros_environment(),
        "ROS_LOCALHOST_ONLY": "0",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",  # which is the cable
        "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
        "ROS_DOMAIN_ID": "1",
    }
    return Middleware(transport, environment=environment)


def inside(transport: str, plan_: Mapping[str, Any]) -> None:
    """Measure; this process is alone in a network namespace."""
    plan = msgspec.convert(plan_, CostPlan)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _ip("link", "set", "lo", "up")
    found: list[Block] = []
    with contextlib.ExitStack() as stack:
        scratch = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="overhead-")))
        folder = generate(scratch, through_the_middle=False)
        apart = {NODE: _start_apart}
        plant = stack.enter_context(Plant(_where(transport), folder, apart=apart))
        node = plant.nodes[NODE].pid
        for number, tapped in rounds((False, True), plan.rounds, plan.seed):
            with contextlib.ExitStack() as turn:
                taps = listeners(turn, plant.where, [*plant.names, "policy"], int(tapped))
                plant.run(Order(5, 10.0, 0, rest=True))
                before = _account(node)
                threading.Event().wait(plan.idle_s)
                idle = _used(node, before)
                for rate_hz in plan.rates:
                    before = _account(node)
                    taken = plant.run(Order(plan.ticks, rate_hz, 0, rest=True))
                    # events leave after the call (3.5 to 12 ms), acknowledgements after that
                    threading.Event().wait(0.25)
                    used = _used(node, before)
                    # what an idle node does in the same time
                    seconds = used["seconds"]
                    own = {
                        name: used[name] - idle[name] / idle["seconds"] * seconds for name in used
                    }
                    values = {
                        "processor": own["processor"] / plan.ticks * 1e6,
                        "sent": own["sent"] / plan.ticks,
                        "packets": own["packets"] / plan.ticks,
                        "policy": taken.processor_s / plan.ticks * 1e6,
                        "idle processor": idle["processor"] / idle["seconds"] * 1e6,
                        "idle sent": idle["sent"] / idle["seconds"],
                    }
                    place = (COST, transport, rate_hz, 0.0, "tap" if tapped else NOBODY)
                    failures = dict.fromkeys(values, taken.failures[WHOLE])
                    each = {name: [value] for name, value in values.items()}
                    found.append(Block(*place, number, each, failures))
                if not all(tap.ask({})["heard"] for tap in taps):
                    raise ChildError("the tap heard nothing: what it costs cannot be told")
    say({"blocks": found})


def _account(pid: int) -> dict[str, float]:
    """What the node has used and sent since it began: seconds, bytes, packets."""
    sent, packets = bytes_sent(pid, OTHER_END)
    now, processor = time.monotonic(), processor_s(pid)
    return {"seconds": now, "processor": processor, "sent": sent, "packets": packets}


def _used(pid: int, before: Mapping[str, float]) -> dict[str, float]:
    return {name: value - before[name] for name, value in _account(pid).items()}


def _end_with_parent() -> None:
    """A change of user namespaces forgets the death signal; the end of standard input does not."""
    sys.stdin.read()
    os.kill(os.getpid(), signal.SIGTERM)
