"""The calls of a policy: what identifies one, and what its answer says."""

from __future__ import annotations

from collections.abc import Mapping

from m2c.policy.ticking import STATUS_CODES
from moon.policy.follow import Run
from transports.interface import Observation

Call = tuple[str, str, int]
"""Service, who calls, number."""


def call_of(observation: Observation) -> Call:
    """Which call ``observation`` is of."""
    return (observation.channel, observation.client, observation.call)


def status_of(answer: Observation) -> str | None:
    """What the policy takes ``answer`` for; None if it cannot be read."""
    if answer.error:
        return "FAILURE"
    if not isinstance(answer.data, Mapping) or not isinstance(answer.data.get("status"), int):
        return None
    return STATUS_CODES.get(answer.data["status"], "FAILURE")


def doing_of(run: Run, pending: Observation | None) -> str:
    """What the policy is doing in ``run``, for people; ``pending``: the call that is not answered."""
    ask = run.ask
    if pending is not None and ask.leaf is not None and ask.channel:
        return f"{ask.kind.value} {ask.leaf.name}"
    names = sorted(leaf.name for leaf in run.running.values())
    return f"{', '.join(names)} RUNNING" if names else "nothing RUNNING"
