"""What a monitor observes of a policy, and which parts of it cannot be checked, and why."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec

from m2c.diagnostics import DiagnosticLog
from m2c.model.system import System
from m2c.policy.program import Policy, read_policy
from m2c.policy.ticks import TICKS_CHANNEL
from moon.explain.observables import Unchecked
from moon.policy.places import leaf_places
from moon.policy.shape import Shape, shape_of

_CALLS = "its calls of its leaves' services, and their answers"
_CALLS_AND_TICKS = f"{_CALLS}, and its ticks ({TICKS_CHANNEL}), without which it is inconclusive"
_NOTHING = "nothing: its verdict is always inconclusive"


class PolicyObservables(msgspec.Struct, frozen=True):
    """All that is observed of a policy.

    Attributes:
        policy: its name.
        file: where it is.
        judged_by: what decides whether it does what its tree does.
        unchecked: leaves of the tree of which no observation says whether they are right.
    """

    policy: str
    file: str
    judged_by: str
    unchecked: tuple[Unchecked, ...]


def policy_observables(system: System) -> PolicyObservables | None:
    """What a monitor observes of the policy of ``system``; None if it has none that can be read."""
    if system.policy is None:
        return None
    policy = read_policy(system.policy, system, DiagnosticLog())
    if policy is None:
        return None
    shape = shape_of(policy, system.plugins)
    unchecked = tuple(_unchecked(policy, shape, system))
    return PolicyObservables(policy.name, str(system.policy), _judged_by(shape), unchecked)


def _judged_by(shape: Shape) -> str:
    if shape.unchecked:
        return _NOTHING
    return _CALLS_AND_TICKS if shape.is_open and not shape.plain else _CALLS


def _unchecked(policy: Policy, shape: Shape, system: System) -> Iterator[Unchecked]:
    """Leaves that no call shows, each at its place."""
    places = leaf_places(system)
    for leaf in policy.leaves:
        if leaf.id == shape.unchecked_at:
            why = f"{shape.unchecked}: nothing of this policy is checked"
        elif leaf.timed:
            why = "when its time is over is not checked: either is right"
        elif leaf.plugin:
            why = "what its plugin answers and writes is not checked: anything is right"
        elif leaf.tick in shape.hidden:
            why = "a plugin of the policy calls this service, too: the two are not distinguished"
        else:
            continue
        for place in places.get(leaf.id, ("",)):
            yield Unchecked(leaf.name, why, place)
