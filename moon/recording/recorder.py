"""A recorder at work: from a tap to a file."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from moon.feed.clock import SET_NS, clock_nobody_sets, clocks_of, read_together
from moon.recording.entries import (
    UNUSUAL_NS,
    Began,
    Ended,
    Ending,
    Missed,
    NodeChange,
    Pulse,
    Turn,
    Whole,
)
from moon.recording.misses import Misses
from moon.recording.writer import RecordingWriter
from moon.tap.completeness import when_complete
from moon.tap.selection import Selection, check, is_recorded
from transports.interface import Listener, Observation, Tap

MAX_KNOWN = 100_000
"""Channels of which it is kept whether they are wanted; names come from the wire, and never end."""


class Recorder:
    """Records what is received over ``connection``.

    Args:
        connection: where to listen.
        transport: its middleware.
        writer: where to.
        globs: channels to be recorded (``moon.tap.selection.matches``; an action stands for all its
            parts); empty: all.
        say: called when everything is received, if it was not from the beginning, or that it never was.
        monotonic_ns: a clock that nobody sets: by it silence is distinguished from a clock that was.
            By default the system's, and that of a simulated world.

    Raises:
        GlobError: no channel can match one of ``globs``.
    """

    def __init__(
        self,
        connection: Listener,
        transport: str,
        writer: RecordingWriter,
        globs: Sequence[str],
        say: Callable[[str], None],
        monotonic_ns: Callable[[], int] | None = None,
    ) -> None:
        for glob in globs:
            check(glob)
        self._connection = connection
        self._transport = transport
        self._writer = writer
        self._globs = tuple(globs)
        self._say = say
        self._clock_of = clocks_of(connection)
        self._read_monotonic = monotonic_ns or clock_nobody_sets(connection)
        self._looked_ns = 0
        """The time of day when both clocks were looked at, or when something was received since."""
        self._ahead_ns = 0
        """By how much the time of day was ahead of the clock that nobody sets, then."""
        self._wanted: dict[str, bool] = {}
        self._misses = Misses(writer.add)
        self.listener: Tap | None = None

    def start(self) -> None:
        """Begin to listen (on the executor, or before it spins)."""
        connection, writer = self._connection, self._writer
        now_ns = connection.now_ns()
        self.listener = tap = connection.tap(Selection(self._globs).tapped(), self._observe)
        whole = tap.is_complete
        repair_s = connection.repair_s
        writer.add(
            Began(
                now_ns,
                connection.node,
                self._transport,
                repair_s=repair_s,
                whole=whole,
                globs=self._globs,
                clock=self._clock_of(""),
            )
        )
        self._look_at_clocks()
        connection.watch_nodes(self._node_changed)
        if not whole:
            when_complete(connection, tap, self._note_whole, self._give_up)

    def look_around(self) -> None:
        """Hand what was recorded to the system, and record what the tap could not receive.

        Raises:
            OSError: the file cannot be written.
        """
        assert self.listener is not None
        now_ns = self._connection.now_ns()
        self._misses.look_at_blind_spots(self.listener.blind_spots(), now_ns)
        self._misses.look_at_problems(self.listener.problems(), now_ns)
        self._look_at_clocks()
        self._writer.flush()

    def ending(self) -> None:
        """Who runs the system begins to end its nodes."""
        self._writer.add(Ending(self._connection.now_ns()))

    def finish(self) -> None:
        """The end, in good order; OSError if the file cannot be written."""
        self.look_around()
        self._writer.add(Ended(self._connection.now_ns()))
        self._writer.close()

    def _look_at_clocks(self) -> None:
        """Both at the same instant, or a clock seems to be set: not one when something was received."""
        now_ns, monotonic_ns = read_together(self._connection.now_ns, self._read_monotonic)
        self._looked_ns, self._ahead_ns = now_ns, now_ns - monotonic_ns
        self._writer.add(Pulse(now_ns, Turn.CLOCK, monotonic_ns))

    def _observe(self, seen: Observation) -> None:
        received_ns = seen.received_ns
        set_ns = self._connection.now_ns() - self._read_monotonic() - self._ahead_ns
        is_set = not -SET_NS <= set_ns <= SET_NS
        if not is_set and -UNUSUAL_NS <= received_ns - self._looked_ns <= UNUSUAL_NS:
            self._looked_ns = received_ns
        else:
            self._look_at_clocks()
            self._looked_ns = received_ns  # who was held up has more of that time to come
        if not self._globs:
            self._writer.add(seen)
            return
        channel = seen.channel
        wanted = self._wanted.get(channel)
        if wanted is None:
            wanted = is_recorded(channel, self._globs)
            if len(self._wanted) < MAX_KNOWN:
                self._wanted[channel] = wanted
        if wanted:
            self._writer.add(seen)

    def _note_whole(self) -> None:
        self._writer.add(Whole(self._connection.now_ns()))
        self._say("what is recorded from here on is judged in any case")

    def _give_up(self) -> None:
        text = "the graph goes on changing: what was recorded first may be a part of it"
        self._writer.add(Missed(self._connection.now_ns(), text))
        self._say(f"warning: {text}")

    def _node_changed(self, name: str, up: bool) -> None:
        connection = self._connection
        since_ns, clock = (connection.up_since(name), self._clock_of(name)) if up else (0, "")
        self._writer.add(NodeChange(connection.now_ns(), name, up, since_ns, clock=clock))
