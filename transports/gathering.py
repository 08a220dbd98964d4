"""What taps receive is taken together where it comes without a pause.

Each node at work reports something hundreds of times a second. Taking one thing wakes threads and a process,
which costs ten times as much as taking one more that lies there already.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

GATHER_S = 0.004
"""What comes often is left to lie for so long: a third of what nodes wait before they report it
(``transports.outbox``)."""
OFTEN, OFTEN_S = 20, 0.1
"""So often within this time is often. At ten ticks a second a system is not there; one that is stays there
while it is gathered."""


class Gathering:
    """Tells how long what has just come should be left to lie.

    Args:
        clock: monotonic, in seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._taken_s: deque[float] = deque(maxlen=OFTEN)

    def wait_s(self) -> float:
        """How long to wait before something is taken; ask once each time."""
        now_s, taken_s = self._clock(), self._taken_s
        is_often = len(taken_s) == OFTEN and now_s - taken_s[0] < OFTEN_S
        taken_s.append(now_s)
        return GATHER_S if is_often else 0.0
