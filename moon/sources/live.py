"""A monitor that joins a running system begins when its tap receives all of it.

Who judges what a tap receives before (:mod:`moon.tap.completeness`) says that something did not happen. So
the tap is opened first, what it receives before it is complete is left out, and then the monitor begins.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from moon.feed.clock import clock_nobody_sets
from moon.tap.completeness import when_complete
from transports.interface import Listener, Observation, Publisher, Tap, Timer, Topic


class Joining:
    """What :class:`moon.run.Run` needs of a transport, the tap opened before.

    Args:
        connection: the monitor's.
    """

    def __init__(self, connection: Listener) -> None:
        self._connection = connection
        self._steady_ns = clock_nobody_sets(connection)
        self._up: dict[str, None] = {}
        self._handler: Callable[[Observation], None] | None = None
        self._changed: Callable[[str, bool], None] | None = None
        self._begin: Callable[[int], None] | None = None
        """What is to be called once something is received."""
        self._since_ns = 0
        self._is_active = False
        self._held: list[Observation] | None = None
        """What was received before the handler knows who is up."""
        self._tap = connection.tap([], self._received)
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

    @property
    def node(self) -> str:
        """See ``Transport.node``."""
        return self._connection.node

    @property
    def repair_s(self) -> float:
        """See ``Listener.repair_s``."""
        return self._connection.repair_s

    def now_ns(self) -> int:
        """See ``Transport.now_ns``."""
        return self._connection.now_ns()

    def steady_ns(self) -> int:
        """See ``transports.interface.VirtualTime``."""
        return self._steady_ns()

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

    def close(self) -> None:
        """Close the tap."""
        self._tap.close()

    def problems(self) -> Sequence[str]:
        """See ``Tap.problems``."""
        return self._tap.problems()

    def up_since(self, name: str) -> int:
        """See ``Listener.up_since``."""
        return self._connection.up_since(name)

    def after(self, delay_s: float, handler: Callable[[], None]) -> Timer:
        """See ``Transport.after``."""
        return self._connection.after(delay_s, handler)

    def post(self, handler: Callable[[], None]) -> None:
        """See ``Transport.post``."""
        self._connection.post(handler)

    def publisher(self, topic: Topic) -> Publisher:
        """See ``Transport.publisher``."""
        return self._connection.publisher(topic)

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
