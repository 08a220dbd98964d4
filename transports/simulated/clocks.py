"""The time of day on the hosts of a simulated world, and what nodes stamp by it."""

from __future__ import annotations

from collections.abc import Callable

from transports.simulated.conditions import Conditions, Rules

NS = 10**9
_TOGETHER_NS = NS // 100
"""What one host does within so little time is stamped in its order, on every middleware."""
_MOST_AHEAD_NS = NS // 2
"""A stamp that is further ahead is not followed, as Zenoh's clock does not."""


class Clocks:
    """What each host's clock shows.

    A stamp under ``Rules.ZENOH`` is later than any that the host has given or received: a hybrid logical
    clock (Kulkarni et al. 2014). Under ``Rules.ROS2`` it goes back when the clock is set back.

    Args:
        conditions: which clocks are set, and whose rules stamps follow.
        began_ns: virtual time as the world begins.
        now_ns: virtual time.
    """

    def __init__(self, conditions: Conditions, began_ns: int, now_ns: Callable[[], int]) -> None:
        self._conditions = conditions
        self._now_ns = now_ns
        self._steps = {
            clock.host: [
                (began_ns, round(clock.ahead_s * NS)),
                *sorted((began_ns + round(at * NS), round(by * NS)) for at, by in clock.steps),
            ]
            for clock in conditions.clocks
        }
        self._last: dict[str, int] = {}
        self.differ = bool(self._steps)
        """Whether any clock is not the world's."""

    def ahead_ns(self, node: str) -> int:
        """By how much the clock of ``node``'s host is ahead of the world's, now."""
        steps = self._steps.get(self._conditions.host_of(node))
        if steps is None:
            return 0
        now_ns = self._now_ns()
        return sum(by for at, by in steps if at <= now_ns)

    def stamp(self, node: str) -> int:
        """The stamp of what ``node`` does now."""
        host = self._conditions.host_of(node)
        shown = self._now_ns() + self.ahead_ns(node)
        last = self._last.get(host, 0)
        if self._conditions.rules is Rules.ZENOH or shown > last - _TOGETHER_NS:
            shown = max(shown, last + 1)
        self._last[host] = shown
        return shown

    def see(self, node: str, stamp_ns: int) -> None:
        """``node`` receives something that was stamped elsewhere."""
        if self._conditions.rules is not Rules.ZENOH:
            return
        if stamp_ns <= self._now_ns() + self.ahead_ns(node) + _MOST_AHEAD_NS:
            host = self._conditions.host_of(node)
            self._last[host] = max(self._last.get(host, 0), stamp_ns)
