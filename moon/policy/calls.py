"""The calls of a policy: what identifies one, and what its answer says."""

from __future__ import annotations

from bisect import bisect_left, insort
from collections.abc import Mapping

from m2c.policy.ticking import STATUS_CODES
from moon.policy.follow import Run
from transports.interface import Observation

Call = tuple[str, str, int]
"""Service, who calls, number."""


class SeenByServer:
    """Calls of which only the server's end was received so far, and when.

    What is too old is found without looking at the others: at saturation there are hundreds, of which each
    call that is judged asks.

    Args:
        most: so many are kept, the last that were noted.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._stamps: dict[Call, int] = {}
        self._by_age: list[tuple[int, Call]] = []

    def note(self, call: Call, stamp_ns: int) -> None:
        """The server received ``call`` at ``stamp_ns``, or before if it was noted of before."""
        known_ns = self._stamps.get(call)
        if known_ns is not None:
            if known_ns <= stamp_ns:
                return
            self._forget_age(call, known_ns)
        self._stamps[call] = stamp_ns
        insort(self._by_age, (stamp_ns, call))
        if len(self._stamps) > self._most:
            self.forget(next(iter(self._stamps)))

    def forget(self, call: Call) -> None:
        """The policy's end of ``call`` was received as well."""
        stamp_ns = self._stamps.pop(call, None)
        if stamp_ns is not None:
            self._forget_age(call, stamp_ns)

    def forget_until(self, until_ns: int) -> int:
        """Forget those that servers received up to ``until_ns``; how many there were."""
        by_age, count = self._by_age, 0
        while count < len(by_age) and by_age[count][0] <= until_ns:
            del self._stamps[by_age[count][1]]
            count += 1
        if count:
            del by_age[:count]
        return count

    def clear(self) -> None:
        """Forget all."""
        self._stamps.clear()
        self._by_age.clear()

    def _forget_age(self, call: Call, stamp_ns: int) -> None:
        del self._by_age[bisect_left(self._by_age, (stamp_ns, call))]


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
