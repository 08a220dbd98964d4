"""The rules of a macrostep that are the same for every machine: event names, failures, endless loops.

Generated code, the model oracle and the checks take them from here. What cannot be executed (W3C SCXML
3.12.2, 4.9, 5.9.1) puts ``error.execution`` into the queue of internal events, and

==================================  ====================================================================
what fails                          what follows
==================================  ====================================================================
the condition of a transition       it does not hold; the next transition of the state is tested
the condition of an ``<if>``        it does not hold; the next branch is tested, and the block goes on
a statement, at any depth of        the rest of its block is left out; a block is the content of an
``<if>``                            ``<onentry>``, an ``<onexit>``, a transition, or a ``<target>``
==================================  ====================================================================

A macrostep ends when no eventless transition is enabled and the queue of internal events is empty, whether
or not the event that began it was taken: ``error.execution`` is processed before the next external event.
More than ``MAX_STEPS`` eventless transitions and internal events in one macrostep are an endless loop: the
macrostep ends there, and the internal events that are left are dropped.
"""

from __future__ import annotations

ERROR_EXECUTION = "error.execution"
"""The internal event of what could not be executed."""

MAX_STEPS = 1000
"""Eventless transitions taken, and internal events taken or not, in one macrostep."""


def prefix_of(descriptor: str) -> str:
    """The tokens of an event descriptor, without ``*``: what ``matches`` compares; "" for any event."""
    return descriptor.removesuffix("*").removesuffix(".")


def matches(name: str, prefix: str) -> bool:
    """Whether event ``name`` is ``prefix`` or begins with its tokens (W3C SCXML 3.12.1)."""
    return name == prefix or name.startswith(f"{prefix}.") or not prefix
