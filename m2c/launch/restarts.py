"""Which nodes that die are started again: ``m2c run --restart``."""

from __future__ import annotations

import collections

MOST_RESTARTS = 5
"""A node is started again so often within ``WITHIN_S``. One that dies once more dies of something that does
not go away."""
WITHIN_S = 60.0


class Restarts:
    """How often each node was started again of late."""

    def __init__(self) -> None:
        self._started_s: dict[str, collections.deque[float]] = {}
        """When each was started again last: the latest ``MOST_RESTARTS``, oldest first."""

    def start(self, name: str, now_s: float) -> bool:
        """``name`` has died: whether it is to be started again, which is counted.

        Args:
            name: the node.
            now_s: the time, on a clock that nobody sets.
        """
        started_s = self._started_s.setdefault(name, collections.deque(maxlen=MOST_RESTARTS))
        if len(started_s) == MOST_RESTARTS and now_s - started_s[0] <= WITHIN_S:
            return False
        started_s.append(now_s)
        return True
