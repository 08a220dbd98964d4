"""When the nodes of a process begin: at once, or once those who observe the run receive all that they send.

Where taps are linked to a node channel by channel, a node that begins as it has connected has done its first
things before anybody who was there can receive them.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Collection, Sequence
from functools import partial
from queue import Empty

from m2c.suggestions import first_of
from transports.interface import Connection, LinksByChannel
from transports.work_queue import WorkQueue

LINKED_S = 10.0
"""Nodes wait no longer for those who observe them: a run is worth more than what is known of its begin."""

_LOG = logging.getLogger("m2c")
_Link = tuple[str, str]
"""A node, and who observes it."""


class Observers:
    """Those who observe the run.

    Args:
        names: of their nodes.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self._news: WorkQueue[_Link | None] = WorkQueue()

    def give_up(self) -> None:
        """End :meth:`wait`, or have it end at once; from any thread, and from a handler of signals."""
        self._news.put(None)

    def wait(self, connections: Sequence[Connection], known: Collection[str] = ()) -> None:
        """Wait until they receive all that some nodes send, or for :data:`LINKED_S`: then that is logged.

        Args:
            connections: of the nodes, which have declared all their channels.
            known: nodes of which the observers must have been told that they are up, too.
        """
        linking = [one for one in connections if isinstance(one, LinksByChannel)]
        missing = {(one.node, observer) for one in linking for observer in self._names}
        for one in linking:
            for observer in self._names:
                linked = partial(self._news.put, (one.node, observer))
                one.when_observed(observer, known, linked)
        deadline_s = time.monotonic() + LINKED_S
        while missing:
            try:
                news = self._news.get(timeout=max(deadline_s - time.monotonic(), 0.0))
            except Empty:
                _say_missing(missing)
                return
            if news is None:
                return
            missing.discard(news)


def _say_missing(links: Collection[_Link]) -> None:
    for observer in sorted({observer for _, observer in links}):
        nodes = sorted(node for node, other in links if other == observer)
        _LOG.warning(
            "%s does not receive all that %s sends after %g s: what it does first may be missed",
            observer,
            first_of(nodes),
            LINKED_S,
        )
