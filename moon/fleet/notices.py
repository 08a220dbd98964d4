"""What is said of robots; of many at once in one line, as a monitor that stands still does so for all."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial

from m2c.suggestions import first_of

_NUMBER = re.compile(r"\d[\d,.]*")
"""In what differs from robot to robot though it is the same."""
_MOST_NAMED = 5


class RobotNotices:
    """Keeps sentences about robots until :meth:`flush`.

    Args:
        say: gets them, one sentence each.
    """

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._kept: dict[str, dict[str, str]] = {}
        """By what they have in common: the first of each robot."""

    def of(self, robot: str) -> Callable[[str], None]:
        """What takes sentences about ``robot``."""
        return partial(self._keep, robot)

    def _keep(self, robot: str, sentence: str) -> None:
        self._kept.setdefault(_NUMBER.sub("", sentence), {}).setdefault(robot, sentence)

    def flush(self) -> None:
        """Say what was kept."""
        kept, self._kept = self._kept, {}
        for of_robots in kept.values():
            names = sorted(of_robots)
            self._say(f"{first_of(names, _MOST_NAMED)}: {of_robots[names[0]]}")
