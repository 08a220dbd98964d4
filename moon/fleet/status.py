"""What a monitor of a fleet shows of each robot, and of all."""

from __future__ import annotations

import msgspec

from moon.monitor.status import MachineStatus


class RobotStatus(msgspec.Struct, frozen=True):
    """One robot.

    Attributes:
        robot: its namespace.
        verdict: ``violated`` if something was violated, else ``inconclusive`` if something is, else
            ``conforming``; ``unseen`` before the first verdict.
        present: whether a node of it is up.
        fine: how many of its machines, properties included, conform and never did anything else.
        judged: how many are judged.
        violations: how often something was violated.
        received: observations.
        per_second: observations a second, of late.
        last: what was wrong last, and where; "" if all is well.
        machines: those that are not fine, where they were asked for.
    """

    robot: str
    verdict: str
    present: bool
    fine: int
    judged: int
    violations: int
    received: int
    per_second: float
    last: str
    machines: tuple[MachineStatus, ...] = ()


class FleetSummary(msgspec.Struct, frozen=True):
    """The end of a monitor's run.

    Attributes:
        seconds: how long it listened.
        robots: how many there were, by how they stand.
        violations: of all robots.
        received: observations.
        troubled: the robots that are not conforming.
        problems: what could not be received or judged, one sentence each, by robot.
        unmonitored: what of each robot is not monitored, and why, one sentence each.
    """

    seconds: float
    robots: dict[str, int]
    violations: int
    received: int
    troubled: tuple[RobotStatus, ...]
    problems: dict[str, tuple[str, ...]]
    unmonitored: tuple[str, ...] = ()
