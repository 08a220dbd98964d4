"""Who shows that a machine took something: what a gap means, and what it means that nothing came.

A machine's inputs reach it in different ways, and middlewares report different ones. That something was *not*
taken, or that nothing was missed, may only be concluded from the numbers of who would have shown it:
``EVIDENCE`` says who that is, for every kind of input. All conclusions from what was not received ask it
(``evidence_of``):

* a gap in the numbers of others: ``oracle``;
* what has to come before a violation is certain: ``confirmation``;
* which messages are judged as of when the node says that it took them: ``delivery``.
"""

from __future__ import annotations

from enum import IntEnum

from m2c.model.machine import EventKind


class Shown(IntEnum):
    """By whose numbers it shows that an input is missing.

    A gap in these leaves the machine unknown. A violation is certain once nothing before it can be missing
    there.
    """

    BY_NODE = 0
    """By those of the machine's node, which reports what it takes. A gap in the sender's numbers alone means
    nothing: where the node took what is missing, its report comes, and the contents are waited for."""
    BY_SENDER = 1
    """By those of who sent it: nobody says whether the node took it."""
    BY_NOBODY = 2
    """It has no number, as of a stranger or in a bag: what was received is taken for whole."""
    INSIDE = 3
    """By nothing that can be received: it happens in the machine, and every time at which it may is tried."""


EVIDENCE: dict[EventKind, tuple[Shown, Shown]] = {
    # topics: plain events travel on them, and feedback
    EventKind.MESSAGE: (Shown.BY_NODE, Shown.BY_SENDER),
    EventKind.FEEDBACK: (Shown.BY_NODE, Shown.BY_SENDER),
    # what an end of a call does is reported by that end, on every middleware; that a call failed, by nodes
    # that say that they are there: of others it may be so at any time (``Successors.may_fail``)
    EventKind.REQUEST: (Shown.BY_NODE, Shown.BY_NODE),
    EventKind.RESPONSE: (Shown.BY_NODE, Shown.BY_NODE),
    EventKind.CALL_ERROR: (Shown.BY_NODE, Shown.BY_NODE),
    EventKind.GOAL: (Shown.BY_NODE, Shown.BY_NODE),
    EventKind.CANCEL: (Shown.BY_NODE, Shown.BY_NODE),
    EventKind.GOAL_ACCEPTED: (Shown.BY_NODE, Shown.BY_NODE),
    EventKind.GOAL_REJECTED: (Shown.BY_NODE, Shown.BY_NODE),
    EventKind.GOAL_FAILED: (Shown.BY_NODE, Shown.BY_NODE),
    EventKind.SUCCEEDED: (Shown.BY_NODE, Shown.BY_NODE),
    EventKind.ABORTED: (Shown.BY_NODE, Shown.BY_NODE),
    EventKind.CANCELED: (Shown.BY_NODE, Shown.BY_NODE),
    EventKind.TIMER: (Shown.INSIDE, Shown.INSIDE),
    EventKind.AFTER: (Shown.INSIDE, Shown.INSIDE),
    EventKind.INTERNAL: (Shown.INSIDE, Shown.INSIDE),
    EventKind.THREAD_START: (Shown.INSIDE, Shown.INSIDE),
    EventKind.THREAD_FREE: (Shown.INSIDE, Shown.INSIDE),
    EventKind.BT_TICK: (Shown.INSIDE, Shown.INSIDE),
    EventKind.BT_HALT: (Shown.INSIDE, Shown.INSIDE),
    EventKind.BT_CHILD_STATUS: (Shown.INSIDE, Shown.INSIDE),
    EventKind.BT_CHILD_HALTED: (Shown.INSIDE, Shown.INSIDE),
}
"""Every kind of input: who shows it where the machine's node reports which messages it takes, and where it
does not (on ROS 2, in recordings of before, nodes of others). Who subscribes to a transient local topic is
not judged at all (``moon.monitor.reading``)."""


def evidence_of(kind: EventKind, is_reported: bool, is_numbered: bool = True) -> Shown:
    """Who shows whether an input of ``kind`` was taken.

    Args:
        kind: of the input.
        is_reported: whether the machine's node reports which messages it takes.
        is_numbered: whether who sent it numbers what it sends.
    """
    reported, unreported = EVIDENCE[kind]
    if not is_numbered and unreported is Shown.BY_SENDER:
        return Shown.BY_NOBODY
    return reported if is_reported else unreported
