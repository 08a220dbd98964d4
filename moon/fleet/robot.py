"""One robot of a fleet: judged by judges of its own while it is there, a line when it is gone."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable

import msgspec

from moon.fleet.status import RobotStatus
from moon.monitor.status import UNSEEN, MachineStatus
from moon.monitor.subject import Monitored
from moon.run import Run
from moon.sinks.topic import VerdictTopic
from moon.sources.live import Joining
from moon.sources.source import Outputs, Sink
from moon.tap.notices import Notices
from moon.verdict import Outcome, Verdict
from transports.interface import Listener, Timer

KEPT_S = 30.0
"""The judges of a robot that is gone are kept so long: if it is back, it is followed from its start."""

Failed = Callable[[Exception], None]


class _Naming:
    """Says in each verdict of which robot it is."""

    def __init__(self, robot: str, sink: Sink) -> None:
        self._robot = robot
        self._sink = sink

    def take(self, verdict: Verdict) -> None:
        self._sink.take(msgspec.structs.replace(verdict, robot=self._robot))


class _Life:
    """How a robot is listened to, and its judges, once something was received of it."""

    def __init__(self, connection: Listener, joining: Joining) -> None:
        self.connection = connection
        self.joining = joining
        self.watch: Run | None = None


class Robot:
    """One robot.

    Args:
        name: its namespace.
        monitored: what of it is monitored.
        connect: opens a listener to it (``Namespaces.within``).
        outputs: where what is found of this robot goes.
        may_judge: asked before judges are made: whether there is room for them.

    Attributes:
        name: as above.
        is_present: whether a node of it is up.
        has_failed: whether it is not judged any more because of an error of the monitor.
        gone_ns: when it was last seen to go (ns, monotonic); of use for an order only.
    """

    def __init__(
        self,
        name: str,
        monitored: Monitored,
        connect: Callable[[str, Failed], Listener],
        outputs: Outputs,
        may_judge: Callable[[], bool] = lambda: True,
    ) -> None:
        self.name = name
        self.is_present = False
        self.has_failed = False
        self.gone_ns = 0
        self._monitored = monitored
        self._connect = connect
        self._outputs = outputs
        self._say = outputs.say
        self._may_judge = may_judge
        self._notices = Notices(self._say)
        self._life: _Life | None = None
        self._release: Timer | None = None
        self._outcomes: dict[str, Outcome] = {}
        """The last of each machine and property."""
        self._violated: set[str] = set()
        self._why: dict[str, str] = {}
        """Why each machine and property is inconclusive, of those that are; the newest is last."""
        self._why_violated = ""
        self._why_failed = ""
        self._judged = 0
        self._earlier = (0, 0)
        """Violations and observations of the judges that it had before its present ones."""
        self._unwell: tuple[MachineStatus, ...] = ()
        """The machines that were not fine when the judges were freed."""
        self._measured = (0, 0)
        """When observations were counted last (ns, monotonic), and how many there were."""
        self._per_second = 0.0

    # --- coming and going --------------------------------------------------------------------------

    def appear(self) -> None:
        """Its first node is up."""
        self.is_present = True
        if self._release is not None:
            self._release.cancel()
            self._release = None
        if self._life is None and not self.has_failed:
            self._begin()

    def disappear(self) -> None:
        """None of its nodes is up any more."""
        self.is_present = False
        self.gone_ns = time.monotonic_ns()
        if self.is_judged and self._life is not None:
            self._release = self._life.connection.after(KEPT_S, self.release)
        else:
            self.release()

    def _begin(self) -> None:
        """Listen to it; judges are made when it does something."""
        connection = self._connect(self.name, self._fail)
        joining = Joining(connection)
        self._life = _Life(connection, joining)
        joining.when_active(self._judge, self._say)

    def _judge(self, since_ns: int) -> None:
        life = self._life
        if life is None or not self._may_judge():
            return
        self._outcomes.clear()
        self._why.clear()
        self._unwell = ()
        sinks: list[Sink] = [
            self,
            *(_Naming(self.name, sink) for sink in self._outputs.sinks),
            VerdictTopic(life.connection),
        ]
        screens = [_Naming(self.name, sink) for sink in self._outputs.screens]
        outputs = Outputs(sinks, self._say, screens, self.take)
        life.watch = watch = Run(life.joining, self._monitored, outputs)
        self._judged = len(watch.statuses())
        watch.start(since_ns)

    def release(self) -> None:
        """Free its judges; what they found stands."""
        self._release = None
        life = self._life
        if life is not None:
            if life.watch is not None:
                life.watch.settle()
                self._unwell = _unwell(life.watch)
            self._end(life)

    def _end(self, life: _Life) -> None:
        self._life = None
        if life.watch is not None:
            violations, received = self._earlier
            watch = life.watch
            self._earlier = (violations + watch.violations, received + watch.counts.received)
        life.connection.close()

    def ending(self, now_ns: int) -> None:
        """Who runs it begins to end its nodes (ns)."""
        if self._watch is not None:
            self._watch.ending(now_ns)

    def finish(self) -> None:
        """The monitor is to end: begin to judge, if it had not yet, and say what is left to be said."""
        if self._watch is not None:
            self._watch.settle()
        if self._life is not None:
            self._notices.last_problems(self.problems())

    def _fail(self, error: Exception) -> None:
        """A fault of the monitor, not of the robot: it concerns this robot only."""
        self.has_failed = True
        if self._life is not None:
            self._end(self._life)
        *_, last = traceback.extract_tb(error.__traceback__)
        where = f"{last.filename}:{last.lineno}"
        self._why_failed = f"not judged any more: {type(error).__name__}: {error} ({where})"
        self._say(f"error: {self._why_failed}; this is a fault of the monitor, please report it")

    # --- verdicts ----------------------------------------------------------------------------------

    def take(self, verdict: Verdict) -> None:
        """Note how one of its machines or properties stands."""
        self._outcomes[verdict.node] = verdict.outcome
        if verdict.outcome is Outcome.VIOLATED:
            self._violated.add(verdict.node)
            self._why_violated = f"{verdict.node}: {verdict.reason}"
        self._why.pop(verdict.node, None)
        if verdict.outcome is Outcome.INCONCLUSIVE:
            self._why[verdict.node] = f"{verdict.node}: {verdict.reason}"

    # --- what can be asked -------------------------------------------------------------------------

    @property
    def _watch(self) -> Run | None:
        return None if self._life is None else self._life.watch

    @property
    def is_judged(self) -> bool:
        """Whether there are judges of it."""
        return self._watch is not None

    @property
    def has_done_something(self) -> bool:
        """Whether there is anything to say of it: there are, or were, judges of it."""
        return self._judged > 0 or self.has_failed

    @property
    def violations(self) -> int:
        """How often something was violated."""
        watch = self._watch
        return self._earlier[0] + (0 if watch is None else watch.violations)

    @property
    def received(self) -> int:
        """Observations."""
        watch = self._watch
        return self._earlier[1] + (0 if watch is None else watch.counts.received)

    @property
    def verdict(self) -> str:
        """How it stands; see :class:`RobotStatus`."""
        if self.violations:
            return str(Outcome.VIOLATED)
        if self.has_failed or Outcome.INCONCLUSIVE in self._outcomes.values():
            return str(Outcome.INCONCLUSIVE)
        return str(Outcome.CONFORMING) if self._outcomes else UNSEEN

    def _last(self, verdict: str) -> str:
        """Why it stands so: the last violation, or what is inconclusive now."""
        if self.has_failed:
            return self._why_failed
        if verdict == Outcome.VIOLATED:
            return self._why_violated
        return next(reversed(self._why.values()), "") if verdict == Outcome.INCONCLUSIVE else ""

    def problems(self) -> tuple[str, ...]:
        """What of it could not be received or judged, one sentence each."""
        if self._life is None:
            return ()
        watch = self._life.watch
        return tuple(self._life.joining.problems() if watch is None else watch.problems())

    def look(self) -> None:
        """Say what of it cannot be received or judged, as far as that is new."""
        if self._life is not None:
            self._notices.problems(self.problems())

    def measure(self, now_ns: int) -> None:
        """Count how much was received since this was last called; ``now_ns`` is monotonic."""
        before_ns, before = self._measured
        received = self.received
        if before_ns:
            self._per_second = (received - before) * 1e9 / max(now_ns - before_ns, 1)
        self._measured = (now_ns, received)

    def status(self, unfolded: bool = False) -> RobotStatus:
        """How it stands; ``unfolded``: with the machines that are not fine."""
        fine = sum(
            outcome is Outcome.CONFORMING and name not in self._violated
            for name, outcome in self._outcomes.items()
        )
        verdict = self.verdict
        machines: tuple[MachineStatus, ...] = ()
        if unfolded:
            watch = self._watch
            machines = self._unwell if watch is None else _unwell(watch)
        return RobotStatus(
            self.name,
            verdict,
            self.is_present,
            fine,
            self._judged,
            self.violations,
            self.received,
            self._per_second,
            self._last(verdict),
            machines,
        )


def _unwell(watch: Run) -> tuple[MachineStatus, ...]:
    """The machines and properties that are violated or inconclusive."""
    return tuple(
        status
        for status in watch.statuses()
        if status.verdict in (Outcome.VIOLATED, Outcome.INCONCLUSIVE)
    )
