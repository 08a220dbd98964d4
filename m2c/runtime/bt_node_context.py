"""What a behaviour-tree plugin says to the tree that it is a node of."""

from __future__ import annotations

from typing import Protocol


class BtNodeContext(Protocol):
    """The tree, seen from one of its nodes; every method is called on the transport's executor."""

    def return_status(self, status: str) -> None:
        """Answer the tick: SUCCESS, FAILURE or RUNNING (``<bt_return_status>``)."""
        ...

    def return_halted(self) -> None:
        """Answer the halt (``<bt_return_halted>``)."""
        ...

    def set_output(self, key: str, value: object) -> None:
        """Write the output port ``key`` (``<bt_set_output>``)."""
        ...

    def tick_child(self, child: int) -> None:
        """Tick child number ``child``, from 0; its status comes back as ``child_status``."""
        ...

    def halt_child(self, child: int) -> None:
        """Halt child number ``child``; ``child_halted`` comes back."""
        ...
