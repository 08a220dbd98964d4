"""The interface of :mod:`moon`: monitoring a system that runs, and checking one that was recorded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

import m2c
from m2c.model.system import System
from moon.judge import Judge
from moon.monitor.reading import no_system
from moon.monitor.status import MachineStatus
from moon.monitor.subject import Monitored, Subject, monitored_of
from moon.offline import engine
from moon.offline.result import CheckResult
from moon.oracle.bounds import Bounds
from moon.properties.monitor import PropertySet
from moon.run import Run
from moon.sources.live import Joining
from moon.sources.source import Outputs
from moon.verdict import Verdict
from transports.interface import Closes, Listener, Observation


class Monitor(Closes):
    """Watches a running system, live or simulated, without touching it.

    It listens from :meth:`start` on. It takes no part in the system: no node waits for it.

    Args:
        transport: a connection of its own (:func:`transports.connect`,
            :meth:`transports.SimulatedWorld.connect`); its executor runs the monitor.
        system: the models; None: only properties are monitored.
        properties: what else is monitored; of the set only the properties count, not its state.
        judges: what makes further judges, such as classes that inherit from :class:`Judge`.
        on_verdict: gets every verdict that is new, on the executor.
        on_notice: called with what a person should know, one sentence each.
        deadline_s: seconds in which a node must send what it owes.
        latency_s: seconds in which a message is taken, and an event received here.

    Attributes:
        unmonitored: what of the system is not monitored, and why, one sentence each.

    Raises:
        ModelError: :func:`m2c.check` finds errors in ``system``.
        NothingLeftError: no model of ``system`` can be monitored; the text says why.
        ValueError: there is nothing to monitor.
    """

    def __init__(
        self,
        transport: Listener,
        system: System | None = None,
        properties: PropertySet | None = None,
        *,
        judges: Sequence[Callable[[], Judge[Observation]]] = (),
        on_verdict: Callable[[Verdict], None] = lambda verdict: None,
        on_notice: Callable[[str], None] = lambda sentence: None,
        deadline_s: float = 1.0,
        latency_s: float = 0.2,
    ) -> None:
        monitored = _monitored(system, properties, judges, deadline_s, latency_s)
        self.unmonitored = monitored.unmonitored
        self._say = on_notice
        self._joining = Joining(transport)
        outputs = Outputs([_Sink(on_verdict)], on_notice)
        self._run = Run(self._joining, monitored, outputs)

    def start(self) -> None:
        """Begin as soon as everything is received; on the executor, or before it spins.

        Nodes that start afterwards are known from their first act. One that runs already is monitored
        from the first moment at which its state is certain.
        """
        self._joining.when_complete(self._run.start, self._say)

    def close(self) -> None:
        """Listen no more: its verdicts stand; idempotent. What it listens over stays open."""
        self._run.close()
        self._joining.close()

    @property
    def violations(self) -> int:
        """How often a model or a property was violated."""
        return self._run.violations

    def statuses(self) -> list[MachineStatus]:
        """How each machine stands, then each property.

        A status has the name (``machine``), the ``verdict`` (``conforming``, ``violated``,
        ``inconclusive``, or ``unseen``), the ``states`` in which the machine may be, and the number of
        its ``violations``.
        """
        return self._run.statuses()

    def problems(self) -> list[str]:
        """What could not be received or judged, one sentence each."""
        return self._run.problems()


class _Sink:
    """A function that takes verdicts."""

    def __init__(self, on_verdict: Callable[[Verdict], None]) -> None:
        self.take = on_verdict


def check_recording(
    path: Path | str,
    system: System | None = None,
    properties: PropertySet | None = None,
    *,
    judges: Sequence[Callable[[], Judge[Observation]]] = (),
    deadline_s: float = 1.0,
    latency_s: float = 0.2,
) -> CheckResult:
    """Check a recorded run, as a :class:`Monitor` that was there would have.

    Args:
        path: what ``moon record`` or ``ros2 bag record`` wrote, or a log of JSON lines.
        system: the models; None: only properties are checked.
        properties: what else is checked; of the set only the properties count, not its state.
        judges: what makes further judges, such as classes that inherit from :class:`Judge`.
        deadline_s: seconds in which a node must send what it owes.
        latency_s: seconds in which a message is taken, and an event received by the recorder.

    Returns:
        The result: ``violations`` counts them, ``violated`` has them with the time of each,
        ``machines`` has how each machine and property stands at the end, ``recording`` what the file
        is, and what cannot be concluded from it.

    Raises:
        RecordingError: there is no recording at ``path``, or nothing of it can be read.
        EmptyRecordingError: it holds nothing that could be checked.
        ModelError: :func:`m2c.check` finds errors in ``system``.
        NothingLeftError: no model of ``system`` can be monitored; the text says why.
        ValueError: there is nothing to check.
    """
    monitored = _monitored(system, properties, judges, deadline_s, latency_s)
    files = {item.position.file: None for item in monitored.properties}
    subject = Subject(
        () if system is None else (system.path,),
        tuple(map(Path, files)),
        (),
        (),
        (),
        monitored.bounds,
    )
    return engine.check_recording(Path(path), subject, monitored)


def _monitored(
    system: System | None,
    properties: PropertySet | None,
    judges: Sequence[Callable[[], Judge[Observation]]],
    deadline_s: float,
    latency_s: float,
) -> Monitored:
    if system is None and properties is None and not judges:
        raise ValueError("nothing to monitor: give a system, properties, or judges")
    for what, seconds in (("deadline_s", deadline_s), ("latency_s", latency_s)):
        if not 0 < seconds < float("inf"):
            raise ValueError(f"{what} is a number of seconds above 0, not {seconds!r}")
    bounds = Bounds(latency=round(latency_s * 1e9), deadline=round(deadline_s * 1e9))
    chosen = () if properties is None else properties.properties
    if system is None:
        return Monitored(no_system(), (), chosen, bounds, (), judges=tuple(judges))
    errors = [found for found in m2c.check(system) if found.severity == "error"]
    if errors:
        raise m2c.ModelError(errors)
    return msgspec.structs.replace(monitored_of(system, chosen, bounds), judges=tuple(judges))
