"""What a generated ``machine.py`` imports: names of its faults and of event matching."""

from __future__ import annotations

from m2c.language.conversion import ExecutionError
from m2c.language.durations import seconds
from m2c.language.macrostep import ERROR_EXECUTION, MAX_STEPS, matches


class EndlessLoopError(Exception):
    """Eventless transitions and internal events follow each other without end.

    Args:
        state: the active state.
        taken: whether a transition took the event that began it.
    """

    def __init__(self, state: str, taken: bool = True) -> None:
        super().__init__(
            f"an endless loop: more than {MAX_STEPS} eventless transitions and internal events follow each "
            f"other, last in state `{state}`; the machine was left there"
        )
        self.state = state
        self.taken = taken


__all__ = [
    "ERROR_EXECUTION",
    "MAX_STEPS",
    "EndlessLoopError",
    "ExecutionError",
    "matches",
    "seconds",
]
