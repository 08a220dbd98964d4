"""Whether nodes could be reached: what was under way through a network that was cut is nobody's fault.

A monitor sees a network that is cut, too: of one side of it, nothing comes in time. So a node is charged
with not having what another sent to it only if both were heard in time afterwards. What is sent again after
a cut may take as long once more as that lasted (RFC 6298, 5.5: each wait is twice the one before).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

KEPT_TIMES = 256
"""Of each node."""
MOST_NODES = 1000
"""Nodes that are followed; their names come from the wire, and never end."""
_PARTS = 4
"""A node is noted so often in a latency bound at most."""


class Reachability:
    """When each node was heard in time.

    Args:
        latency_ns: what comes later than this after its stamp is late.
    """

    def __init__(self, latency_ns: int) -> None:
        self._latency_ns = latency_ns
        self._times: dict[str, deque[int]] = {}
        self._late_ns: dict[str, int] = {}
        """Until when a node that was heard late is not counted on."""
        self._too_late: dict[str, tuple[int, int]] = {}
        """By how much a node was heard too late to be judged, at most, and when it was last (ns)."""

    def heard(self, node: str, stamp_ns: int, lag_ns: int) -> None:
        """Something of ``node`` was received ``lag_ns`` after its stamp."""
        times = self._times.get(node)
        if times is None:
            if len(self._times) >= MOST_NODES:
                return
            times = self._times[node] = deque(maxlen=KEPT_TIMES)
        if lag_ns > self._latency_ns:
            self._late_ns[node] = stamp_ns + 2 * lag_ns
        elif times and stamp_ns < times[-1] + self._latency_ns // _PARTS:
            return
        elif stamp_ns > self._late_ns.get(node, 0):
            times.append(stamp_ns)

    def too_late(self, node: str, lag_ns: int, now_ns: int) -> None:
        """Something of ``node`` was received at ``now_ns``, and ``lag_ns`` after its stamp: too late."""
        most_ns, _ = self._too_late.get(node, (0, 0))
        if node in self._too_late or len(self._too_late) < MOST_NODES:
            self._too_late[node] = max(most_ns, lag_ns), now_ns

    def take_late(self, now_ns: int) -> dict[str, int]:
        """Nodes that were heard too late, and are not any more; by how much at most (ns). Told once."""
        limit_ns = now_ns - self._latency_ns
        over = {
            node: lag_ns for node, (lag_ns, at_ns) in self._too_late.items() if at_ns < limit_ns
        }
        for node in over:
            del self._too_late[node]
        return over

    def clear(self) -> None:
        """Nothing is known of any: times of before are not those of now."""
        self._times.clear()
        self._late_ns.clear()
        self._too_late.clear()

    def heard_ns(self, node: str) -> int:
        """When ``node`` was last known to be heard in time (ns); 0: never."""
        times = self._times.get(node)
        return times[-1] if times else 0

    def may_be_late(self, nodes: Iterable[str], since_ns: int) -> bool:
        """Whether what one of ``nodes`` sent at ``since_ns`` or later may be late: it was heard late."""
        late_ns = self._late_ns
        return any(late_ns.get(node, 0) >= since_ns for node in nodes)

    def reached_ns(self, nodes: Iterable[str], since_ns: int) -> int | None:
        """When all of ``nodes`` had been heard in time of what they did after ``since_ns``; None: not all."""
        found = [
            next((at for at in self._times.get(node, ()) if at >= since_ns), None) for node in nodes
        ]
        known = [at for at in found if at is not None]
        return max(known) if known and len(known) == len(found) else None
