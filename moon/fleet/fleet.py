"""The robots of a fleet, as they come and go."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterator, Sequence

import msgspec

from m2c.suggestions import first_of
from moon.fleet.choice import WHOLE, Shard
from moon.fleet.memory import give_back
from moon.fleet.notices import RobotNotices
from moon.fleet.report import standing
from moon.fleet.robot import Robot
from moon.fleet.status import FleetSummary, RobotStatus
from moon.monitor.subject import Monitored
from moon.sources.source import Outputs
from moon.verdict import Outcome, Verdict
from transports.interface import Namespaces

MOST_ROBOTS = 10_000
"""Robots that one monitor knows, those that are gone included: anybody may announce nodes anywhere."""
MOST_JUDGED = 2000
"""Robots that have judges at a time, and a thread each: those that do something. So many take some GB."""
_LOOKED_AT = 20
"""Robots whose problems are looked for at a time: that takes time with each session that there is."""
_MEASURE_NS = 2_000_000_000
"""Over how long observations a second are counted."""
_MOST_NAMED = 8
"""Robots that are new, or gone, by name."""


class Fleet:
    """Monitors each robot whose namespace matches a pattern.

    Args:
        connection: has no namespace.
        pattern: of namespaces; see :func:`moon.fleet.choice.fleet_pattern`.
        monitored: what is monitored of each robot.
        outputs: where what is found of each robot goes, each verdict with its robot.
        shard: the share of the fleet that is monitored.
        most: robots, those that are gone included.
        most_judged: robots that have judges at a time.

    Attributes:
        is_violated: whether something was violated.
    """

    def __init__(
        self,
        connection: Namespaces,
        pattern: str,
        monitored: Monitored,
        outputs: Outputs,
        shard: Shard = WHOLE,
        most: int = MOST_ROBOTS,
        most_judged: int = MOST_JUDGED,
    ) -> None:
        self.is_violated = False
        self._connection = connection
        self._pattern = pattern
        self._monitored = monitored
        self._outputs = msgspec.structs.replace(outputs, sinks=(self, *outputs.sinks))
        self._say = outputs.say
        self._notices = RobotNotices(outputs.say)
        self._shard = shard
        self._most = most
        self._most_judged = most_judged
        self._robots: dict[str, Robot] = {}
        self._forgotten = (0, 0, 0)
        """Robots that were forgotten, as there were too many; their violations and observations."""
        self._others = 0
        """Robots that are up and belong to other shares."""
        self._is_full = False
        self._judged = 0
        """Robots that had judges at the last look at that."""
        self._looks = 0
        self._next = 0
        self._measured_ns = 0
        self._said: frozenset[str] = frozenset()
        """The robots that were there at the last look."""
        self._has_said_none = False
        self._began_ns = time.monotonic_ns()

    def start(self) -> None:
        """Begin to look for robots."""
        self._connection.watch_namespaces(self._pattern, self._changed)

    # --- coming and going --------------------------------------------------------------------------

    def _changed(self, name: str, up: bool) -> None:
        if not self._shard.takes(name):
            self._others += 1 if up else -1
            return
        robot = self._robots.get(name)
        if not up:
            if robot is not None:
                robot.disappear()
                if not robot.has_done_something:
                    del self._robots[name]
            return
        if robot is None:
            if not self._has_room():
                return
            robot = self._robots[name] = Robot(
                name,
                self._monitored,
                self._connection.within,
                msgspec.structs.replace(self._outputs, say=self._notices.of(name)),
                self._may_judge,
            )
        robot.appear()

    def _has_room(self) -> bool:
        """Whether one more robot can be judged; one that is gone is forgotten for it."""
        if len(self._robots) < self._most:
            return True
        gone = [robot for robot in self._robots.values() if not robot.is_present]
        if not gone:
            self._say_full(self._most)
            return False
        oldest = min(gone, key=lambda robot: robot.gone_ns)
        oldest.release()
        del self._robots[oldest.name]
        count, violations, received = self._forgotten
        self._forgotten = (
            count + 1,
            violations + oldest.violations,
            received + oldest.received,
        )
        return True

    def _may_judge(self) -> bool:
        """Whether one more robot can have judges; one that is gone is freed of them for it."""
        judged = [robot for robot in self._robots.values() if robot.is_judged]
        if len(judged) < self._most_judged:
            return True
        gone = [robot for robot in judged if not robot.is_present]
        if gone:
            min(gone, key=lambda robot: robot.gone_ns).release()
            return True
        self._say_full(self._most_judged)
        return False

    def _say_full(self, most: int) -> None:
        if not self._is_full:
            self._say(
                f"warning: more than {most:,} robots: the others are not monitored; "
                "--shard spreads a fleet over several monitors"
            )
        self._is_full = True

    def take(self, verdict: Verdict) -> None:
        """Note whether something was violated."""
        self.is_violated = self.is_violated or verdict.outcome is Outcome.VIOLATED

    # --- now and then ------------------------------------------------------------------------------

    def look_around(self) -> None:
        """Say which robots came and went, and what of some of them cannot be received."""
        self._looks += 1
        self._say_who_is_there()
        robots = list(self._robots.values())
        if robots:
            begin = self._next % len(robots)
            for robot in robots[begin : begin + _LOOKED_AT]:
                robot.look()
            self._next = begin + _LOOKED_AT if begin + _LOOKED_AT < len(robots) else 0
        self._notices.flush()
        now_ns = time.monotonic_ns()
        if now_ns - self._measured_ns >= _MEASURE_NS:
            self._measured_ns = now_ns
            for robot in robots:
                robot.measure(now_ns)
            judged = sum(robot.is_judged for robot in robots)
            if judged < self._judged:
                give_back()
            self._judged = judged

    def _say_who_is_there(self) -> None:
        present = frozenset(robot.name for robot in self._robots.values() if robot.is_present)
        if present == self._said:
            if not self._robots and self._looks >= 2 and not self._has_said_none:
                self._has_said_none = True
                self._say(self._none())
            return
        changes = [
            f"{sign} {first_of(sorted(names), _MOST_NAMED)}"
            for sign, names in (("+", present - self._said), ("-", self._said - present))
            if names
        ]
        self._say(f"{_robots(len(present))}: {'; '.join(changes)}")
        self._said = present

    def _none(self) -> str:
        if self._others:
            are = "is" if self._others == 1 else "are"
            return (
                f"{_robots(self._others)} {are} there, none of shard {self._shard}: waiting for one"
            )
        return (
            f"no robot in {self._pattern} yet: waiting for one; "
            "is this the endpoint where the robots' nodes meet?"
        )

    # --- what can be asked -------------------------------------------------------------------------

    @property
    def violations(self) -> int:
        """Of all robots."""
        found = sum(robot.violations for robot in self._robots.values())
        return self._forgotten[1] + found

    @property
    def failures(self) -> int:
        """Robots that are not judged any more because of an error of the monitor."""
        return sum(robot.has_failed for robot in self._robots.values())

    def robots(self) -> list[Robot]:
        """Those that are known, the gravest first, then by name."""
        return sorted(self._robots.values(), key=lambda robot: (_gravity(robot), robot.name))

    def ending(self, now_ns: int) -> None:
        """Who runs the robots begins to end their nodes (ns)."""
        for robot in self._robots.values():
            robot.ending(now_ns)

    def finish(self) -> None:
        """The monitor is to end."""
        for robot in self._robots.values():
            robot.finish()
        self._notices.flush()

    def summary(self) -> FleetSummary:
        """How it stands at the end."""
        robots = self.robots()
        counts = Counter(standing(robot.status()) for robot in robots)
        forgotten, _, received = self._forgotten
        if forgotten:
            counts["forgotten"] = forgotten
        problems = {robot.name: found for robot in robots if (found := robot.problems())}
        return FleetSummary(
            (time.monotonic_ns() - self._began_ns) / 1e9,
            dict(counts),
            self.violations,
            received + sum(robot.received for robot in robots),
            tuple(self._troubled(robots)),
            problems,
            self._monitored.unmonitored,
        )

    @staticmethod
    def _troubled(robots: Sequence[Robot]) -> Iterator[RobotStatus]:
        for robot in robots:
            if robot.verdict != Outcome.CONFORMING:
                yield robot.status(unfolded=True)


_GRAVITY = (str(Outcome.VIOLATED), str(Outcome.INCONCLUSIVE))


def _gravity(robot: Robot) -> int:
    verdict = robot.verdict
    return _GRAVITY.index(verdict) if verdict in _GRAVITY else len(_GRAVITY)


def _robots(count: int) -> str:
    return f"{count:,} robot{'s' * (count != 1)}"
