"""Runs the lab tour as it is and with each of the paper's six faults, every model monitored.

``python examples/lab_tour/faults/run.py [--transport zenoh|simulated] [--json] [--fault T1 …]`` prints
the paper's table II beside what was found here; with ``--properties`` all of it: the paper's properties
P1 to P3 and three more are monitored, too, each run lasting a whole tour.

Exit code 0: every fault was found in the node that has it, as soon as it can be, and by the properties
that it breaks; neither the tour as it is nor any other node was blamed; 1: not so; 2: it could not be run.
"""

from __future__ import annotations

import argparse
import contextlib
import logging
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import by_property
import msgspec
from by_property import Cell
from catalogue import FAULTS, Detected, Fault, Kind, fault
from inject import SYSTEM, PatchError, generated, patched, replacement
from onset import Onset, onset

if TYPE_CHECKING:
    from m2c.model.system import System
    from moon.monitor.watch import SystemWatch
    from moon.properties.property import Property
    from moon.verdict import Verdict
    from transports.interface import Observation, Transport

DEADLINE_NS = 1_000_000_000
"""Of outputs, as ``moon monitor`` has it when nothing is said."""
LATE_NS = 200_000_000
"""A missing output should be reported this long after its deadline, at the latest."""
LATENCY_NS = 150_000_000
"""The latency bound. What was sent in time may be heard one bound later, so a monitor waits that long
after a deadline; what is left of ``LATE_NS`` is for its timer and a busy machine."""

TOUR_S = 30.0
"""One tour and the start of the next one."""
MOST_LOST = 3
"""A monitor that was held up finds machines again when they next do something; ResetSkill, say, is ticked
once in a tour."""
TICK_S = 0.01
"""How often the run looks whether it is over."""


class Said(msgspec.Struct, frozen=True):
    """A verdict, and when it was said (ns since the epoch, on the monitor's clock)."""

    verdict: Any
    at_ns: int


class Run(msgspec.Struct, frozen=True):
    """What was heard and said in one run."""

    heard: tuple[Any, ...]
    violations: tuple[Said, ...]
    count: int = 0
    """Everything heard; of the tour as it is, nothing is kept."""
    lost: tuple[str, ...] = ()
    """The machines of which the monitor did not know at the end what they do."""
    broken: tuple[Said, ...] = ()
    """Verdicts on properties."""
    standing: dict[str, str] = {}
    """The verdict at the end of each property that was monitored."""


class Row(msgspec.Struct, frozen=True):
    """One line of the result.

    Attributes:
        id: of the fault; ``nominal`` for the tour as it is.
        type, paper: as the paper has them.
        node: that has the fault.
        violated: the machines that were found in violation, in the order of the verdicts.
        detected: whether the faulty one was found, as soon as it should be.
        latency_ms: from the first wrong output, or the input that was not answered, to the verdict.
        after_deadline_ms: for missing outputs: from the deadline to the verdict.
        first: whether the verdict is about the first wrong output.
        reason: the first line of the explanation.
        problem: why it counts as failed; "" if all is well.
        properties: what each property found, if they were monitored.
    """

    id: str
    type: str = ""
    node: str = ""
    paper: str = ""
    violated: tuple[str, ...] = ()
    detected: bool = False
    latency_ms: float | None = None
    after_deadline_ms: float | None = None
    first: bool | None = None
    reason: str = ""
    problem: str = ""
    properties: tuple[Cell, ...] = ()

    @property
    def is_well(self) -> bool:
        """Whether the models' monitors and the properties found what they should."""
        return self.detected and not any(cell.problem for cell in self.properties)


# -- running --------------------------------------------------------------------------------------


class Listener:
    """A monitor of all models, and what it heard and said.

    Args:
        transport: its own connection.
        system: the models as they should be.
        faulty: the run is over when this node's machine is violated; "" for the tour as it is.
        properties: to be monitored, too; then the run is not over before its time.
    """

    def __init__(
        self,
        transport: Transport,
        system: System,
        faulty: str,
        properties: Sequence[Property] = (),
    ) -> None:
        from moon.monitor.properties import PropertyWatch
        from moon.monitor.watch import SystemWatch
        from moon.oracle.bounds import Bounds

        self._transport = transport
        self._faulty = faulty
        self.heard: list[Observation] = []
        self.count = 0
        self.first_ns = 0
        """Stamp of the first thing heard."""
        self.violations: list[Said] = []
        self.broken: list[Said] = []
        self._properties = PropertyWatch(properties, LATENCY_NS)
        bounds = Bounds(latency=LATENCY_NS, deadline=DEADLINE_NS)
        self.watch: SystemWatch = SystemWatch(
            transport, system, system.nodes, bounds, [self], _complain, self._properties
        )

    def start(self) -> None:
        """Listen: before the nodes start."""
        self._transport.tap([], self._hear)
        self.watch.start()

    def _hear(self, seen: Observation) -> None:
        self.first_ns = self.first_ns or seen.stamp_ns
        self.count += 1
        if self._faulty:  # the tour as it is may be a long one, and nothing of it is looked up
            self.heard.append(seen)

    def take(self, verdict: Verdict) -> None:
        """A verdict, from the watch."""
        from moon.verdict import Outcome

        if verdict.outcome is Outcome.VIOLATED:
            found = self.broken if verdict.kind == "property" else self.violations
            found.append(Said(verdict, self._transport.now_ns()))

    @property
    def is_over(self) -> bool:
        """Whether what should be found is found."""
        found = any(said.verdict.node == self._faulty for said in self.violations)
        return found and not self._properties.properties

    def result(self) -> Run:
        """All of it."""
        heard = sorted(self.heard, key=lambda seen: seen.stamp_ns)
        statuses = self.watch.statuses()
        machines = [item for item in statuses if item.kind == "model"]
        return Run(
            tuple(heard),
            tuple(self.violations),
            self.count,
            tuple(item.machine for item in machines if item.verdict in _UNKNOWN),
            tuple(self.broken),
            {item.machine: item.verdict for item in statuses if item.kind == "property"},
        )


_UNKNOWN = ("inconclusive", "unseen")


def _complain(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def simulated(
    chosen: Fault | None, system: System, seconds: float, properties: Sequence[Property] = ()
) -> Run:
    """The tour in virtual time, in this process."""
    from m2c.launch.in_process import SimulatedRun
    from transports.simulated import Conditions, SimulatedTransport, SimulatedWorld

    program = _program(system)
    if chosen is not None:
        program = program.replacing(chosen.node, _faulty_node(chosen, system))
    conditions = Conditions(delay_s=(0.0, 0.002), tap_delay_s=(0.0, 0.002))
    world = SimulatedWorld(1, conditions)
    listener = Listener(
        SimulatedTransport(world, "listener"),
        system,
        "" if chosen is None else chosen.node,
        properties,
    )
    listener.start()
    # the nodes begin to connect after it listens
    world.run_for(TICK_S)
    run = SimulatedRun(program, world)
    passed = 0.0
    while passed < seconds and not listener.is_over:
        run.run(0.2)
        passed += 0.2
    result = listener.result()
    world.close()
    return result


def _program(system: System) -> Any:
    from m2c.launch.in_process import compile_system

    if not _programs:
        _programs.append(compile_system(system))
    return _programs[0]


_programs: list[Any] = []


def _faulty_node(chosen: Fault, system: System) -> Any:
    from m2c.launch.in_process import compile_node, import_node
    from m2c.model import DiagnosticLog
    from m2c.model.system import read_with_reference

    if chosen.kind is Kind.MODEL:
        log = DiagnosticLog()
        machine = read_with_reference(chosen.path, system, chosen.node, log)
        log.raise_if_errors()
        assert machine is not None
        return compile_node(machine, system)
    files = {
        Path(path): text for path, text in patched(generated(chosen.node), chosen.path).items()
    }
    package = next(path.parent for path in files if path.name == "machine.py")
    modules = {
        path.stem: text
        for path, text in files.items()
        if path.parent == package and path.stem in ("__init__", "interfaces", "machine", "node")
    }
    return import_node(package.name, modules, chosen.node)


def on_zenoh(
    chosen: Fault | None, system: System, seconds: float, properties: Sequence[Property] = ()
) -> Run:
    """The tour as processes on Zenoh; the monitor is this one."""
    from transports.registry import connect

    with tempfile.TemporaryDirectory(prefix="faults-") as scratch:
        endpoint = _free_endpoint()
        command = [str(Path(sys.executable).parent / "m2c"), "run", str(SYSTEM), "--quiet"]
        # the nodes meet at the monitor, which so is there before them
        meeting = Path(scratch) / "zenoh.json5"
        meeting.write_bytes(msgspec.json.encode({"connect": {"endpoints": [endpoint]}}))
        command += ["--zenoh-config", str(meeting)]
        if chosen is not None:
            path = replacement(chosen, Path(scratch))
            command += ["--replace", f"{chosen.node}={path}"]
        transport = connect("zenoh", "fault_monitor", {"listen": endpoint})
        process = None
        try:
            faulty = "" if chosen is None else chosen.node
            listener = Listener(transport, system, faulty, properties)
            listener.start()
            with (Path(scratch) / "said").open("w+") as said:
                process = subprocess.Popen(command, stdout=said, stderr=subprocess.STDOUT)
                _spin(transport, process, listener, seconds)
                if process.poll() is not None:
                    said.seek(0)
                    raise RunError(f"m2c run ended by itself:\n{said.read()}")
                result = listener.result()
                process.send_signal(signal.SIGINT)
                process.wait(30)
            return result
        finally:
            if process is not None and process.poll() is None:
                process.kill()
                process.wait()
            transport.close()


class RunError(Exception):
    """A run could not be held; the text says why."""


def _spin(
    transport: Transport, process: subprocess.Popen[bytes], listener: Listener, seconds: float
) -> None:
    """Listen until ``seconds`` after the first thing heard, or until all is found."""
    ended = False

    def look() -> None:
        nonlocal ended
        passed_ns = transport.now_ns() - listener.first_ns if listener.first_ns else 0
        ended = ended or passed_ns > seconds * 1e9 or process.poll() is not None

    transport.every(TICK_S, look)
    transport.spin(lambda: ended or listener.is_over)


def _free_endpoint() -> str:
    with contextlib.closing(socket.socket()) as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


# -- judging --------------------------------------------------------------------------------------


def judged(chosen: Fault, run: Run) -> Row:
    """Whether ``chosen`` was found where and when it should be."""
    blamed = tuple(dict.fromkeys(said.verdict.node for said in run.violations))
    row = Row(chosen.id, chosen.type, chosen.node, chosen.paper.model_monitor, violated=blamed)
    wrong: Onset | None = onset(chosen.id, run.heard, LATENCY_NS)
    said = next((item for item in run.violations if item.verdict.node == chosen.node), None)
    if wrong is None:
        return _failed(row, "the fault never showed itself: nothing could be found")
    if said is None:
        return _failed(row, f"missed: {wrong.what} {_seconds(run, wrong.stamp_ns)}, and no verdict")
    latency_ns = said.at_ns - wrong.stamp_ns
    row = msgspec.structs.replace(
        row, reason=said.verdict.reason.splitlines()[0], latency_ms=latency_ns / 1e6
    )
    if chosen.expected.when is Detected.AT_THE_DEADLINE:
        late_ns = latency_ns - DEADLINE_NS
        row = msgspec.structs.replace(row, after_deadline_ms=late_ns / 1e6)
        if late_ns < 0:
            return _failed(row, "said before the deadline was over")
        if late_ns > LATE_NS:
            return _failed(row, f"said {late_ns / 1e6:.0f} ms after the deadline")
    else:
        after_ms = (said.verdict.stamp_ns - wrong.stamp_ns) / 1e6
        row = msgspec.structs.replace(row, first=not after_ms)
        if after_ms > 0:
            return _failed(row, f"not the first wrong output, but one {after_ms:.0f} ms later")
        if after_ms < 0:
            return _failed(row, f"blamed {-after_ms:.0f} ms before the first wrong output")
    others = [name for name in blamed if name != chosen.node]
    if others:
        return _failed(row, f"blamed without a fault: {', '.join(others)}")
    return msgspec.structs.replace(row, detected=True)


def judged_nominal(run: Run) -> Row:
    """Whether nothing was found in the tour as it is."""
    blamed = tuple(dict.fromkeys(said.verdict.node for said in run.violations))
    row = Row("nominal", "no fault", violated=blamed, detected=not blamed)
    if not run.count:
        return _failed(row, "nothing was heard")
    if len(run.lost) > MOST_LOST:
        return _failed(row, f"not known what these do: {', '.join(run.lost)}")
    if run.violations:
        reason = run.violations[0].verdict.reason.splitlines()[0]
        return _failed(msgspec.structs.replace(row, reason=reason), "a false alarm")
    return row


def with_properties(row: Row, chosen: Fault | None, run: Run) -> Row:
    """``row`` with what the properties found."""
    if not run.standing:
        return row
    wrong = None if chosen is None else onset(chosen.id, run.heard, LATENCY_NS)
    since = wrong.stamp_ns if wrong is not None else None
    found = by_property.cells(chosen, run.broken, since, run.standing)
    return msgspec.structs.replace(row, properties=found)


def _failed(row: Row, problem: str) -> Row:
    return msgspec.structs.replace(row, detected=False, problem=problem)


def _seconds(run: Run, stamp_ns: int) -> str:
    return f"after {(stamp_ns - run.heard[0].stamp_ns) / 1e9:.1f} s"


# -- showing --------------------------------------------------------------------------------------


def show(rows: Sequence[Row]) -> None:
    """The table, and below it what was said."""
    from rich.console import Console
    from rich.table import Table

    console = Console(width=None if sys.stdout.isatty() else 130)
    table = Table(title="The paper's table II (monitor of models) beside ours", title_style="bold")
    for name in ("", "fault", "node", "the paper's monitor", "this one", "verdict after"):
        table.add_column(name, justify="right" if name == "verdict after" else "left")
    for row in rows:
        table.add_row(row.id, row.type, row.node, row.paper, _found(row), _latency(row))
    console.print(table)
    for row in rows:
        if row.reason:
            console.print(f"{row.id}: {' and '.join(row.violated)}: {row.reason}", markup=False)
        if row.problem:
            console.print(f"{row.id}: FAILED: {row.problem}", markup=False)
    if rows[0].properties:
        lines = [
            (row.id, row.paper, f"{_found(row)} {_latency(row)}".strip(), row.properties)
            for row in rows
        ]
        by_property.show(console, lines)


def _found(row: Row) -> str:
    if row.id == "nominal":
        return f"FALSE ALARM: {', '.join(row.violated)}" if row.violated else "says nothing"
    if row.latency_ms is None:
        return "NOT DETECTED"
    if row.after_deadline_ms is not None:
        return "detects at the deadline" if row.detected else f"detects, but {row.problem}"
    return "detects at first occurrence" if row.detected else f"detects, but {row.problem}"


def _latency(row: Row) -> str:
    if row.latency_ms is None:
        return ""
    if row.after_deadline_ms is not None:
        return f"deadline + {row.after_deadline_ms:.0f} ms"
    return f"{row.latency_ms:.0f} ms"


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Run the paper's faults, every model monitored.")
    parser.add_argument("--transport", choices=("zenoh", "simulated"), default="zenoh")
    parser.add_argument("--json", action="store_true", help="one JSON object a line")
    parser.add_argument(
        "--fault",
        action="append",
        choices=[item.id for item in FAULTS],
        help="only this one, and the tour as it is (repeatable)",
    )
    parser.add_argument(
        "--properties", action="store_true", help="monitor the tour's properties, too"
    )
    parser.add_argument(
        "--nominal", type=float, metavar="SECONDS", help="only the tour as it is, this long"
    )
    parser.add_argument(
        "--busy", type=int, default=0, metavar="N", help="beside N processes that only compute"
    )
    chosen = parser.parse_args(arguments)
    logging.basicConfig(level=logging.CRITICAL)  # what the policy complains of is the fault at work
    from m2c.model import ModelError
    from moon.monitor.reading import read_checked
    from moon.properties.files import load_properties
    from transports.interface import TransportError

    runner: Callable[[Fault | None, System, float, Sequence[Property]], Run]
    runner = simulated if chosen.transport == "simulated" else on_zenoh
    names = list(dict.fromkeys(chosen.fault or [item.id for item in FAULTS]))
    rows = []
    try:
        system = read_checked([SYSTEM])
        properties = load_properties(by_property.PROPERTIES) if chosen.properties else []
        with _busy(chosen.busy):
            run = runner(None, system, chosen.nominal or TOUR_S, properties)
            rows.append(with_properties(judged_nominal(run), None, run))
            _report(rows[-1], chosen.json)
            for name in [] if chosen.nominal else names:
                run = runner(fault(name), system, TOUR_S, properties)
                rows.append(with_properties(judged(fault(name), run), fault(name), run))
                _report(rows[-1], chosen.json)
    except (PatchError, ModelError, RunError, TransportError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    if not chosen.json:
        show(rows)
    return 0 if all(row.is_well for row in rows) else 1


@contextlib.contextmanager
def _busy(number: int) -> Iterator[None]:
    """``number`` processes that keep the processors busy."""
    command = [sys.executable, "-c", "while True: pass"]
    processes = [subprocess.Popen(command) for _ in range(number)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def _report(row: Row, as_json: bool) -> None:
    if as_json:
        print(msgspec.json.encode(row).decode(), flush=True)
    else:
        print(f"{row.id}: {_found(row)} {_latency(row)}".rstrip(), file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
