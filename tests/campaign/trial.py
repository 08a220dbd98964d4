"""One trial: a system run in one world with a monitor and a recorder, and what is said held against the truth."""

from __future__ import annotations

import logging
import tempfile
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from random import Random

import msgspec

from m2c.model.machine import Machine
from m2c.simulation.program import Program, compile_node, compile_system
from m2c.simulation.run import SimulatedRun
from moon.judge import Gap, Judge, Missing
from moon.monitor.status import POLICY, PROPERTY, UNSEEN
from moon.monitor.subject import Monitored, Subject, read_subject
from moon.offline.engine import EmptyRecordingError, check_recording
from moon.offline.result import CheckResult
from moon.oracle.bounds import Bounds
from moon.policy.shape import shape_of
from moon.recording.definitions import Definitions
from moon.recording.reader import RecordingError
from moon.recording.recorder import Recorder
from moon.recording.writer import RecordingWriter
from moon.run import Run
from moon.sources.recorded import RecordedConnection, RecordedRun
from moon.sources.source import Outputs
from moon.verdict import Cause, Outcome, Verdict
from tests.campaign import truth
from tests.campaign.bags import Bag, write_bag
from tests.campaign.circumstances import MONITOR, NS, Circumstances, Faulty, Happened
from tests.campaign.meddler import Meddler
from tests.campaign.plans import PROPERTY_FILE
from tests.moving_clock import MovingClock
from tests.mutation.operators import Mutant, mutants
from transports.interface import Observation
from transports.simulated import Conditions, Rules, SimulatedTransport, SimulatedWorld
from transports.simulated.world import START_NS

BEFORE_S = 0.01
"""The nodes begin to connect so long after a monitor listens that is there first."""
SETTLED_S = 6.5
"""So long after the last thing that was wrong every machine that does something is judged again."""
AGAIN = 3
"""A mutant that shows so often after a late monitor has settled goes on showing: it is found late, too."""
MOST_HYPOTHESES = 64
"""A monitor follows so many: fewer than by default, so that a trial takes half a second. It makes more
inconclusive and nothing else."""
_FLUSHES = 4


class Fault(StrEnum):
    """What is wrong with what a monitor says."""

    FALSE_ALARM = "a node that does what its model does is violated"
    CONTRADICTION = "a property that holds is violated"
    MISSED = "a property that is broken is conforming, and nothing was missed"
    WITHDRAWN = "a violation was withdrawn"
    MISSED_MUTANT = "everything that happened shows a mutant, and its node is not violated"
    MISSED_LATE = "a mutant that shows again and again is not found by a monitor that came late"
    DIFFERS = "the recording is judged otherwise than the run was"
    RAISED = "something raised an exception"
    SET = "a clock is said to have been set, and none was"
    STUCK = "a machine is still inconclusive long after the last thing that was wrong"


class Failure(msgspec.Struct, frozen=True):
    """One of them: of which node or property, and what was said."""

    fault: Fault
    about: str
    text: str


class Result(msgspec.Struct, frozen=True):
    """What came of a trial.

    Attributes:
        failures: what is wrong.
        observations: everything that happened.
        judged: machines, policies and properties of which something was said.
        settled: machines that should be judged again at the end.
        stuck: those of them that are not, and why.
        detected: whether the mutant, if one ran, was found; None: nothing that happened shows it.
        in_bag: the machines of which something was concluded from a bag, and all that there are; (0, 0) if
            there was no bag, or it was refused.
    """

    failures: tuple[Failure, ...]
    observations: int
    judged: int
    settled: int
    stuck: tuple[str, ...]
    detected: bool | None = None
    in_bag: tuple[int, int] = (0, 0)


class ClockSteps(Judge[Observation]):
    """Notes of what is said of clocks; it judges nothing.

    Args:
        said: gets what is said.
    """

    name = "clocks"

    def __init__(self, said: list[Gap]) -> None:
        self._said = said

    def observe(self, seen: Observation) -> tuple[Verdict, ...]:
        return ()

    def gap(self, gap: Gap) -> tuple[Verdict, ...]:
        if gap.cause in (Missing.CLOCK_SET, Missing.OWN_CLOCK_SET):
            self._said.append(gap)
        return ()


class Prepared:
    """A system as it is written, read, generated and imported; for any number of trials.

    Args:
        path: the system file, perhaps with properties beside it.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        file = path.parent / PROPERTY_FILE
        self._subject = Subject(
            (self.path,), (file,) if file.exists() else (), (), (), (), Bounds()
        )
        self.clock_steps: list[Gap] = []
        """What the last monitor, or the last check of a recording, said of clocks that were set."""
        read = read_subject(self._subject)
        judges = (lambda: ClockSteps(self.clock_steps),)
        self._monitored = msgspec.structs.replace(read, judges=judges)
        self.program: Program = compile_system(self._monitored.system)
        self._mutants: dict[str, tuple[Mutant, ...]] = {}
        self._bounded: dict[float, tuple[Subject, Monitored]] = {}
        self._truth = truth.TrueProperties(self._monitored.properties)

    def subject(self, latency_s: float) -> tuple[Subject, Monitored]:
        """What is monitored, with this latency bound."""
        if latency_s not in self._bounded:
            bounds = Bounds(latency=round(latency_s * NS), hypotheses=MOST_HYPOTHESES)
            replace = msgspec.structs.replace
            self._bounded[latency_s] = (
                replace(self._subject, bounds=bounds),
                replace(self._monitored, bounds=bounds),
            )
        return self._bounded[latency_s]

    def true_of(
        self, seen: Sequence[Observation], end_ns: int, latency_s: float, begin_ns: int = START_NS
    ) -> dict[str, truth.PropertyTruth]:
        """What is true of each property of a run (``TrueProperties.of``) for who sees all within ``latency_s``."""
        found_ns = max(START_NS + round((BEFORE_S + latency_s) * NS), begin_ns)
        return self._truth.of(seen, end_ns, found_ns, begin_ns)

    @property
    def machines(self) -> tuple[Machine, ...]:
        """Of the nodes."""
        return self._monitored.system.nodes

    def happened(self, seed: int, seconds: float) -> Happened:
        """What it does when nothing is wrong."""
        seen: list[Observation] = []
        world = SimulatedWorld(seed)
        world.witness(seen.append)
        with _quiet():
            SimulatedRun(self.program, world).run(seconds)
            world.close()
        true = self.true_of(seen, world.now_ns, 0.0)
        broken = tuple(one.is_broken for one in true.values() if one.is_broken)
        nodes = tuple(machine.name for machine in self.machines)
        if self.program.policy is not None:
            nodes += (POLICY,)
        return Happened(nodes, tuple(seen), broken)

    def mutants_of(self, node: str) -> tuple[Mutant, ...]:
        """Of the machine of ``node``."""
        if node not in self._mutants:
            (machine,) = [machine for machine in self.machines if machine.name == node]
            self._mutants[node] = tuple(mutants(machine))
        return self._mutants[node]

    def faulty(self, random: Random) -> Faulty | None:
        """One of all mutants; None of a node that has none, or that is not judged."""
        node = random.choice(self.machines).name
        count = len(self.mutants_of(node))
        is_judged = any(machine.name == node for machine in self._monitored.machines)
        return Faulty(node, random.randrange(count)) if count and is_judged else None

    def program_with(self, faulty: Faulty | None) -> Program:
        """Its code, with a fault in one node."""
        if faulty is None:
            return self.program
        mutant = self.mutants_of(faulty.node)[faulty.mutant]
        node = compile_node(mutant.machine, self._monitored.system)
        return self.program.replacing(faulty.node, node)


class _Trial:
    def __init__(self, prepared: Prepared, seed: int, made: Circumstances, path: Path) -> None:
        self.prepared, self.made, self.path = prepared, made, path
        self.subject, self.monitored = prepared.subject(made.latency_s)
        self.world = SimulatedWorld(seed, made.conditions)
        self.true: list[Observation] = []
        self.world.witness(self.true.append)
        self.verdicts: list[Verdict] = []
        self.withdrawn: list[str] = []
        self.watch: Run | None = None
        self.run: RecordedRun | None = None
        self.in_bag = (0, 0)
        self.killed: Path | None = None
        """What the recorder has recorded that was killed."""

    def take(self, verdict: Verdict) -> None:
        """The monitor says something."""
        self.verdicts.append(verdict)

    def go(self) -> None:
        """The whole run."""
        made, world = self.made, self.world
        self.prepared.clock_steps.clear()
        self.writer = RecordingWriter(self.path, Definitions(self.monitored.system.library))
        if not made.joins_s:
            self._watch()
        end_of_recorder = self._record() if made.recorded_s else lambda: None
        world.run_for(BEFORE_S)
        nodes = SimulatedRun(self.prepared.program_with(made.faulty), world)
        if made.meddled:
            Meddler(world, self.prepared.machines, self.monitored.system.library)
        if made.joins_s:
            nodes.run(max(made.joins_s - self.passed_s, 0.0))
            self._watch()
        for _ in range(_FLUSHES):
            nodes.run((made.seconds - self.passed_s) / _FLUSHES)
        assert self.watch is not None
        assert self.run is not None
        assert self.watch.listener is not None
        self.end_ns = world.now_ns
        self.clock_steps = list(self.prepared.clock_steps)
        self.standings = list(self.watch.standings())
        self.run.end(self.watch.listener.problems())
        self.writer.close()
        end_of_recorder()

    @property
    def passed_s(self) -> float:
        """Since the world's begin."""
        return (self.world.now_ns - START_NS) / NS

    def _watch(self) -> None:
        world = self.world
        transport = MovingClock(world, MONITOR)
        connection = RecordedConnection(transport, self.writer.add, "simulated")
        self.run = RecordedRun(connection, self.writer)
        properties = self.monitored.property_watch()
        properties.withdrawn = lambda name, since_ns: self.withdrawn.append(name)
        outputs = Outputs([self.run, self])
        self.watch = Run(connection, self.monitored, outputs, properties)
        self.watch.start()

    def _record(self) -> Callable[[], None]:
        """Another recorder, beside the monitor; it is killed. Closes its file, if it outlived the run."""
        world, path = self.world, self.path.with_name("killed.mcap")
        writer = RecordingWriter(path, Definitions(self.monitored.system.library))
        connection = SimulatedTransport(world, "recorder")
        recorder = Recorder(
            connection, "simulated", writer, (), lambda said: None, lambda: world.now_ns
        )
        recorder.start()
        looks = connection.every(0.5, recorder.look_around)

        def kill() -> None:
            looks.cancel()
            connection.close()
            writer.close()
            self.killed = path

        connection.after(self.made.recorded_s, kill)
        return writer.close

    # --- what is wrong -----------------------------------------------------------------------------

    def failures(self) -> Iterator[Failure]:
        """Of what was said."""
        for verdict in self.verdicts:
            if self._is_false(verdict):
                yield Failure(Fault.FALSE_ALARM, verdict.node, verdict.reason)
        for name in dict.fromkeys(self.withdrawn):
            yield Failure(Fault.WITHDRAWN, name, "")
        made = self.made.conditions
        if made.rules is Rules.ZENOH and not made.clocks:  # those of ROS 2 cannot be asked
            for gap in self.clock_steps[:1]:
                yield Failure(Fault.SET, gap.source, gap.why)
        yield from self._of_properties()
        yield from self._of_recording()
        if self.killed is not None:
            yield from self._of_killed(self.killed)
        if self.made.bag is not None:
            path = self.path.with_name("bag.mcap")
            yield from self.of_bag(path, self.made.bag)

    def _is_false(self, verdict: Verdict) -> bool:
        """Whether it says that a node is wrong that does what its model does, in time."""
        if not _is_violated(verdict) or verdict.kind != "model":
            return False
        if self.made.faulty is not None and verdict.node == self.made.faulty.node:
            return False
        is_silence = verdict.cause in (Cause.UNRESPONSIVE, Cause.NOT_TAKEN)
        return not (is_silence and self.made.may_be_silent(verdict.node))

    def of_bag(self, path: Path, bag: Bag) -> Iterator[Failure]:
        """What is said of a bag that somebody else's recorder makes of the run."""
        run = bag.recorded(self.true)
        write_bag(path, bag, run, self.monitored.system)
        try:
            result = check_recording(path, self.subject, self.monitored, view=bag.view)
        except (RecordingError, EmptyRecordingError):
            return  # it is refused: nothing is said
        concluded = (Outcome.CONFORMING, Outcome.VIOLATED)
        known = [one for one in result.machines if one.kind == "model" and one.verdict in concluded]
        self.in_bag = len(known), len(self.monitored.machines)
        begin_ns = run[0].stamp_ns  # a recording begins with its first entry
        true = self.prepared.true_of(run, self.end_ns, self.made.latency_s, begin_ns)
        for verdict in (said.verdict for said in result.verdicts):
            if self._is_false(verdict):
                yield Failure(Fault.FALSE_ALARM, verdict.node, f"from a bag: {verdict.reason}")
        for name, outcome in self._by_property(result):
            if outcome == Outcome.VIOLATED and not true[name].may_be_broken:
                yield Failure(Fault.CONTRADICTION, name, f"from a bag, by {result.recording.time}")

    def _of_killed(self, path: Path) -> Iterator[Failure]:
        """What is said of a recording whose recorder was killed: all of it is judged, up to its end.

        What happened so shortly before that it may have been under way is not known.
        """
        result = check_recording(path, self.subject, self.monitored)
        for verdict in (said.verdict for said in result.verdicts):
            if self._is_false(verdict):
                text = f"from a recording: {verdict.reason}"
                yield Failure(Fault.FALSE_ALARM, verdict.node, text)
        if not self.made.has_true_time:
            return
        end_ns = result.recording.last_ns
        until = [one for one in self.true if one.stamp_ns <= end_ns]
        true = self.prepared.true_of(until, end_ns, self.made.latency_s)
        known_ns = end_ns - round(self.made.conditions.tap_delay_s[1] * NS)
        for name, outcome in self._by_property(result):
            if outcome == Outcome.VIOLATED and not true[name].may_be_broken:
                yield Failure(Fault.CONTRADICTION, name, "from a recording")
            is_broken = 0 < true[name].is_broken < known_ns
            if self.made.is_whole and outcome == Outcome.CONFORMING and is_broken:
                text = f"from a recording: broken since {self._at(true[name].is_broken)}"
                yield Failure(Fault.MISSED, name, text)

    def _by_property(self, result: CheckResult) -> Iterator[tuple[str, str]]:
        for status in result.machines:
            if status.kind == PROPERTY and status.machine != ClockSteps.name:
                yield status.machine, status.verdict

    def _of_properties(self) -> Iterator[Failure]:
        made = self.made
        if not (made.has_true_time or made.has_one_clock or made.has_close_clocks):
            return  # durations are measured by clocks that are wrong
        true = self.prepared.true_of(self.true, self.end_ns, self.made.latency_s)
        said = [verdict for verdict in self.verdicts if verdict.kind != "model"]
        violated = {verdict.node: verdict for verdict in said if _is_violated(verdict)}
        for name, verdict in violated.items():
            if not true[name].may_be_broken:
                yield Failure(Fault.CONTRADICTION, name, verdict.reason)
        late_ns = self.end_ns - 2 * NS
        outcomes = {name: text for name, _, text, _ in self.standings if name in true}
        for name, outcome in outcomes.items():
            is_broken = 0 < true[name].is_broken < late_ns
            if made.is_whole and is_broken and outcome == Outcome.CONFORMING:
                yield Failure(Fault.MISSED, name, f"broken since {self._at(true[name].is_broken)}")

    def _of_recording(self) -> Iterator[Failure]:
        result = check_recording(self.path, self.subject, self.monitored)
        offline = [said.verdict for said in result.verdicts]
        for number, (one, other) in enumerate(zip(self.verdicts, offline, strict=False)):
            if one != other:
                text = f"verdict {number}: {_short(one)}, from the recording {_short(other)}"
                yield Failure(Fault.DIFFERS, one.node, text)
                return
        if len(self.verdicts) != len(offline):
            longer = max(self.verdicts, offline, key=len)[min(len(self.verdicts), len(offline)) :]
            where = "live" if len(self.verdicts) > len(offline) else "from the recording"
            yield Failure(Fault.DIFFERS, longer[0].node, f"only {where}: {_short(longer[0])}")

    def _at(self, stamp_ns: int) -> str:
        return f"{(stamp_ns - START_NS) / NS:.3f} s"

    def detected(self) -> bool | None:
        """Whether the mutant was found; None: there is none, or nothing shows it.

        To a monitor that came late, a run shows it that does so ``AGAIN`` times after the monitor has settled.
        """
        faulty = self.made.faulty
        if faulty is None:
            return None
        if any(_is_violated(v) and v.node == faulty.node for v in self.verdicts):
            return True
        (machine,) = [one for one in self.prepared.machines if one.name == faulty.node]
        system, end_ns = self.monitored.system, self.end_ns - 2 * NS
        seen = [one for one in self.true if one.stamp_ns < end_ns]
        joined_ns = START_NS + round(self.made.joins_s * NS)
        if self.made.joins_s and truth.may_have_ended(machine, seen, joined_ns):
            return None
        shown = truth.violations(machine, system, seen, self.monitored.bounds, end_ns)
        if self.made.joins_s:
            settled_ns = joined_ns + round(SETTLED_S * NS)
            times = truth.occurrences(shown, settled_ns, self.monitored.bounds.deadline)
            return False if len(times) >= AGAIN else None
        return False if shown else None

    def settled(self) -> list[tuple[str, str]]:
        """Machines that are to be judged again by the end, and how they stand."""
        if self.made.over_s + SETTLED_S > self.made.seconds or self.made.faulty is not None:
            return []
        return [
            (name, text)
            for name, kind, text, _ in self.standings
            if kind == "model" and text != UNSEEN and (name != POLICY or self._is_policy_judged())
        ]

    def _is_policy_judged(self) -> bool:
        """Whether a policy of this shape is judged after something was wrong; ``moon explain`` says it, too."""
        policy = self.prepared.program.policy
        assert policy is not None
        shape = shape_of(policy, self.monitored.system.plugins)
        return not shape.unchecked and (shape.forgets or not self.made.over_s)


def _reason(verdicts: list[Verdict], node: str) -> str:
    return next((one.reason for one in reversed(verdicts) if one.node == node), "")


def said_of(prepared: Prepared, seed: int, made: Circumstances) -> list[Verdict]:
    """What a monitor says of one run."""
    with tempfile.TemporaryDirectory() as folder, _quiet():
        trial = _Trial(prepared, seed, made, Path(folder) / "run.mcap")
        try:
            trial.go()
        finally:
            trial.world.close()
        return trial.verdicts


def try_one(prepared: Prepared, seed: int, made: Circumstances, keep: Path | None = None) -> Result:
    """Run one trial.

    Args:
        prepared: the system.
        seed: of the world.
        made: what it is run under.
        keep: where the recording is left; None: nowhere.
    """
    with tempfile.TemporaryDirectory() as folder, _quiet():
        trial = _Trial(prepared, seed, made, keep or Path(folder) / "run.mcap")
        try:
            trial.go()
            failures = list(trial.failures())
            detected = trial.detected()
        except Exception as error:
            failed = Failure(Fault.RAISED, trial.world.failed or "", _described(error))
            return Result((failed,), len(trial.true), 0, 0, ())
        finally:
            trial.world.close()
        if detected is False and made.is_undisturbed and made.faulty is not None:
            mutant = prepared.mutants_of(made.faulty.node)[made.faulty.mutant]
            fault = Fault.MISSED_LATE if made.joins_s else Fault.MISSED_MUTANT
            failures.append(Failure(fault, made.faulty.node, mutant.description))
        settled = trial.settled()
        stuck = tuple(
            f"{name}: {_reason(trial.verdicts, name)}"
            for name, text in settled
            if text == Outcome.INCONCLUSIVE
        )
        judged = sum(text != UNSEEN for _, _, text, _ in trial.standings)
        return Result(
            _distinct(failures),
            len(trial.true),
            judged,
            len(settled),
            stuck,
            detected,
            trial.in_bag,
        )


def try_bags(prepared: Prepared, seed: int, bags: Iterable[Bag]) -> Iterator[tuple[Bag, Failure]]:
    """Run a system once, with nothing wrong; what is wrong with what is said of ``bags`` of that run.

    Args:
        prepared: the system.
        seed: of the world.
        bags: what others' recorders make of it; each is drawn when the one before was checked.
    """
    made = Circumstances(Conditions(delay_s=(0.0, 0.002), tap_delay_s=(0.0, 0.002)), seconds=10.0)
    with tempfile.TemporaryDirectory() as folder, _quiet():
        trial = _Trial(prepared, seed, made, Path(folder) / "run.mcap")
        trial.go()
        trial.world.close()
        for bag in bags:
            for failure in trial.of_bag(Path(folder) / "bag.mcap", bag):
                yield bag, failure


def _distinct(failures: list[Failure]) -> tuple[Failure, ...]:
    """The first of each kind about each node."""
    first: dict[tuple[str, str], Failure] = {}
    for failure in failures:
        first.setdefault((failure.fault, failure.about), failure)
    return tuple(first.values())


def _is_violated(verdict: Verdict) -> bool:
    return verdict.outcome is Outcome.VIOLATED


def _short(verdict: Verdict) -> str:
    return f"{verdict.node} {verdict.outcome} at {verdict.stamp_ns}: {verdict.reason}"


def _described(error: Exception) -> str:
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {error} ({last.filename}:{last.lineno} in {last.name})"


@contextmanager
def _quiet() -> Iterator[None]:
    """What generated machines log of failing expressions is theirs."""
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        yield
    finally:
        logging.disable(before)
