"""By which name a node goes: ROS 2 names it by its namespace and its own name, models by the latter."""

from __future__ import annotations

from transports.bounded import BoundedDict
from transports.contested import Contested

_SEVERAL = ""


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
                self.contested.end(own)
        return node

    def called(self, node: str) -> str:
        """By which name ``node`` goes now."""
        if not node.startswith("/"):
            return node
        own = node[node.rindex("/") + 1 :]
        return own if self._who.get(own, node) == node else node
