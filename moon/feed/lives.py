"""Which life of a node an observation is of: a node that is started again under its name does all anew.

What a life reported last may be received after the first of the next (they come on different links). It is
told apart where the transport says of which life each observation is (``Observation.life``).
"""

from __future__ import annotations

KEPT_LIVES = 4
"""So many earlier lives are remembered."""

PRESENT, ANOTHER, PAST = range(3)
"""Of an observation: its life goes on; begins with it; is over."""


class Lives:
    """The lives of one node.

    Attributes:
        present: the one that goes on (``Observation.life``); 0 where that is not known, or none was received.
    """

    __slots__ = ("_began_ns", "_past", "_since_ns", "present")

    def __init__(self) -> None:
        self.present = 0
        self._since_ns = 0
        """When the first happened that was received of it (ns)."""
        self._past: list[int] = []
        self._began_ns = 0
        """When the node started last, as far as that is known (ns, on its clock)."""

    def see(self, life: int, stamp_ns: int) -> int:
        """Something of ``life`` is received, which happened at ``stamp_ns``: what it is of."""
        if not life or life == self.present:
            return PRESENT
        if self.is_over(life, stamp_ns):
            return PAST
        before = self.present
        self._end()
        self.present, self._since_ns = life, stamp_ns
        return ANOTHER if before else PRESENT

    def start(self, since_ns: int) -> None:
        """The node is known to have started at ``since_ns`` or later (ns, on its clock)."""
        if self._since_ns < since_ns:
            self._end()
        self._began_ns = since_ns

    def is_over(self, life: int, stamp_ns: int) -> bool:
        """Whether what happened in ``life`` at ``stamp_ns`` (ns, on its clock) is of an earlier one.

        The first that is received of a life may be received when it is over.
        """
        if life and life == self.present:
            return False
        return life in self._past or stamp_ns < self._began_ns

    def _end(self) -> None:
        if self.present:
            self._past.append(self.present)
            del self._past[:-KEPT_LIVES]
        self.present = 0
