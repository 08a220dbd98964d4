"""A monitor's connection, recorded: what came over it, and when the monitor acted.

A monitor's verdicts are a function of what its connection hands it. So that a recording gives the same
verdicts, time stands still for the monitor while it deals with one thing: the time that it reads, however
often, is the one recorded with that thing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from msgspec.structs import astuple, replace

from moon.feed.clock import SET_NS, clock_nobody_sets, clocks_of, read_together
from moon.recording.entries import (
    UNUSUAL_NS,
    Answered,
    Began,
    Ended,
    Ending,
    Entry,
    NodeChange,
    Pulse,
    ReportedVerdict,
    Turn,
)
from moon.recording.misses import Misses
from moon.recording.writer import RecordingWriter
from moon.sources.source import Source
from moon.verdict import Verdict
from transports.interface import (
    Answer,
    BlindSpot,
    Closes,
    Observation,
    Publisher,
    Tap,
    Timer,
    Topic,
)


class Home(Source, Protocol):
    """The connection that is recorded: a ``Transport``, or what stands before it."""

    @property
    def node(self) -> str:
        """See ``Transport.node``."""
        ...

    def publisher(self, topic: Topic) -> Publisher:
        """See ``Transport.publisher``."""
        ...


class RecordedConnection:
    """What :class:`moon.run.Run` needs of a transport, recorded.

    Args:
        home: the connection.
        record: takes everything, before the monitor does.
        transport: its middleware.
    """

    def __init__(
        self,
        home: Home,
        record: Callable[[Entry], None],
        transport: str,
    ) -> None:
        self._home = home
        self._record = record
        self._transport = transport
        self._now_ns = home.now_ns()
        self._read_monotonic = read = clock_nobody_sets(home)
        self._monotonic_ns = read()
        self._turned_ns = self._now_ns
        self._since: dict[str, int] = {}
        """Of the nodes that are up."""
        self._read_clock = clocks_of(home)
        self._clocks = {"": self._read_clock("")}
        """Of these, by which each stamps, and of this connection."""
        self._contested: set[str] = set()
        """Names that several claim, as it was when something came in each last."""
        self._read_blind_spots: Callable[[], Mapping[BlindSpot, str]] = dict
        self.misses = Misses(record)
        """What is not known, as it was in the last turn."""

    @property
    def repair_s(self) -> float:
        """See ``Listener.repair_s``."""
        return self._home.repair_s

    def now_ns(self) -> int:
        """When that began which the monitor deals with now."""
        return self._now_ns

    def steady_ns(self) -> int:
        """The same on a clock that nobody sets, which has run as the time of day since the last turn."""
        return self._monotonic_ns + (self._now_ns - self._turned_ns)

    def tap(self, channels: Sequence[str], handler: Callable[[Observation], None]) -> Tap:
        """Listen, from now on."""
        home, record = self._home, self._record

        def received(seen: Observation) -> None:
            now_ns = self._now_ns = home.now_ns()
            passed_ns = now_ns - self._turned_ns
            set_ns = passed_ns - (self._read_monotonic() - self._monotonic_ns)
            if passed_ns > UNUSUAL_NS or not -SET_NS <= set_ns <= SET_NS:
                now_ns = self._take_turn(Turn.CLOCK)
            if seen.received_ns != now_ns:
                seen = replace(seen, received_ns=now_ns)
            if tap.is_contested(seen.source) != (seen.source in self._contested):
                self._note_contest(seen.source)
            record(seen)
            handler(seen)

        now_ns = self._look_at_clocks()  # once: the run begins when the recording does
        record(
            Began(
                now_ns,
                home.node,
                self._transport,
                paced=True,
                repair_s=home.repair_s,
                clock=self._clocks[""],
            )
        )
        record(Pulse(now_ns, Turn.CLOCK, self._monotonic_ns))
        tap = home.tap(channels, received)
        self._read_blind_spots = tap.blind_spots
        return _RecordedTap(
            tap,
            home.now_ns,
            self._note_answer,
            self._contested.__contains__,
            lambda: self.misses.blind_spots,
        )

    def _note_contest(self, name: str) -> None:
        """Several claim to be ``name``, or do so no longer."""
        self._contested ^= {name}
        since_ns = self._since.get(name)
        self._note_node(name, since_ns is not None, since_ns or 0, reported=False)

    def _note_node(self, name: str, up: bool, since_ns: int, reported: bool) -> None:
        contested, clock = name in self._contested, self._clocks.get(name, "")
        self._record(NodeChange(self._now_ns, name, up, since_ns, reported, contested, clock))

    def _note_answer(self, node: str, answer: Answer) -> None:
        now_ns = self._now_ns = self._home.now_ns()
        self._record(Answered(now_ns, node, *astuple(answer)))

    def watch_nodes(self, handler: Callable[[str, bool], None]) -> None:
        """``handler`` is called for nodes that come and go."""

        def changed(name: str, up: bool) -> None:
            self._now_ns = self._home.now_ns()
            since_ns = self._home.up_since(name)
            if up:
                self._since[name], self._clocks[name] = since_ns, self._read_clock(name)
            else:
                self._since.pop(name, None)
                self._clocks.pop(name, None)
            self._note_node(name, up, since_ns, reported=True)
            handler(name, up)

        self._home.watch_nodes(changed)

    def up_since(self, name: str) -> int:
        """When a node began to connect, as it is known since the last turn."""
        return self._since.get(name, 0)

    def clock_of(self, name: str) -> str:
        """By which clock a node stamps, as it is known since it came up."""
        return self._clocks.get(name, "")

    def after(self, delay_s: float, handler: Callable[[], None]) -> Timer:
        """A timer, whose turn is recorded."""

        def run() -> None:
            self._now_ns = self._home.now_ns()
            self._look_at_nodes()
            self.misses.look_at_blind_spots(self._read_blind_spots(), self._now_ns)
            self._take_turn(Turn.TIMER)
            handler()

        return self._home.after(delay_s, run)

    def post(self, handler: Callable[[], None]) -> None:
        """Run ``handler`` later, which is recorded."""

        def run() -> None:
            self._now_ns = self._home.now_ns()
            self._take_turn(Turn.POSTED)
            handler()

        self._home.post(run)

    def publisher(self, topic: Topic) -> Publisher:
        """A publisher of the connection."""
        return self._home.publisher(topic)

    def _take_turn(self, turn: Turn) -> int:
        """Both clocks are looked at; the time of day (ns)."""
        now_ns = self._look_at_clocks()
        self._record(Pulse(now_ns, turn, self._monotonic_ns))
        return now_ns

    def _look_at_clocks(self) -> int:
        now_ns, self._monotonic_ns = read_together(self._home.now_ns, self._read_monotonic)
        self._turned_ns = self._now_ns = now_ns
        return now_ns

    def _look_at_nodes(self) -> None:
        for name, before_ns in self._since.items():
            since_ns = self._home.up_since(name)
            if since_ns != before_ns:
                self._since[name] = since_ns
                self._note_node(name, True, since_ns, reported=False)


class _RecordedTap(Closes):
    """A tap whose answers are recorded.

    Args:
        tap: the connection's.
        now_ns: the connection's clock.
        note: takes who answered what, before the monitor does.
        is_contested: whether several claim a name, as it is recorded.
        read_blind_spots: what is not known, as it is recorded.
    """

    def __init__(
        self,
        tap: Tap,
        now_ns: Callable[[], int],
        note: Callable[[str, Answer], None],
        is_contested: Callable[[str], bool],
        read_blind_spots: Callable[[], Mapping[BlindSpot, str]],
    ) -> None:
        self._tap = tap
        self._now_ns = now_ns
        self._note = note
        self.is_contested = is_contested
        self.take_dropped = tap.take_dropped
        self._read_blind_spots = read_blind_spots
        self.peers = tap.peers
        self.problems = tap.problems

    def blind_spots(self) -> Mapping[BlindSpot, str]:
        return self._read_blind_spots()

    def close(self) -> None:
        self._tap.close()

    @property
    def is_complete(self) -> bool:
        return self._tap.is_complete

    def ask(
        self, node: str, answered: Callable[[Answer | None], None], within_s: float = 1.0
    ) -> None:
        asked_ns = self._now_ns()

        def take(answer: Answer | None) -> None:
            if answer is not None:
                answer = replace(answer, asked_ns=asked_ns)
                self._note(node, answer)
            answered(answer)

        self._tap.ask(node, take, within_s)


class RecordedRun:
    """What else is recorded of a monitor's run: its verdicts, what its tap missed, its end.

    Args:
        connection: the monitor's.
        writer: of the recording.
    """

    def __init__(self, connection: RecordedConnection, writer: RecordingWriter) -> None:
        self._connection = connection
        self._writer = writer

    def take(self, verdict: Verdict) -> None:
        """The monitor says ``verdict``."""
        self._writer.add(ReportedVerdict(self._connection.now_ns(), verdict))

    def note_problems(self, problems: Sequence[str]) -> None:
        """What the tap could not receive."""
        self._connection.misses.look_at_problems(problems, self._connection.now_ns())

    def flush(self) -> None:
        """Hand what was recorded to the system; OSError if it could not be written."""
        self._writer.flush()

    def ending(self, now_ns: int) -> None:
        """Who runs the system begins to end its nodes (ns)."""
        self._writer.add(Ending(now_ns))

    def end(self, problems: Sequence[str]) -> None:
        """The monitor stops in good order."""
        self.note_problems(problems)
        self._writer.add(Ended(self._connection.now_ns()))
