"""A recording as a monitor's connection: it is handed what was recorded, when it was.

``Run`` is handed this in place of a transport. A recording of a monitor has the turns that it
took, and they are taken again, one by one. Any other recording has none: then the timer runs when it is
due by the clock of the recording, and what is left for later is done at once.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence

from moon.feed.clock import NS, SET_NS
from moon.recording.entries import (
    Answered,
    Began,
    Entry,
    Missed,
    NodeChange,
    Pulse,
    Turn,
    Whole,
    set_by_ns,
)
from moon.recording.stored import plural
from transports.interface import (
    Answer,
    BlindSpot,
    BlindSpotKind,
    Observation,
    Publisher,
    Tap,
    Timer,
    Topic,
    TransportError,
)

MAX_BLIND_SPOTS = 1_000
"""Channels that are remembered as not received, or not taken; their names come from a file, and never end."""
QUIET_AT_FIRST_NS = 3600 * NS
"""Time passes step by step, which takes time itself: some seconds for an hour in which nothing comes."""
QUIET_PER_ENTRY_NS = 10 * NS
"""So much more of it for each entry, so that what a recording costs is bounded by its size. What is quiet
beyond that is not followed: a clock that was set, a recorder that was stopped, a damaged stamp."""

WHOLE_NS = 20 * NS
"""A recorder receives everything after so long, or says that it does not (``moon.tap.completeness``)."""


class Player:
    """A connection to a recording; see :class:`moon.run.Run`.

    Args:
        early_ns: where a recording does not say when it began, it did so long before its first
            entry.

    Attributes:
        repair_s: of the middleware that was recorded (``Listener.repair_s``).
    """

    def __init__(self, early_ns: int = 0) -> None:
        self.repair_s = 0.0
        self._early_ns = early_ns
        self._now_ns = 0
        self._monotonic_ns = 0
        self._monotonic_began_ns: int | None = None
        """What the recorder's monotonic clock showed as the recording began; None: it is not known yet."""
        self._turned_ns = 0
        self._paced = False
        self._next_ns = 0
        """When the timer is due, in a recording without turns."""
        self._handler: Callable[[Observation], None] = _nothing
        self._changed: Callable[[str, bool], None] | None = None
        self._timer: Callable[[], None] | None = None
        self._posted: deque[Callable[[], None]] = deque()
        self._since = _Since()
        self.up_since = self._since.__getitem__
        """When a node began to connect; 0 if the recording does not say."""
        self._clocks: dict[str, str] = {}
        self._missed: dict[str, str] = {}
        self._asked: dict[str, Callable[[Answer | None], None]] = {}
        """What the watch does with an answer, by the node that it asked."""
        self._asked_ns: dict[str, int] = {}
        """When each was asked first of those that have not answered (ns): recordings of before do not say of
        which question an answer is."""
        self._begin: Callable[[], None] = _nothing_to_begin
        self._whole_by_ns = 0
        self._waiting: list[Entry] | None = None
        """What was recorded before the recorder received everything; None once it does."""
        self._looked: Pulse | None = None
        """When a recorder that was no monitor looked at both clocks last."""
        self._quiet_ns = QUIET_AT_FIRST_NS
        """How much of silences can still be passed through step by step."""
        self._jumps = 0
        """How many silences were not."""
        self._left_out_ns = 0
        """How long it did not; 0: what was recorded then is judged, too."""
        self._is_over = False
        self._contested: set[str] = set()
        self._blind_spots: dict[BlindSpot, str] = {}
        """What the recorder does not know now."""

    # --- for the watch -----------------------------------------------------------------------------

    def now_ns(self) -> int:
        """The time of the recording."""
        return self._now_ns

    def steady_ns(self) -> int:
        """The recorder's monotonic clock, which has run as its time of day since the last turn."""
        return self._monotonic_ns + (self._now_ns - self._turned_ns if self._paced else 0)

    def tap(self, channels: Sequence[str], handler: Callable[[Observation], None]) -> Tap:
        """``handler`` receives what was recorded."""
        self._handler = handler
        return self

    def watch_nodes(self, handler: Callable[[str, bool], None]) -> None:
        """``handler`` is called for nodes that come and go."""
        self._changed = handler

    def clock_of(self, name: str) -> str:
        """By which clock a node stamps; "" if the recording does not say."""
        return self._clocks.get(name, "")

    def after(self, delay_s: float, handler: Callable[[], None]) -> Timer:
        """The watch's timer; it has one at a time."""
        self._timer = handler
        self._next_ns = self._now_ns + round(delay_s * NS)
        return self

    def post(self, handler: Callable[[], None]) -> None:
        """Leave something for later."""
        self._posted.append(handler)

    def publisher(self, topic: Topic) -> Publisher:
        """Nothing is published: TransportError."""
        raise TransportError(f"{topic.name}: nobody listens to a recording")

    @property
    def is_complete(self) -> bool:
        """Nothing is handed to the watch before that."""
        return True

    def ask(
        self, node: str, answered: Callable[[Answer | None], None], within_s: float = 1.0
    ) -> None:
        """Who answered then answers again; nobody else is there to be asked."""
        self._asked[node] = answered
        self._asked_ns.setdefault(node, self.now_ns())

    def is_contested(self, name: str) -> bool:
        """Whether several claimed that name, as the recorder had it."""
        return name in self._contested

    def take_dropped(self) -> Sequence[tuple[str, str]]:
        """Nothing: what the recorder dropped is among ``problems``."""
        return ()

    def blind_spots(self) -> Mapping[BlindSpot, str]:
        """What the recorder did not know; what it was not to record is known before it is played."""
        return self._blind_spots

    def peers(self) -> Sequence[str]:
        """Nobody."""
        return ()

    def problems(self) -> Sequence[str]:
        """What the recorder reported as not received."""
        return tuple(self._missed.values())

    def close(self) -> None:
        """Nothing is open."""

    def __enter__(self) -> Player:
        """Itself."""
        return self

    def __exit__(self, *raised: object) -> None:
        """Nothing is open."""

    def cancel(self) -> None:
        """It will not run."""
        self._timer = None

    @property
    def is_paced(self) -> bool:
        """Whether the turns of a monitor are taken."""
        return self._paced

    def take_another_time(self, why: str) -> None:
        """Any node's timers may follow another clock."""
        self._blind_spots[BlindSpot(BlindSpotKind.OTHER_TIME)] = why

    # --- for who reads the recording ---------------------------------------------------------------

    def start(self, first: Entry, begin: Callable[[], None]) -> None:
        """Begin where ``first``, the recording's first entry, says; ``begin`` starts the watch, there or
        where all is received.
        """
        self._begin = begin
        if isinstance(first, Began):
            self._now_ns = self._turned_ns = first.received_ns
            self._paced = first.paced
            self.repair_s, self._clocks[""] = first.repair_s, first.clock
        else:
            self._now_ns = first.received_ns - self._early_ns
        if isinstance(first, Began) and not first.whole:
            self._waiting, self._whole_by_ns = [], first.received_ns + WHOLE_NS
        else:
            begin()

    def finish(self, end_ns: int = 0) -> None:
        """The recording is over at ``end_ns``: the watch is started if it was not."""
        if self._waiting is not None:
            self._stop_waiting(self._waiting[-1].received_ns if self._waiting else self._now_ns)
            self._is_over = True
        self._move_to(max(self._now_ns, end_ns))

    def limits(self) -> list[str]:
        """What is not judged as it was not recorded, or not received by the recorder, one sentence each."""
        found = []
        if self._left_out_ns and self._is_over:
            found.append(
                "it ended before its recorder was connected to all nodes: nothing is judged"
            )
        elif self._left_out_ns:
            found.append(
                f"its recorder was connected to all nodes from {self._left_out_ns / NS:.1f} s on: "
                "what was before is not judged"
            )
        if self._jumps:
            found.append(
                f"nothing was recorded for too long, {plural(self._jumps, 'time')}: taken for a "
                "clock that was set, and not for silence"
            )
        return found

    def _wait(self, entry: Entry) -> None:
        """``entry`` was received, but perhaps not what belongs to it."""
        assert self._waiting is not None
        if entry.received_ns > self._whole_by_ns:  # where it says so is damaged
            self._stop_waiting(entry.received_ns)
            self.play(entry)
        elif isinstance(entry, Whole):
            self._stop_waiting(entry.received_ns)
        else:
            self._waiting.append(entry)

    def _stop_waiting(self, now_ns: int) -> None:
        """All is received from ``now_ns`` on; before it, too, if nobody was there when it began."""
        waited, self._waiting = self._waiting or [], None
        if _is_from_the_start(self._now_ns, waited):
            self._begin()
            for entry in waited:
                self.play(entry)
            return
        self._left_out_ns = now_ns - self._now_ns
        self._move_to(now_ns)
        self._begin()
        for entry in waited:
            if isinstance(entry, NodeChange | Missed):
                self._note(entry)

    def play(self, entry: Entry) -> None:
        """Tell the watch of ``entry``."""
        if self._waiting is not None:
            self._wait(entry)
            return
        if self._paced:
            self._now_ns = entry.received_ns
        elif type(entry) is Pulse and abs(set_by_ns(self._looked, entry)) > SET_NS:
            # time has passed until the clock was set
            self._pass_to(entry.received_ns - set_by_ns(self._looked, entry))
            self._next_ns = self._now_ns = entry.received_ns
        else:
            self._pass_to(entry.received_ns)
        if type(entry) is Observation:  # nearly all are, or turns
            self._handler(entry)
            return
        if type(entry) is Pulse:
            if self._paced:
                self._take_turn(entry)
            else:
                self._looked = entry
            return
        self._note(entry)

    def _note(self, entry: Entry) -> None:
        match entry:
            case NodeChange():
                self._change(entry)
            case Missed(text="", blind_spot=BlindSpot() as spot):
                self._blind_spots.pop(spot, None)
            case Missed(blind_spot=spot):
                if spot is None or spot.kind is BlindSpotKind.NOT_RECEIVED:
                    self._missed[_subject(entry.text)] = entry.text
                if spot is not None and len(self._blind_spots) < MAX_BLIND_SPOTS:
                    self._blind_spots[spot] = entry.text
            case Answered(node=node, stamp_ns=stamp_ns):
                if node in self._asked:
                    first_ns = self._asked_ns.pop(node, stamp_ns)
                    asked_ns = entry.asked_ns or first_ns
                    answer = Answer(
                        stamp_ns, entry.next_order, entry.clock_ns, asked_ns, entry.life
                    )
                    self._asked[node](answer)
            case Began():
                self._return_all()
            case _:
                pass

    def _return_all(self) -> None:
        """Something is missing: all nodes are found in the middle of what they do."""
        if self._changed is None:
            return
        for name in tuple(self._since):
            self._changed(name, False)
            self._changed(name, True)

    def _take_turn(self, pulse: Pulse) -> None:
        if self._monotonic_began_ns is None:
            self._monotonic_began_ns = pulse.monotonic_ns - self.steady_ns()
        self._monotonic_ns = pulse.monotonic_ns - self._monotonic_began_ns
        self._turned_ns = pulse.received_ns
        if pulse.turn is Turn.TIMER and self._timer is not None:
            self._timer()
        elif pulse.turn is Turn.POSTED and self._posted:
            self._posted.popleft()()

    def _change(self, change: NodeChange) -> None:
        if change.contested:
            self._contested.add(change.node)
        else:
            self._contested.discard(change.node)
        if change.up:
            self._since[change.node], self._clocks[change.node] = change.since_ns, change.clock
        elif change.reported:
            self._since.pop(change.node, None)
            self._clocks.pop(change.node, None)
        if change.reported and self._changed is not None:
            self._changed(change.node, change.up)

    def _pass_to(self, instant_ns: int) -> None:
        """Time passes to ``instant_ns``, for a watch whose turns were not recorded."""
        ahead_ns = instant_ns - self._next_ns
        self._quiet_ns += QUIET_PER_ENTRY_NS
        if -NS < ahead_ns < self._quiet_ns:
            self._quiet_ns -= max(ahead_ns, 0)
        else:
            self._jumps += ahead_ns > 0
            self._next_ns = self._now_ns = instant_ns  # the clock was set
        while self._timer is not None and self._next_ns <= instant_ns:
            self._move_to(self._next_ns)
            timer, self._timer = self._timer, None
            timer()
            while self._posted:
                self._posted.popleft()()
        self._move_to(instant_ns)

    def _move_to(self, instant_ns: int) -> None:
        self._monotonic_ns += max(instant_ns - self._now_ns, 0)
        self._now_ns = instant_ns


class _Since(dict[str, int]):
    """Since when nodes are up; the monitor asks for each of them at every turn."""

    def __missing__(self, name: str) -> int:
        return 0


def _is_from_the_start(began_ns: int, entries: Sequence[Entry]) -> bool:
    """Whether all sources of ``entries`` began to connect after ``began_ns``."""
    started: set[str] = set()
    sources: set[str] = set()
    for number, entry in enumerate(entries):
        if type(entry) is Observation:
            sources.add(entry.source)
        elif isinstance(entry, NodeChange):
            if entry.up and entry.since_ns < began_ns:
                return False
            started.add(entry.node)
        elif isinstance(entry, Began) and number:  # something is missing
            return False
    return sources <= started


def _subject(problem: str) -> str:
    """What a sentence is about: its digits count what goes on growing."""
    return "".join(letter for letter in problem if not letter.isdigit())


def _nothing(_: Observation) -> None:
    pass


def _nothing_to_begin() -> None:
    pass
