"""The end of a round of calls, published to all nodes: a moment at which nobody waits for them.

A node cannot know how long the tick goes on in which it was called. Whoever ticks does, and says once, when
it is over, what would be too dear to say with each call; see ``transports.outbox``.
"""

# zenoh's stubs leave the results of some methods open
# mypy: disable-error-code="no-untyped-call"

from __future__ import annotations

from typing import Any

import zenoh

from transports.outbox import Outbox
from transports.zenoh.introspection import Recorded
from transports.zenoh.names import ROUND_KEY
from transports.zenoh_link.executor import Executor

LAST_S = 0.002
"""Whoever says that a round is over reports this much later: it has most to report; the others come first."""


class Rounds:
    """Says that a round is over, and receives it from others.

    Args:
        session: the node's.
        executor: the node's.
        outbox: what the node has yet to publish.
    """

    def __init__(
        self, session: zenoh.Session, executor: Executor, outbox: Outbox[Recorded]
    ) -> None:
        self._executor = executor
        self._outbox = outbox
        self._publisher = session.declare_publisher(
            ROUND_KEY, congestion_control=zenoh.CongestionControl.DROP, express=True
        )
        received: Any = zenoh.handlers.Callback(self._received, indirect=False)
        self._subscriber = session.declare_subscriber(
            ROUND_KEY, received, allowed_origin=zenoh.Locality.REMOTE
        )

    def say(self) -> None:
        """A round of this node is over; from any thread. Nothing is published if nobody taps its calls."""
        if self._outbox.note_round():
            try:
                self._publisher.put(b"")
            except zenoh.ZError:  # closed meanwhile by another thread, which flushed the outbox
                return
            self._executor.after(LAST_S, self._outbox.tick_complete)

    def _received(self, _: zenoh.Sample) -> None:
        """On a thread of Zenoh's: what is kept leaves from here, without waking the executor."""
        if self._outbox.note_round():
            self._outbox.tick_complete()

    def undeclare(self) -> None:
        """Publish and receive nothing any more."""
        self._subscriber.undeclare()
        self._publisher.undeclare()
