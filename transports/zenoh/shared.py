"""What the nodes of one process share on Zenoh: the session, what it announces, and one outbox.

The node that opened the session owns it; those that came beside it end with it at the latest. All that the
nodes keep for taps leaves in one burst, on the executor of the owner.
"""

from __future__ import annotations

import threading

import zenoh

from transports.interface import TransportError
from transports.outbox import Outbox
from transports.refusals import Refusals
from transports.zenoh.introspection import Recorded, publish
from transports.zenoh.presence import Announcements
from transports.zenoh.rounds import Rounds
from transports.zenoh_link.executor import Executor


class Shared:
    """What the nodes on one session have in common.

    Args:
        session: theirs.
        executor: the one of the session's owner.
        refusals: where announcements that are none are counted.

    Attributes:
        announcements: of the nodes that are ready.
        outbox: what the nodes have yet to publish.
    """

    def __init__(self, session: zenoh.Session, executor: Executor, refusals: Refusals) -> None:
        self._session = session
        self._executor = executor
        self.announcements = Announcements(session, executor, refusals)
        self.outbox: Outbox[Recorded] = Outbox(executor, publish)
        self._rounds: Rounds | None = None
        self._lock = threading.Lock()
        self._nodes: set[str] = set()

    def enter(self, node: str) -> None:
        """``node`` is on the session from now on; TransportError if another has its name."""
        with self._lock:
            if node in self._nodes:
                raise TransportError(f"two nodes of this process are named {node}")
            self._nodes.add(node)

    def leave(self, node: str) -> None:
        """``node`` has released what it had on the session."""
        with self._lock:
            self._nodes.discard(node)

    def listen_for_rounds(self) -> None:
        """There is something to report at the end of a round."""
        with self._lock:
            if self._rounds is None:
                self._rounds = Rounds(self._session, self._executor, self.outbox)

    def tick_complete(self) -> None:
        """See ``transports.interface.Transport``."""
        if self._rounds is not None:
            self._rounds.say()

    def close(self) -> None:
        """Announce, and report, nothing any more; the session is about to close."""
        self.announcements.undeclare()
        self.outbox.close()
        if self._rounds is not None:
            self._rounds.undeclare()
