"""Makes the golden recordings anew: the lab tour as it is and with the paper's faults, on Zenoh and ROS 2.

``python -m tests.recordings.make [--transport zenoh|ros2] [nominal T1 …]``, from the root of the checkout;
with ``--keep``, the recordings stay, and only what is expected of them is written anew.
Each run is monitored while it is recorded, and kept only if the monitor found what it should: the node
with the fault and nobody else; of the tour as it is, that all conform. What it said goes to
``expected.json``.
Then look at the difference: a verdict that changes needs a reason.
"""

from __future__ import annotations

import argparse
import contextlib
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
SYSTEM = Path("examples/lab_tour/system.xml")
EXPECTED = HERE / "expected.json"
MAX_BYTES = 100_000
CASES = ("nominal", "T1", "T2", "T3", "T4", "T5", "T6")
RATE = 2.0
"""Ticks a second: less is to be recorded until something happens."""


def is_paced(transport: str, case: str) -> bool:
    """Whether the monitor's turns (two in ten milliseconds) are recorded.

    Where the battery must run low first, or nodes take long to come up, there is no room for them: such
    a recording is one as ``moon record`` makes it, and what is known is what its check says.
    """
    return transport == "zenoh" and case not in ("T4", "T5")


SECONDS = {"nominal": 5.0}
"""How long a run goes on after the tree began to tick, if nothing is to be found in it."""
LONGEST_S = 90.0
AFTER_S = 3.0
"""How long a run goes on after what should be found is found."""
STOP_S = 60.0
TRIES = 3

sys.path.insert(0, str(ROOT / "examples" / "lab_tour" / "faults"))


class Expected(msgspec.Struct, frozen=True):
    """What is known of one recording.

    Attributes:
        transport: where it was made.
        fault: which one is in it; "" for the tour as it is.
        what: the same in words.
        violated: the nodes that do what their models do not allow.
        observations: how many there are.
        violations: all that are said: node, outcome, reason, what was expected, what observed.
    """

    transport: str
    fault: str
    what: str
    violated: tuple[str, ...]
    observations: int
    violations: tuple[tuple[str, str, str, tuple[str, ...], str], ...]


def essence(verdict: Any) -> tuple[str, str, str, tuple[str, ...], str]:
    """A verdict without stamps and places in files."""
    why = verdict.explanation
    said = ((), "") if why is None else (why.expected, why.observed)
    return (verdict.node, str(verdict.outcome), verdict.reason, *said)


def violations(checked: Any) -> tuple[tuple[str, str, str, tuple[str, ...], str], ...]:
    """The violations that a check says, in order."""
    return tuple(essence(said.verdict) for said in checked.violated)


class Found:
    """Takes verdicts: for the recording, and to know when a run is over."""

    def __init__(self, add: Any, now_ns: Any) -> None:
        self.verdicts: list[Any] = []
        self.over_ns = 0
        """When the first violation was said."""
        self._add = add
        self._now_ns = now_ns

    def take(self, verdict: Any) -> None:
        from moon.recording.entries import ReportedVerdict
        from moon.verdict import Outcome

        self.verdicts.append(verdict)
        self._add(ReportedVerdict(self._now_ns(), verdict))
        if verdict.outcome is Outcome.VIOLATED:
            self.over_ns = self.over_ns or time.monotonic_ns()


def record(transport: str, case: str, path: Path, scratch: Path) -> Expected | None:
    """Record one run; None if the monitor was not sure, or found something else."""
    from catalogue import FAULTS
    from inject import replacement

    from moon.monitor.reading import read_checked
    from moon.monitor.subject import Monitored
    from moon.oracle.bounds import Bounds
    from moon.recording.definitions import Definitions
    from moon.recording.entries import Ended
    from moon.recording.writer import RecordingWriter
    from moon.run import Run
    from moon.sources.recorded import RecordedConnection
    from moon.sources.source import Outputs
    from transports.registry import connect

    chosen = next((item for item in FAULTS if item.id == case), None)
    system = read_checked([SYSTEM])
    command = [str(Path(sys.executable).parent / "m2c"), "run", str(SYSTEM), "--quiet"]
    options = {}
    if transport == "zenoh":
        from processes import _free_endpoint

        endpoint = _free_endpoint()
        options = {"listen": endpoint}
        meeting = scratch / "zenoh.json5"
        meeting.write_bytes(msgspec.json.encode({"connect": {"endpoints": [endpoint]}}))
        command += ["--zenoh-config", str(meeting)]
    else:
        command += ["--transport", transport]
    if chosen is not None:
        command += ["--replace", f"{chosen.node}={replacement(chosen, scratch)}"]
    command += ["--rate", str(RATE)]
    path.unlink(missing_ok=True)
    writer = RecordingWriter(path, Definitions(system.library))
    paced = is_paced(transport, case)
    ticked: list[float] = []
    """When the tree began to tick."""
    kept = writer.add if paced else _without_turns(writer.add)

    def add(entry: Any) -> None:
        if not ticked and getattr(entry, "channel", "").endswith("/tick"):
            ticked.append(time.monotonic())
        kept(entry)

    connection = connect(transport, "moon_record", options)
    process = None
    try:
        recorded = RecordedConnection(connection, add, transport)
        found = Found(add, recorded.now_ns)
        outputs = Outputs([found], lambda text: print(f"  {text}", file=sys.stderr))
        watch = Run(recorded, Monitored(system, system.nodes, (), Bounds()), outputs)
        watch.start()
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        began = time.monotonic()

        def is_over() -> bool:
            now = time.monotonic()
            if found.over_ns:
                return now - found.over_ns / 1e9 > AFTER_S
            if ticked and case in SECONDS:
                return now - ticked[0] > SECONDS[case]
            return now - began > LONGEST_S

        connection.every(0.05, lambda: None)
        connection.spin(is_over)
        add(Ended(connection.now_ns()))
    finally:
        if process is not None:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(STOP_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        connection.close()
        writer.close()
    checked = check(path)
    states = {item.machine: item.verdict for item in checked.machines}
    violated = tuple(sorted(name for name, verdict in states.items() if verdict == "violated"))
    unsure = [name for name, verdict in states.items() if verdict in ("inconclusive", "unseen")]
    said = [essence(item.verdict) for item in checked.verdicts]
    if violated != (() if chosen is None else (chosen.node,)) or (unsure and chosen is None):
        print(f"  not kept: violated {violated}, not known {unsure}", file=sys.stderr)
        return None
    if paced and said != [essence(verdict) for verdict in found.verdicts]:
        print("  not kept: its check does not say what the monitor said", file=sys.stderr)
        return None
    if path.stat().st_size > MAX_BYTES:
        print(f"  not kept: {path.stat().st_size} bytes", file=sys.stderr)
        return None
    return Expected(
        transport,
        "" if chosen is None else chosen.id,
        "the tour as it is" if chosen is None else f"{chosen.node} {chosen.what}",
        violated,
        writer.observations,
        violations(checked),
    )


def _without_turns(add: Any) -> Any:
    """``add`` for a recording without a monitor in it."""
    from msgspec.structs import replace

    from moon.recording.entries import Began, Pulse, ReportedVerdict

    def some(entry: Any) -> None:
        if isinstance(entry, Began):
            entry = replace(entry, paced=False)
        if not isinstance(entry, Pulse | ReportedVerdict):
            add(entry)

    return some


def check(path: Path) -> Any:
    """What ``moon check`` says of a recording and the tour's models."""
    from moon.monitor.subject import Subject, read_subject
    from moon.offline.engine import check_recording
    from moon.oracle.bounds import Bounds

    subject = Subject((SYSTEM,), (), (), (), (), Bounds())
    return check_recording(path, subject, read_subject(subject))


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Make the golden recordings anew.")
    parser.add_argument("--transport", action="append", choices=("zenoh", "ros2"))
    parser.add_argument("case", nargs="*", choices=(*CASES, []), help="by default all of them")
    parser.add_argument("--keep", action="store_true", help="only write expected.json anew")
    chosen = parser.parse_args(arguments)
    if chosen.keep:
        write(
            {
                name: msgspec.structs.replace(known, violations=violations(check(HERE / name)))
                for name, known in load().items()
            }
        )
        return 0
    transports = chosen.transport or ["zenoh", "ros2"]
    if "ros2" in transports:
        from processes import find_interfaces

        find_interfaces()
    known = load()
    failed = 0
    for transport in transports:
        for case in chosen.case or CASES:
            name = f"{transport}-{case}.mcap"
            print(name, file=sys.stderr)
            made = _made(transport, case, name)
            if made is None:
                failed += 1
                continue
            known[name] = made
            write(known)
    return 1 if failed else 0


def _made(transport: str, case: str, name: str) -> Expected | None:
    """The best of some tries: a machine that is busy with other things makes a monitor unsure."""
    from processes import own_domain

    for _ in range(TRIES):
        with tempfile.TemporaryDirectory() as scratch:
            domain = own_domain() if transport == "ros2" else contextlib.nullcontext()
            with domain:
                draft = Path(scratch) / name
                made = record(transport, case, draft, Path(scratch))
            if made is not None:
                (HERE / name).write_bytes(draft.read_bytes())
                return made
    return None


def write(known: dict[str, Expected]) -> None:
    """Keep what is known."""
    ordered = msgspec.json.encode(dict(sorted(known.items())))
    EXPECTED.write_bytes(msgspec.json.format(ordered, indent=1) + b"\n")


def load() -> dict[str, Expected]:
    """What is known, by file."""
    if not EXPECTED.exists():
        return {}
    return msgspec.json.decode(EXPECTED.read_bytes(), type=dict[str, Expected])


if __name__ == "__main__":
    sys.exit(main())
