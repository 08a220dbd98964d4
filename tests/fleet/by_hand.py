"""A connection to many robots whose clock, nodes and observations a test moves by hand."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable
from pathlib import Path

import msgspec

from m2c.diagnostics import DiagnosticLog
from m2c.model import load
from moon.fleet.choice import WHOLE, Shard
from moon.fleet.fleet import Fleet
from moon.monitor.subject import monitored_of
from moon.oracle.bounds import Bounds
from moon.sources.source import Outputs
from moon.verdict import Verdict
from tests.monitor.hand_driven import MS, START, HandDriven, S, write_models


class _Timer:
    def __init__(self, due_ns: int, handler: Callable[[], None]) -> None:
        self.due_ns = due_ns
        self.handler = handler
        self.is_cancelled = False

    def cancel(self) -> None:
        self.is_cancelled = True


class RobotByHand(HandDriven):
    """One robot, and the listener to it."""

    is_complete = True

    def __init__(self, fleet: FleetByHand, name: str) -> None:
        self.fleet = fleet
        self.name = name
        self.now = fleet.now
        self.since = {}
        self.set_forward_ns = 0
        self.level = 100
        self._later = iter(range(1000, 2000))
        self.heard_by_tap = []
        self.dropped = []
        self.asked = {}
        self._numbers = {}
        self.held_up = deque()
        self.published: list[tuple[str, object]] = []
        self.opened = 0
        """How often somebody began to listen."""
        self.is_open = False
        self._timers: list[_Timer] = []
        self._node_handler = lambda name, up: None
        self._handler = lambda seen: None

    def listen(self, failed: Callable[[Exception], None]) -> RobotByHand:
        self.opened += 1
        self.is_open = True
        self.fail = failed
        return self

    def after(self, delay_s: float, handler: Callable[[], None]) -> _Timer:
        self._timers.append(_Timer(self.now + round(delay_s * S), handler))
        return self._timers[-1]

    def publisher(self, topic):
        def publish(message) -> None:
            self.published.append((topic.name, message))

        class Publisher:
            pass

        Publisher.publish = staticmethod(publish)
        return Publisher()

    def peers(self):
        return ()

    def close(self) -> None:
        self.is_open = False
        self._timers.clear()

    def now_ns(self) -> int:
        """Robots act one after the other, each on a time of its own."""
        return self.now

    def steady_ns(self) -> int:
        return self.now

    def pass_time(self, milliseconds: int) -> None:
        until = self.now + milliseconds * MS
        while due := [t for t in self._timers if not t.is_cancelled and t.due_ns <= until]:
            timer = min(due, key=lambda timer: timer.due_ns)
            self._timers = [t for t in self._timers if t is not timer and not t.is_cancelled]
            self.now = max(self.now, timer.due_ns)
            timer.handler()
        self.now = until

    def start(self) -> None:
        """Its nodes come up; the policy numbers its calls from 1."""
        self._later = itertools.count(1)
        self.fleet.changed(self.name, True)
        for name in ("Level", "policy", "Battery"):
            self.node(name, True)

    def end(self) -> None:
        """Its nodes go away."""
        for name in ("Level", "policy", "Battery"):
            self.node(name, False)
        self.fleet.changed(self.name, False)

    def run(self, status: int = 0) -> None:
        """A tick that is answered by ``status`` (0 is right), and time to judge it."""
        self.message(100)
        self.tick(next(self._later), status)
        self.confirm()


class FleetByHand:
    """The connection, and a fleet on it."""

    def __init__(
        self, folder: Path, shard: Shard = WHOLE, most: int = 2000, judges: tuple = ()
    ) -> None:
        self.now = START
        self.said: list[str] = []
        self.verdicts: list[Verdict] = []
        self.shown: list[Verdict] = []
        self.by_name: dict[str, RobotByHand] = {}
        log = DiagnosticLog()
        system = load([write_models(folder)], log)
        assert system is not None
        monitored = msgspec.structs.replace(monitored_of(system, (), Bounds()), judges=judges)
        self.fleet = Fleet(
            self,
            "robots/*",
            monitored,
            Outputs([self], self.said.append, [Into(self.shown)]),
            shard,
            most,
        )
        self.fleet.start()

    def watch_namespaces(self, pattern: str, handler: Callable[[str, bool], None]) -> None:
        self.pattern = pattern
        self.changed = handler

    def within(self, namespace: str, failed: Callable[[Exception], None]) -> RobotByHand:
        return self.robot(namespace).listen(failed)

    def take(self, verdict: Verdict) -> None:
        self.verdicts.append(verdict)

    def robot(self, name: str) -> RobotByHand:
        if name not in self.by_name:
            self.by_name[name] = RobotByHand(self, name)
        return self.by_name[name]

    def status(self, name: str):
        (found,) = (r.status(unfolded=True) for r in self.fleet.robots() if r.name == name)
        return found


class Into:
    """A sink."""

    def __init__(self, verdicts: list[Verdict]) -> None:
        self._verdicts = verdicts

    def take(self, verdict: Verdict) -> None:
        self._verdicts.append(verdict)
