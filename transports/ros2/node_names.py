"""By which name a node goes: ROS 2 names it by its namespace and its own name, models by the latter."""

from __future__ import annotations

import math
import time
from collections.abc import Set

from transports.bounded import BoundedDict

CONTESTED_S = 5.0
"""What a node has sent has come, or comes too late to be judged, so long after it went away."""
_SEVERAL = ""


class Contested:
    """Names that several nodes have, or had of late: from which of them something comes is not known."""

    def __init__(self) -> None:
        self._until_s: dict[str, float] = {}
        """By name; of those that several have at present, infinity. Replaced whole: other threads read it."""

    def note(self, names: Set[str]) -> None:
        """At present several nodes have each of ``names``, and no others."""
        if names or self._until_s:
            now_s = time.monotonic()
            past = {
                name: now_s + CONTESTED_S if until_s == math.inf else until_s
                for name, until_s in self._until_s.items()
                if until_s >= now_s
            }
            self._until_s = past | dict.fromkeys(names, math.inf)

    def note_past(self, name: str) -> None:
        """Until now several nodes had ``name``."""
        self._until_s = self._until_s | {name: time.monotonic() + CONTESTED_S}

    def names(self) -> set[str]:
        """Those that several nodes have at present."""
        return {name for name, until_s in self._until_s.items() if until_s == math.inf}

    def is_contested(self, name: str) -> bool:
        """Whether several nodes have it, or had of late."""
        until_s = self._until_s.get(name)
        return until_s is not None and until_s >= time.monotonic()


class NodeNames:
    """The names of the nodes that the graph shows.

    A node of the system's namespace goes by its own name. So does one of another namespace while it alone has
    that name; else it goes by its full name, which no model has.

    Args:
        prefix: the system's namespace as a prefix of channels, "" or ``/name``.
        most: so many names are remembered; the oldest are forgotten first.

    Attributes:
        contested: names that went to another node of late.
    """

    def __init__(self, prefix: str, most: int) -> None:
        self._namespace = prefix or "/"
        self._who: BoundedDict[str, str] = BoundedDict(most)
        """By their own name, the one node that has it, or ``_SEVERAL``."""
        self.contested = Contested()

    def learn(self, own: str, namespace: str = "") -> str:
        """There is a node of this name, by default in the system's namespace: returned is what ``called``
        takes.
        """
        namespace = namespace or self._namespace
        node = own if namespace == self._namespace else f"{namespace.rstrip('/')}/{own}"
        who = self._who.setdefault(own, node)
        if who not in (node, _SEVERAL):
            self._who[own] = _SEVERAL
            if who.startswith("/"):  # what came in this name came of it
                self.contested.note_past(own)
        return node

    def called(self, node: str) -> str:
        """By which name ``node`` goes now."""
        if not node.startswith("/"):
            return node
        own = node[node.rindex("/") + 1 :]
        return own if self._who.get(own, node) == node else node
