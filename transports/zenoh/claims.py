"""Whether who a message says it is from is who sent it, as far as Zenoh shows.

An attachment names a node, and anybody can write any name into it. Zenoh stamps what a session publishes
with the session's id; a node's announcement says which session it has. Where the two do not agree, the
message is not the node's. Neither is proved (only certificates could): this finds who takes a name without
more ado, and mistakes nobody for a stranger whose stamps are made elsewhere, by a router or by the receiver.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Mapping

from transports.refusals import MOST_PLACES, shown
from transports.zenoh.tokens import NodeToken

MOST_NAMES = 1000
"""Names of nodes that never announced themselves; who comes with one more is taken as nameless."""


class Claims:
    """What one tap knows of who sends in whose name.

    Args:
        announced: the tokens of each node that is up; changed with ``lock`` in hand.
        linked: asks for the ids of the sessions that this one is linked to. Zenoh's own locks are taken for
            that, which it holds as it reports tokens: so never with ``lock`` in hand.
        lock: held while what is announced changes.
    """

    def __init__(
        self,
        announced: Mapping[str, Collection[NodeToken]],
        linked: Callable[[], Collection[str]],
        lock: threading.Lock,
    ) -> None:
        self._announced = announced
        self._linked = linked
        self._lock = lock
        self._known: dict[str, object] = {}
        """The session from which something was last received rightly in each name."""
        self._foreign: dict[tuple[str, str], int] = {}
        self._misplaced: dict[tuple[str, str], int] = {}

    def is_right(self, name: str, session: object) -> bool:
        """Whether what is stamped by ``session`` (an id, by its ``str``) may be from the node ``name``."""
        known = self._known.get(name)
        if known is not None and known == session:
            return True
        zid = str(session)
        with self._lock:
            own = {token.zid for token in self._announced.get(name, ())}
        if own and zid not in own:
            place = (name, zid)
            counts = self._foreign
            if place in counts or str(known) in own or zid in self._linked():
                if place in counts or len(counts) < MOST_PLACES:
                    counts[place] = counts.get(place, 0) + 1
                return False
        elif not own and known is None and len(self._known) >= MOST_NAMES:
            return False
        self._known[name] = session
        return True

    def note_misplaced(self, name: str, channel: str) -> None:
        """Something came about ``channel`` in the name of a node that may not send it."""
        place, counts = (name, channel), self._misplaced
        if place in counts or len(counts) < MOST_PLACES:
            counts[place] = counts.get(place, 0) + 1

    def sentences(self) -> list[str]:
        """Who sends in whose name, one sentence each."""
        return [
            *(
                f"several sessions claim to be {shown(name)}: which of them is the node is not known"
                for name, tokens in sorted(self._announced.items())
                if len(tokens) > 1
            ),
            *(
                f"{count} message{'s' * (count != 1)} in the name of {shown(name)}, but sent by another "
                f"session, {zid}: treated as unnamed"
                for (name, zid), count in sorted(self._foreign.copy().items())
            ),
            *(
                f"{count} message{'s' * (count != 1)} on {shown(channel)} in the name of {shown(name)}, "
                "which may not send there: another node's, treated as unnamed"
                for (name, channel), count in sorted(self._misplaced.copy().items())
            ),
        ]
