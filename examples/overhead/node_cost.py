"""What a tap costs the node that is tapped: its own processor time, and the bytes that it sends.

``python -m examples.overhead.node_cost [--transport zenoh|ros2]`` measures and prints it, for
BatteryLevelSkill and per tick. Both come from the operating system: processor time from the process's
clock, bytes from the counters of its network interface. For these the node has a network namespace of
its own, joined to the others' by a virtual cable; everything on that cable counts, with all headers,
acknowledgements and discovery, on Zenoh and on ROS 2 alike. (The counters of single sockets, as ``ss``
shows them, exist for TCP only; DDS speaks UDP, and would use shared memory if it were on one host, which
is switched off here: between robots there is none.) What an idle node does in the same time is measured
too, and taken off.

It needs ``unshare`` and ``ip`` (util-linux, iproute2) and user namespaces, not root.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import msgspec

from examples.overhead import accounts, sample
from examples.overhead.children import Child, ChildError
from examples.overhead.load import ROOT, Order
from examples.overhead.plant import (
    Middleware,
    MiddlewareMissingError,
    Plant,
    generate,
    ros_environment,
)
from examples.overhead.schedule import rounds, same_rounds
from m2c.launch.description import Package

NODE = "BatteryLevelSkill"
HERE, THERE = "10.77.0.1", "10.77.0.2"
"""The two ends of the cable; the namespaces hold nothing else."""
PORT = 7447
CABLE = "cable0"
OTHER_END = "cable1"
_WAITING = 'read -r _ && exec "$@"'
"""A shell that becomes the node when it is told that the cable is there."""


class CostPlan(msgspec.Struct, frozen=True):
    """How much is measured: in each round, untapped and tapped, ``ticks`` at each rate."""

    rounds: int = 6
    ticks: int = 60
    rates: tuple[float, ...] = (10.0, 0.0)
    idle_s: float = 2.0
    seed: int = 7


QUICK = CostPlan(rounds=2, ticks=15, idle_s=1.0)


class Window(msgspec.Struct, frozen=True):
    """What one stretch of time cost the node, what it does when idle taken off.

    Attributes:
        processor_us, sent, packets: of the node, per tick.
        policy_us: processor time of the policy's process per tick of the tree.
        idle_processor_us, idle_sent: of the idle node, a second.
        failures: ticks that failed.
    """

    transport: str
    rate_hz: float
    tapped: bool
    round: int
    processor_us: float
    sent: float
    packets: float
    policy_us: float
    idle_processor_us: float
    idle_sent: float
    failures: int


class Cost(msgspec.Struct, frozen=True):
    """One transport and rate, untapped or tapped: per tick, with intervals; idle a second."""

    transport: str
    rate_hz: float
    tapped: bool
    processor_us: sample.Estimate
    sent: sample.Estimate
    packets: float
    policy_us: sample.Estimate
    idle_processor_us: float
    idle_sent: float
    rounds: int
    failures: int


def costs(windows: Sequence[Window]) -> list[Cost]:
    """The table, in the order of transports, rates, untapped before tapped."""
    found = []
    keys = dict.fromkeys((w.transport, w.rate_hz, w.tapped) for w in windows)
    for key in sorted(keys, key=lambda k: (k[0] != "zenoh", k[1] == 0, k[1], k[2])):
        own = [w for w in windows if (w.transport, w.rate_hz, w.tapped) == key]
        found.append(
            Cost(
                *key,
                _median([w.processor_us for w in own]),
                _median([w.sent for w in own]),
                statistics.median(w.packets for w in own),
                _median([w.policy_us for w in own]),
                statistics.median(w.idle_processor_us for w in own),
                statistics.median(w.idle_sent for w in own),
                len(own),
                sum(w.failures for w in own),
            )
        )
    return found


def dearer(windows: Sequence[Window]) -> dict[tuple[str, float], sample.Estimate]:
    """How many times the processor time of the untapped node a tapped one takes, in the same rounds.

    Returns:
        By transport and rate, where both were measured.
    """
    found = {}
    for transport, rate_hz in dict.fromkeys((w.transport, w.rate_hz) for w in windows):
        own = [w for w in windows if (w.transport, w.rate_hz) == (transport, rate_hz)]
        pairs = same_rounds([w for w in own if w.tapped], [w for w in own if not w.tapped])
        if pairs:
            found[transport, rate_hz] = sample.ratio(
                [[tapped.processor_us] for tapped, _ in pairs],
                [[untapped.processor_us] for _, untapped in pairs],
            )
    return found


def _median(values: Sequence[float]) -> sample.Estimate:
    """Each round gives one value."""
    return sample.distribution([[value] for value in values]).p50


Say = Callable[[str], None]


def measure(transport: str, plan: CostPlan, say: Say) -> list[Window]:
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
    options = ["--inside", "--transport", transport, "--plan", msgspec.json.encode(plan).decode()]
    say(f"{transport}: the node's own cost, in a network namespace")
    with Child(
        "the measurement", ["-m", "examples.overhead.node_cost", *options], prefix=alone
    ) as child:
        answer = child.answer(timeout_s=600.0)
    return msgspec.convert(answer["windows"], list[Window])


# -- inside the namespace ---------------------------------------------------------------------------


def _ip(*arguments: str, inside: int | None = None) -> None:
    where = ["nsenter", "-t", str(inside), "-n"] if inside is not None else []
    subprocess.run([*where, "ip", *arguments], check=True)


def _start_apart(plant: Plant, node: Package, folder: Path) -> Child:
    """The node in a namespace of its own, with a cable to this one."""
    package_path = str(folder / node.path)
    environment = plant.where.environment
    path = os.pathsep.join(filter(None, [package_path, environment.get("PYTHONPATH", "")]))
    arguments = ["-m", node.package, "--transport", plant.where.transport, "--log-level", "ERROR"]
    if plant.where.endpoint:
        meeting = folder / "apart.json5"
        ends = {
            "connect": {"endpoints": [plant.where.endpoint]},
            "listen": {"endpoints": [f"tcp/{THERE}:{PORT}"]},
        }
        meeting.write_bytes(msgspec.json.encode(ends))
        arguments += ["--zenoh-config", str(meeting)]
    child = Child(
        node.name,
        arguments,
        {**environment, "PYTHONPATH": path},
        prefix=["unshare", "--net", "--", "sh", "-c", _WAITING, "sh"],
    )
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


def inside(transport: str, plan: CostPlan) -> list[Window]:
    """Measure; this process is alone in a network namespace."""
    _ip("link", "set", "lo", "up")
    found = []
    with contextlib.ExitStack() as stack:
        scratch = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="overhead-")))
        folder = generate(scratch, through_the_middle=False)
        apart = {NODE: _start_apart}
        plant = stack.enter_context(Plant(_where(transport), folder, apart=apart))
        node = plant.nodes[NODE].pid
        for number, tapped in rounds((False, True), plan.rounds, plan.seed):
            with _tapped(plant) if tapped else contextlib.nullcontext():
                plant.run(Order(5, 10.0, 0, rest=True))
                idle = _Account(node)
                threading.Event().wait(plan.idle_s)
                idle_processor, idle_sent, idle_packets = idle.read()
                for rate_hz in plan.rates:
                    account = _Account(node)
                    taken = plant.run(Order(plan.ticks, rate_hz, 0, rest=True))
                    _settle()
                    processor, sent, packets = account.read()
                    share = account.seconds / idle.seconds
                    found.append(
                        Window(
                            transport,
                            rate_hz,
                            tapped,
                            number,
                            (processor - idle_processor * share) / plan.ticks * 1e6,
                            (sent - idle_sent * share) / plan.ticks,
                            (packets - idle_packets * share) / plan.ticks,
                            taken.processor_s / plan.ticks * 1e6,
                            idle_processor / idle.seconds * 1e6,
                            idle_sent / idle.seconds,
                            taken.failures[ROOT],
                        )
                    )
    return found


class _Account:
    """What the node has used and sent since this was made."""

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._before = self._now()
        self.seconds = 0.0

    def _now(self) -> tuple[float, float, float, float]:
        sent, packets = accounts.bytes_sent(self._pid, OTHER_END)
        return time.monotonic(), accounts.processor_s(self._pid), sent, packets

    def read(self) -> tuple[float, float, float]:
        """Processor time in seconds, bytes, packets."""
        now = self._now()
        self.seconds = now[0] - self._before[0]
        processor, sent, packets = (now[place] - self._before[place] for place in (1, 2, 3))
        return processor, sent, packets


def _settle() -> None:
    """Events leave after the call (3.5 to 12 ms), acknowledgements after that: they belong to the ticks."""
    threading.Event().wait(0.25)


@contextlib.contextmanager
def _tapped(plant: Plant) -> Iterator[None]:
    names = [word for name in (*plant.names, "policy") for word in ("--link", name)]
    arguments = ["-m", "examples.overhead.listener", *plant.where.arguments(), *names]
    with Child("a tap", arguments, plant.where.environment) as tap:
        tap.answer()
        yield
        heard = tap.ask({})["heard"]
    if not heard:
        raise ChildError("the tap heard nothing: what it costs cannot be told")


def _end_with_parent() -> None:
    """A change of user namespaces forgets the death signal; the end of standard input does not."""
    sys.stdin.read()
    os.kill(os.getpid(), signal.SIGTERM)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    from examples.overhead.tables import cost_table, print_table

    parser = argparse.ArgumentParser(description="What a tap costs the node that is tapped.")
    parser.add_argument("--transport", choices=("zenoh", "ros2"), default="zenoh")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--plan", default="", help=argparse.SUPPRESS)
    chosen = parser.parse_args(arguments)
    if chosen.inside:
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
        threading.Thread(target=_end_with_parent, daemon=True).start()
        windows = inside(chosen.transport, msgspec.json.decode(chosen.plan, type=CostPlan))
        print(msgspec.json.encode({"windows": windows}).decode(), flush=True)
        return 0
    try:
        windows = measure(
            chosen.transport,
            QUICK if chosen.quick else CostPlan(),
            lambda text: print(text, file=sys.stderr),
        )
    except (MiddlewareMissingError, ChildError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print_table(cost_table(windows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
