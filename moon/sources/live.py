"""A monitor that joins a running system begins when its tap receives all of it.

Who judges what a tap receives before (:mod:`moon.tap.completeness`) says that something did not happen. So
the tap is opened first, what it receives before it is complete is left out, and then the monitor begins.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from moon.feed.clock import clock_nobody_sets, clocks_of
from moon.tap.completeness import when_complete
from transports.interface import Listener, Observation, Tap


class Joining:
    """What :class:`moon.run.Run` needs of a transport, the tap opened before.

    Args:
        connection: the monitor's.
    """

    def __init__(self, connection: Listener) -> None:
        self._connection = connection
        self.node, self.repair_s = connection.node, connection.repair_s
        self.now_ns, self.steady_ns = connection.now_ns, clock_nobody_sets(connection)
        self.after, self.post = connection.after, connection.post
        self.up_since, self.publisher = connection.up_since, connection.publisher
        self.clock_of = clocks_of(connection)
        self._up: dict[str, None] = {}
        self._handler: Callable[[Observation], None] | None = None
        self._changed: Callable[[str, bool], None] | None = None
        self._begin: Callable[[int], None] | None = None
        """What is to be called once something is received."""
        self._since_ns = 0
        self._is_active = False
        self._held: list[Observation] | None = None
        """What was received before the handler knows who is up."""
        self._tap = tap = connection.tap([], self._received)
        self.close, self.problems = tap.close, tap.problems
        connection.watch_nodes(self._node_changed)

    def when_complete(self, begin: Callable[[], None], say: Callable[[str], None]) -> None:
        """Call ``begin`` once, when the tap receives everything; at once, if it does already."""
        warning = "warning: the graph still changes: monitoring begins before all nodes are known"
        when_complete(self._connection, self._tap, begin, lambda: say(warning))

    def when_active(self, begin: Callable[[int], None], say: Callable[[str], None]) -> None:
        """Call ``begin(since_ns)`` once, when something is received: since then, the tap receives everything.

        Until then this is no more than a tap in which nothing happens.
        """
        self._begin = begin
        self.when_complete(self._completed, say)

    def _completed(self) -> None:
        self._since_ns = self._connection.now_ns()
        if self._is_active:
            self._begin_now()

    def _begin_now(self) -> None:
        begin, self._begin = self._begin, None
        if begin is not None:
            begin(self._since_ns)

    def tap(self, channels: Sequence[str], handler: Callable[[Observation], None]) -> Tap:
        """The tap that is open, from now on for ``handler``; of all channels, as monitors want it."""
        assert not channels
        self._handler = handler
        return self._tap

    def watch_nodes(self, handler: Callable[[str, bool], None]) -> None:
        """``handler`` is called soon for those that are up then, and for changes from then on."""
        self._connection.post(partial(self._report_nodes, handler))

    def _report_nodes(self, handler: Callable[[str, bool], None]) -> None:
        self._changed = handler
        for name in tuple(self._up):
            handler(name, True)
        held, self._held = self._held, None
        for seen in held or ():
            self._received(seen)

    def _received(self, seen: Observation) -> None:
        if self._held is not None:
            self._held.append(seen)
        elif self._handler is not None:
            self._handler(seen)
        elif self._begin is not None:
            self._is_active = True
            if self._since_ns:
                self._held = [seen]
                self._begin_now()

    def _node_changed(self, name: str, up: bool) -> None:
        if up:
            self._up[name] = None
        else:
            self._up.pop(name, None)
        if self._changed is not None:
            self._changed(name, up)
