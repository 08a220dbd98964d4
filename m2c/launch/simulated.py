"""``m2c run --transport simulated``: all nodes of a system in this process, in virtual time."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from m2c.check.report import print_findings
from m2c.launch.composed import part_of
from m2c.launch.description import NODE_CLASS, LaunchError, is_code, package_in, selected
from m2c.launch.log_files import LogFiles
from m2c.launch.observers import observer
from m2c.launch.options import RunOptions
from m2c.launch.reading import read_to_run
from m2c.launch.screen import Guarded, Said, Screen, screen_for
from m2c.launch.simulation_options import LONGEST_S, TRANSPORT, Simulation
from m2c.launch.watching import WATCHER, watcher
from m2c.logs import LineFormatter
from m2c.model import ModelError
from m2c.model.system import System
from m2c.naming import naming_for
from m2c.policy.library import PolicyError
from m2c.raised import described
from m2c.runtime.node import warn_of_slips
from m2c.simulation.program import NodeClass, Program, compile_system, import_node
from m2c.simulation.run import POLICY_NODE, SimulatedRun
from m2c.simulation.semantics import Semantics
from m2c.terminal import fail, say
from transports.interface import TransportError
from transports.simulated import Conditions, SimulatedWorld
from transports.stop_signals import StopSignals, end_by

if TYPE_CHECKING:
    from m2c.policy.runner import TreeTick
    from transports.simulated.tasks import Task

DEFAULT_S = 60.0
"""A run for which nothing else says when it ends does so after so much virtual time."""
BEFORE_S = 0.01
"""What observes the run has listened for so long when the nodes begin to connect."""
STOP_S = 60.0
"""How long the policy may take to end, in virtual time: skills that do not answer are given up before."""
STILL = 100_000
"""So many events at one instant are a model that goes on without end: it sends itself one after another."""
_NS = 1e9


def run_simulated(
    options: RunOptions, changed: dict[str, Path], of_monitor: list[str] | None
) -> int:
    """Run a system in virtual time.

    Args:
        options: the command line.
        changed: what is run in nodes' places, by their names.
        of_monitor: the options of the monitor, if there is to be one.

    Returns:
        The exit code; what keeps the system from being run ends the process with 2.
    """
    path, simulation = options.system, options.simulation
    if path.is_dir():
        fail(f"--transport {TRANSPORT}: it runs models: give the system file as SYSTEM")
    semantics = Semantics(simulation.semantics or Semantics.DEPLOYED)
    if semantics is Semantics.AS2FM:
        _refuse_what_is_deployed(options, changed, of_monitor)
    system = read_to_run(options, changed, naming_for(TRANSPORT))
    try:
        program = _program(system, changed, options.only, options.without, semantics)
        if options.ticks and program.policy is None:
            fail(f"--ticks {options.ticks}: the policy is not run, so nothing is ticked")
        if options.tick_timeout and program.policy is None:
            fail(
                f"--tick-timeout {options.tick_timeout:g}: the policy is not run, so nothing is ticked"
            )
        watch = watcher(path, of_monitor, options.record, system.library.folders)
        signals = StopSignals()
        world = _world(simulation, semantics)
        with screen_for(
            program.policy, options.quiet, as_json=options.as_json, now_ns=lambda: world.now_ns
        ) as screen:
            return _Run(system, program, options, world, screen).run(signals, watch)
    except ModelError as error:
        print_findings(error.diagnostics)
        sys.exit(2)
    except (LaunchError, PolicyError, TransportError) as error:
        fail(str(error))


def _world(simulation: Simulation, semantics: Semantics) -> SimulatedWorld:
    """The world in which a system runs."""
    delay_s = simulation.delay_s or Conditions().delay_s
    conditions = Conditions(
        delay_s=delay_s,
        tap_delay_s=delay_s,
        loss=simulation.loss or 0.0,
        tap_loss=simulation.tap_loss or 0.0,
    )
    return semantics.world(simulation.seed or 0, conditions)


def _refuse_what_is_deployed(
    options: RunOptions, changed: dict[str, Path], of_monitor: list[str] | None
) -> None:
    """End the process if options were given that AS2FM's meaning has no place for."""
    simulation = options.simulation
    given = f"--semantics {Semantics.AS2FM}"
    if simulation.delay_s is not None or simulation.loss is not None:
        fail(f"{given}: --delay and --loss are for deployed systems: here messages arrive at once")
    if options.tick_timeout is not None:
        fail(f"{given}: --tick-timeout is for deployed systems: AS2FM knows no time limit")
    if of_monitor is not None:
        fail(f"{given}: --monitor judges nodes as they are deployed; --record records the run")
    for name, path in changed.items():
        if is_code(path):
            fail(f"{given}: --replace {name}={path}: generated code is deployed; give the model")


def _program(
    system: System,
    changed: dict[str, Path],
    only: tuple[str, ...],
    without: tuple[str, ...],
    semantics: Semantics,
) -> Program:
    """The code of the chosen nodes, imported.

    Raises:
        LaunchError: a name is not one of the system, or a folder is not a generated package.
        ModelError: the policy cannot be used.
    """
    names = [node.name for node in system.nodes] + [POLICY_NODE] * (system.policy is not None)
    kept = selected(system.name, names, only, without)
    nodes = tuple(node for node in system.nodes if node.name in kept)
    policy = system.policy if POLICY_NODE in kept else None
    chosen = msgspec.structs.replace(system, nodes=nodes, policy=policy)
    program = compile_system(chosen, semantics)
    for name, path in changed.items():
        if is_code(path) and name in program.nodes:
            program = program.replacing(name, _node_class(path, name))
    return program


def _node_class(path: Path, name: str) -> NodeClass:
    """The class of a node that is generated, or written by hand."""
    package = package_in(path)
    if path.is_dir() and (path / package / "machine.py").is_file():
        texts = {file.stem: file.read_text() for file in (path / package).glob("*.py")}
        del texts["__main__"]
        return import_node(package, texts, name)
    sys.path.insert(0, str(path if path.is_dir() else path.parent))
    node_class: NodeClass = part_of(package, NODE_CLASS)[1]
    return node_class


class _Run:
    """One run.

    Args:
        system: what is run.
        program: its code.
        options: how, and when to stop; where they do not say it, the system file does.
        world: in which; it is closed at the end.
        screen: where it is shown.

    Raises:
        LaunchError: the folder for logs cannot be made.
    """

    def __init__(
        self,
        system: System,
        program: Program,
        options: RunOptions,
        world: SimulatedWorld,
        screen: Screen,
    ) -> None:
        self._name = system.name
        self._channels = system.channels
        self._program = program
        self._rate_hz = rate_hz = options.rate or system.tick_rate_hz
        self._most_ticks = ticks = options.ticks or 0
        self._simulation = simulation = options.simulation
        self._tick_timeout_s = options.tick_timeout
        self._log_level = options.log_level or logging.getLevelName(logging.INFO)
        self._logs = LogFiles(options.log_dir)
        default_s = system.max_time_s or DEFAULT_S
        if ticks:  # what is asked for is done; but a leaf that never answers ends no run of AS2FM's
            is_stepwise = program.semantics.is_stepwise
            default_s = DEFAULT_S + ticks / rate_hz if is_stepwise else LONGEST_S
        self._seconds = simulation.seconds or default_s
        self._screen = Guarded(screen, self._cannot_show)
        self._world = world
        self._nodes: SimulatedRun | None = None
        self._ticking: Task | None = None
        self._ticks = 0
        self._is_cut_short = False
        """Whether the tree was still ticked when the time was over."""
        self._has_begun = False
        """Whether the nodes were started, or one of them failed as it was."""
        self._interrupted = False
        self._unshown: OSError | None = None
        """Why nothing can be shown."""
        self._fault = ""
        """What a node raised, and where."""
        self._stands_still = False
        """Whether no time passes any more, where that is no fault: in steps."""
        self._instant = (0, 0)
        """Virtual time as it was seen last, and how many events of the system have happened since."""
        self._took = (0.0, 0.0)
        """Seconds of virtual and of real time."""

    def run(self, signals: StopSignals, watch: tuple[str, ...]) -> int:
        """Run to the end.

        Args:
            signals: what stops it.
            watch: the command line of what observes it, if anything does.

        Returns:
            0 after the last tick, the last second or Ctrl-C; 1 if a node raised something, or the observer
            found a violation; what the observer ended with, if that was before anything ran.

        Raises:
            LaunchError: there is no such observer.
            PolicyError: BehaviorTree.CPP refuses the tree.
            OSError: the screen cannot be written to.
        """
        signals.call(self._interrupt, again=end_by)
        found = 0
        try:
            if watch:
                name, *words = watch
                observe = observer(name)
                connection = self._world.connect(WATCHER)
                with self._faults_kept():
                    found = observe([*words, "--transport", TRANSPORT], connection, self._drive)
                if not self._has_begun:
                    return found
            else:
                self._drive(lambda: False)
        finally:
            self._world.close()
        if self._unshown is not None and not self._interrupted:
            raise self._unshown
        self._report(bool(found))
        return 1 if found or self._fault else 0

    def _drive(self, is_over: Callable[[], bool]) -> None:
        """From the start of the nodes to their end (``m2c.launch.observers.Drive``)."""
        world, simulation = self._world, self._simulation
        self._has_begun = True
        world.run_for(BEFORE_S)
        self._introduce()
        began_ns, began_s = world.now_ns, time.monotonic()
        # without what is due at the very end, unless AS2FM says so: a tick a second for 60 s is 60 ticks
        is_deployed = not self._program.semantics.is_stepwise
        end_ns = began_ns + round(self._seconds * _NS) - is_deployed
        with self._logs_shown():
            world.keep_pace(simulation.speed)
            with self._faults_kept():
                self._start()
                world.run(lambda: self._has_ended() or is_over(), end_ns)
            self._is_cut_short = self._ticking is not None and not self._ticking.done
            world.keep_pace(None)
            self._took = ((world.now_ns - began_ns) / _NS, time.monotonic() - began_s)
            for _ in tuple(world.nodes):  # each may fail, once
                with self._faults_kept():
                    self._stop()
                    break
        if self._stands_still and self._nodes is not None:
            self._nodes.close()  # it would never end

    def _start(self) -> None:
        semantics = self._program.semantics
        self._nodes = nodes = SimulatedRun(
            self._program,
            self._world,
            semantics.settings(self._seconds),
            self._show_tick,
            self._has_ended,
            self._limit_s(),
        )
        for node in nodes.nodes.values():
            warn_of_slips(node, self._channels)
        policy = nodes.policy
        if policy is None:
            return

        def tick() -> None:
            try:
                policy.run(self._rate_hz, self._most_ticks or None, semantics.is_stepwise)
            except Exception:
                self._world.failed = self._world.failed or POLICY_NODE
                raise

        self._ticking = self._world.spawn(tick, POLICY_NODE)

    def _limit_s(self) -> float:
        """How long a leaf may take to answer a tick."""
        return self._tick_timeout_s or self._program.semantics.tick_timeout_s(self._seconds)

    def _has_ended(self) -> bool:
        """Whether the last tick was made, a signal came, or time stands still."""
        self._look_at_time()
        ticking = self._ticking
        ended = self._interrupted or self._stands_still
        return ended or (ticking is not None and ticking.done)

    def _look_at_time(self) -> None:
        """Find out whether time stands still: many events, all at one instant.

        Raises:
            TransportError: it does, and that is the fault of the node that acted last; in steps it is none.
        """
        world = self._world
        now_ns, count = self._instant
        if now_ns != world.now_ns:
            self._instant = (world.now_ns, 0)
        elif world.acted != WATCHER:  # much may be received at one instant of what happened before
            self._instant = (now_ns, count + 1)
        if self._instant[1] > STILL:
            self._instant = (now_ns, 0)
            if self._program.semantics.is_stepwise:
                self._stands_still = True
                return
            world.failed = world.acted
            raise TransportError(
                f"{STILL:,} events and no time has passed: does its model send itself "
                "event after event? Give one a delay"
            )

    def _stop(self) -> None:
        """The policy halts its tree. The nodes go on, until what observes them has judged the rest."""
        nodes, ticking = self._nodes, self._ticking
        if nodes is None or self._stands_still:
            return
        if nodes.policy is not None and ticking is not None:
            nodes.policy.stop()
            limit_s = self._limit_s()

            def is_over() -> bool:
                self._look_at_time()
                return ticking.done or self._stands_still

            self._world.run_until(is_over, max(STOP_S, 2 * limit_s))

    @contextmanager
    def _faults_kept(self) -> Iterator[None]:
        """A node that raises something dies, and who calls it gets an error; the run's end reports it."""
        try:
            yield
        except Exception as error:  # a node's code may be anybody's
            node = self._world.failed
            if node is None or node == WATCHER:
                raise
            self._fault = self._fault or f"{node}: {_described(error)}"
            self._world.failed = None
            self._world.crash(node)

    def _interrupt(self) -> None:
        self._interrupted = True
        self._world.wake()

    # --- what is shown -----------------------------------------------------------------------------

    def _introduce(self) -> None:
        count, speed = len(self._program.nodes), self._simulation.speed
        pace = "as fast as it goes" if speed is None else f"{speed:g} times as fast as real time"
        self._screen.line(
            f"{self._name}: {count} node{'s' * (count != 1)} in virtual time, {pace}, "
            f"seed {self._world.seed}"
        )
        if self._program.policy is not None:
            self._screen.line(f"ticking the tree {self._rate_hz:g} times a second")

    def _show_tick(self, tick: TreeTick) -> None:
        self._ticks = tick.tick
        self._screen.tick(tick)

    @contextmanager
    def _logs_shown(self) -> Iterator[None]:
        """What nodes log are lines after their names, as what a process prints is."""
        names = (*self._program.nodes, POLICY_NODE)
        handler = _Lines(self._world, self._screen, self._logs, names)
        root = logging.getLogger()
        before = root.level
        root.setLevel(self._log_level.upper())
        root.addHandler(handler)
        try:
            yield
        finally:
            root.removeHandler(handler)
            root.setLevel(before)
            self._logs.close()

    def _cannot_show(self, error: OSError) -> None:
        """A terminal that is gone, a full disk: nobody would see how it goes on."""
        self._unshown = error
        self._interrupt()

    def _report(self, has_violations: bool) -> None:
        ticks = "1 tick" if self._ticks == 1 else f"{self._ticks} ticks"
        if self._most_ticks and self._is_cut_short:
            ticks = f"{self._ticks} of {self._most_ticks} ticks"
        virtual_s, real_s = self._took
        found = f"; {WATCHER} found violations" if has_violations else ""
        if self._stands_still and not self._fault:
            found += f"; {STILL:,} events needed no time, and more would have followed"
        self._screen.line(
            f"stopped after {ticks}: {virtual_s:.1f} s of virtual time in {real_s:.1f} s{found}"
        )
        if self._fault:
            say(f"error: {self._fault}")


class _Lines(logging.Handler):
    """Shows records as lines: who logged it, and when in virtual time."""

    def __init__(
        self, world: SimulatedWorld, screen: Screen, logs: LogFiles, names: Sequence[str]
    ) -> None:
        super().__init__()
        self.setFormatter(LineFormatter("%(levelname)s %(name)s: %(message)s"))
        self._world = world
        self._screen = screen
        self._logs = logs
        self._width = max(map(len, names))

    def emit(self, record: logging.LogRecord) -> None:
        """Show ``record``."""
        who = self._world.running or record.name
        for text in self.format(record).split("\n"):
            said = Said(who, text, self._world.now_ns, is_virtual=True)
            self._logs.write(said)
            self._screen.said(said, self._width)


def _described(error: Exception) -> str:
    """An exception in one line; one of our own says by itself what is wrong."""
    is_told = isinstance(error, PolicyError | TransportError)
    return str(error) if is_told else described(error)
