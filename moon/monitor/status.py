"""What a monitor shows of each machine, and of itself."""

from __future__ import annotations

import msgspec

from moon.feed.counts import Counts

AWAY = "(gone)"
"""In place of the states of a machine whose node went away."""
UNSEEN = "unseen"
"""The verdict on a machine of which nothing was received yet."""
POLICY = "policy"
"""The node that ticks a system's tree, whether it is monitored or not."""
PROPERTY = "property"
"""The kind of a status that is a property's, not a machine's."""


class MachineStatus(msgspec.Struct, frozen=True):
    """One monitored machine.

    Attributes:
        machine: the model's name, or the property's id.
        verdict: ``conforming``, ``violated``, ``inconclusive``, or ``unseen``.
        states: the states in which it may be; empty if that is not known.
        inputs: what was seen of its inputs.
        outputs: what was seen of its outputs.
        violations: how often it did what its model does not.
        late: observations that came too late to be judged.
        lag_ms: from its own events to the monitor, median of the last ones; None before the first.
        last: the last explanation, or why there is no verdict.
        kind: ``model`` or ``property``.
    """

    machine: str
    verdict: str
    states: tuple[str, ...]
    inputs: int
    outputs: int
    violations: int
    late: int
    lag_ms: float | None
    last: str
    kind: str = "model"

    @property
    def has_ended(self) -> bool:
        """Whether its node went away: the verdict is on what it did until then."""
        return self.states == (AWAY,)


class Summary(msgspec.Struct, frozen=True):
    """The end of a monitor's run.

    Attributes:
        seconds: how long it listened.
        machines: each machine as it stands, then each property.
        counts: what was received.
        problems: what could not be received or decoded, one sentence each.
        unmonitored: what is not monitored, and why, one sentence each.
    """

    seconds: float
    machines: tuple[MachineStatus, ...]
    counts: Counts
    problems: tuple[str, ...]
    unmonitored: tuple[str, ...] = ()

    @property
    def violations(self) -> int:
        """Of all machines."""
        return sum(machine.violations for machine in self.machines)
