"""A monitor that stood still goes on with what has waited for it, as if it had received that in time.

While a monitor gets no processor time, its nodes go on. What they do waits in the middleware and comes when
the monitor wakes, one channel after the other. So nothing is handed over until one latency bound after that,
when all is there that happened before (on ROS 2 also what is sent again). Meanwhile nodes are asked how far
they have reported. Where numbers show that nothing is missing, all of it is handed over in the order in which
it happened, and time passes in between as it would have. Else it is handed over as it came: then the monitor
begins anew (``moon.feed.intake``).

What a recorder that stood still received is moved in the same way (``moon.sources.on_time``).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import msgspec
from msgspec.structs import replace

from moon.feed.clock import NS, SET_NS, USUAL_GAP_NS, clock_nobody_sets, clocks_of, read_together
from moon.sources.on_time import LATEST_NS, MAX_HELD
from moon.sources.source import Source
from transports.interface import Answer, Observation, ObservationKind, Tap, Timer

ANSWERED_NS = NS
"""So long an answer is waited for (``Tap.ask``), beyond the latency bound (ns)."""
Answered = Callable[[str, Answer, int], None]
"""Takes the node, its answer, and when it was asked (ns)."""


class Backlog(msgspec.Struct, frozen=True):
    """What came after a standstill.

    Attributes:
        seen: the observations, in the order in which they came.
        answers: of the nodes that were asked.
    """

    seen: Sequence[Observation]
    answers: Mapping[str, Answer]


class _Held(msgspec.Struct, frozen=True):
    """What came, by both clocks of then (ns).

    Attributes:
        call: hands it over.
        seen: an observation.
        is_old: whether the monitor left it for later before it stood still.
    """

    now_ns: int
    monotonic_ns: int
    call: Callable[[], None]
    seen: Observation | None = None
    is_old: bool = False


class _Timer:
    """A timer of the monitor, due at ``due_ns`` of the clock that nobody sets, as the monitor is shown it."""

    def __init__(self, timers: list[_Timer], due_ns: int, handler: Callable[[], None]) -> None:
        self.due_ns, self.handler = due_ns, handler
        self._timers = timers
        self._home: Timer | None = None
        timers.append(self)

    def arm(self, home: Source, now_ns: int, rings: Callable[[_Timer], None]) -> None:
        """Ring by the clock of ``home``, which shows ``now_ns``."""
        self._home = home.after(max(self.due_ns - now_ns, 0) / NS, partial(rings, self))

    def disarm(self) -> None:
        """Do not ring by itself."""
        if self._home is not None:
            self._home.cancel()
            self._home = None

    def cancel(self) -> None:
        """It will not run."""
        self.disarm()
        if self in self._timers:
            self._timers.remove(self)


class CatchingUp:
    """A source for a monitor that may stand still.

    Args:
        home: where what is judged comes from.
        latency_ns: nothing is received later than this after its stamp by who does not stand still.
        woke: called when the monitor wakes: it asks all that can be asked, and returns their names.
        is_whole: whether nothing is missing of what happened meanwhile.
        say: called with what a person should know.
    """

    def __init__(
        self,
        home: Source,
        latency_ns: int,
        woke: Callable[[], Sequence[str]],
        is_whole: Callable[[Backlog], bool],
        say: Callable[[str], None],
    ) -> None:
        self._home, self._woke, self._is_whole, self._say = home, woke, is_whole, say
        self._home_now_ns = home.now_ns
        self._read_monotonic = clock_nobody_sets(home)
        self._read_clock = clocks_of(home)
        self._latency_ns = latency_ns
        self._limit_ns = 2 * latency_ns
        """Who did nothing for longer stood still: a turn is at most a third of the bound after the last
        (``Turns``), and what is shorter the clock of the judges makes up for (``EventTimeClock``)."""
        self._tap: Tap | None = None
        self._take: Callable[[Observation], None] = _nothing
        self._monotonic_ns = self._read_monotonic()
        """When anything was done last."""
        self._looked = (home.now_ns(), self._monotonic_ns)
        """Both clocks, at the last turn."""
        self._held: list[_Held] | None = None
        """What came since the monitor woke; None: it is awake."""
        self._still = (0, 0)
        """Since when it stood still, and until when (ns)."""
        self._woke_at = (0, 0)
        """What both clocks showed when it woke first."""
        self._asked: Sequence[str] = ()
        self._answers: dict[str, Answer] = {}
        self._up: dict[str, int] = {}
        """Since when each node is up (ns), as the monitor was told, and as it was when it woke."""
        self._clocks: dict[str, str] = {}
        """By which clock each stamps, as the monitor was told."""
        self._has_changed = False
        self._timers: list[_Timer] = []
        self._looks: Timer | None = None
        self._shown: tuple[int, int] | None = None
        """What both clocks show while the backlog is handed over."""
        self._posted: deque[Callable[[], None]] = deque()

    # --- as any source -----------------------------------------------------------------------------

    @property
    def repair_s(self) -> float:
        """See ``Listener.repair_s``."""
        return self._home.repair_s

    def now_ns(self) -> int:
        """The time that the monitor is shown."""
        return self._home_now_ns() if self._shown is None else self._shown[0]

    def steady_ns(self) -> int:
        """The same by a clock that nobody sets."""
        return self._read_monotonic() if self._shown is None else self._shown[1]

    def tap(self, channels: Sequence[str], handler: Callable[[Observation], None]) -> Tap:
        """Listen, from now on."""
        self._take = handler
        self._tap = tap = self._home.tap(channels, self._received)
        self._look_at_clocks()  # a recording begins now
        return tap

    def _look_at_clocks(self) -> None:
        self._looked = self._read_clocks()
        self._monotonic_ns = self._looked[1]

    def watch_nodes(self, handler: Callable[[str, bool], None]) -> None:
        """``handler`` is called for nodes that come and go."""

        def changed(name: str, up: bool) -> None:
            known = self._home.up_since(name), self._read_clock(name)
            if self._is_awake():
                change(name, up, *known)
            else:
                self._has_changed = True
                self._hold(partial(change, name, up, *known))

        def change(name: str, up: bool, since_ns: int, clock: str) -> None:
            if up:
                self._up[name], self._clocks[name] = since_ns, clock
            else:
                self._up.pop(name, None)
                self._clocks.pop(name, None)
            handler(name, up)

        self._home.watch_nodes(changed)

    def up_since(self, name: str) -> int:
        """See ``Listener.up_since``; while what has waited is handed over, as it was then."""
        return self._home.up_since(name) if self._shown is None else self._up.get(name, 0)

    def clock_of(self, name: str) -> str:
        """See ``TellsClocks.clock_of``; as it was when the node came up."""
        return self._clocks.get(name, "") if name else self._read_clock("")

    def after(self, delay_s: float, handler: Callable[[], None]) -> Timer:
        """A timer, by the time that the monitor is shown."""
        now_ns = self.steady_ns()
        timer = _Timer(self._timers, now_ns + round(delay_s * NS), handler)
        if self._held is None:
            timer.arm(self._home, now_ns, self._rings)
        return timer

    def post(self, handler: Callable[[], None]) -> None:
        """Leave something for later; for soon, while what has waited is handed over."""
        if self._shown is not None:
            self._posted.append(handler)
        else:
            self._home.post(partial(self._take_posted, handler))

    def gated(self, handler: Answered) -> Answered:
        """``handler`` of answers, as it is to be called: in its turn."""

        def answered(node: str, answer: Answer, asked_ns: int) -> None:
            if self._is_awake():
                handler(node, answer, asked_ns)
            else:
                if asked_ns >= self._still[1]:
                    self._answers[node] = answer
                self._hold(partial(handler, node, answer, asked_ns))

        return answered

    # --- what comes --------------------------------------------------------------------------------

    def _received(self, seen: Observation) -> None:
        if self._is_awake():
            self._take(seen)
        else:
            self._hold(partial(self._take, seen), seen)

    def _take_posted(self, handler: Callable[[], None]) -> None:
        if self._is_awake():
            handler()
        else:
            self._hold(handler, is_old=True)

    def _rings(self, timer: _Timer) -> None:
        if self._is_awake():
            self._looked = self._read_clocks()
            if timer in self._timers:  # by a damaged recording one may ring twice
                self._timers.remove(timer)
            timer.handler()

    def _is_awake(self) -> bool:
        """Whether what comes is handed over now: not just after a standstill."""
        monotonic_ns = self._read_monotonic()
        passed_ns, self._monotonic_ns = monotonic_ns - self._monotonic_ns, monotonic_ns
        if passed_ns > self._limit_ns:
            self._wake(passed_ns)
        return self._held is None

    def _hold(
        self, call: Callable[[], None], seen: Observation | None = None, is_old: bool = False
    ) -> None:
        held = self._held
        if held is None:  # the monitor has begun anew just now
            call()
            return
        held.append(_Held(*self._read_clocks(), call, seen, is_old))
        if len(held) > MAX_HELD:
            self.begin_anew()

    # --- a standstill ------------------------------------------------------------------------------

    def _read_clocks(self) -> tuple[int, int]:
        return read_together(self._home_now_ns, self._read_monotonic)

    def _set_ns(self) -> int:
        """By how much the time of day was set since the last turn (ns)."""
        now_ns, monotonic_ns = self._read_clocks()
        return now_ns - self._looked[0] - (monotonic_ns - self._looked[1])

    def _wake(self, passed_ns: int) -> None:
        """The monitor did nothing for ``passed_ns``."""
        now_ns, woke_ns = self._read_clocks()
        passed_ns += woke_ns - self._monotonic_ns
        self._monotonic_ns = woke_ns
        if self._held is not None:  # once more
            self._still = self._still[0], now_ns
            self._ask()
            return
        from_ns = now_ns - passed_ns
        if self._tap is None or passed_ns > LATEST_NS or abs(self._set_ns()) > SET_NS:
            return
        self._still, self._woke_at = (from_ns, now_ns), (now_ns, woke_ns)
        self._held, self._has_changed = [], False
        for timer in self._timers:
            timer.disarm()
        for name, since_ns in self._up.items():
            self._up[name] = self._home.up_since(name) or since_ns  # 0: it has gone since
        self._look_soon()
        self._ask()

    def _ask(self) -> None:
        """What was asked before it woke says nothing of what happened until then."""
        self._answers.clear()
        self._asked = self._woke()

    def _look_soon(self) -> None:
        self._looks = self._home.after(USUAL_GAP_NS / NS, self._look)

    def _look(self) -> None:
        self._is_awake()
        if self._held is None:
            return
        now_ns, (from_ns, woke_ns) = self._home_now_ns(), self._still
        enough_ns = woke_ns + self._latency_ns + round(self.repair_s * NS)
        if woke_ns > from_ns + LATEST_NS or now_ns > enough_ns + ANSWERED_NS:
            self.begin_anew()
        elif now_ns < enough_ns or not all(name in self._answers for name in self._asked):
            self._look_soon()
        elif self._is_nothing_missing():
            self._catch_up()
        else:
            self.begin_anew()

    def _is_nothing_missing(self) -> bool:
        assert self._tap is not None
        assert self._held is not None
        is_as_before = not self._has_changed and abs(self._set_ns()) <= SET_NS
        if not is_as_before or self._tap.take_dropped():
            return False
        if any(self._home.up_since(name) != since_ns for name, since_ns in self._up.items()):
            return False
        seen = [held.seen for held in self._held if held.seen is not None]
        return self._is_whole(Backlog(seen, self._answers))

    # --- what has waited is handed over --------------------------------------------------------------

    def _catch_up(self) -> None:
        """All is there up to now: hand it over in the order in which it happened."""
        from_ns, until_ns = self._still
        now_ns, monotonic_ns = self._read_clocks()
        ahead_ns = now_ns - monotonic_ns
        for at_ns, call in self._in_order():
            self._hand_over(call, at_ns - ahead_ns, ahead_ns)
        self._pass_to(monotonic_ns, ahead_ns)
        self._end_backlog()
        stood_s = (until_ns - from_ns) / NS
        waited = "what has waited was judged afterwards"
        self._say(f"note: this monitor stood still for {stood_s:.1f} s; {waited}")

    def _in_order(self) -> list[tuple[int, Callable[[], None]]]:
        """When each was to be received (ns), in that order."""
        from_ns, until_ns = self._still
        newest: dict[tuple[str, str, bool], int] = {}
        found: list[tuple[int, Callable[[], None]]] = []
        for held in self._held or ():
            at_ns, call, seen = held.now_ns, held.call, held.seen
            if seen is not None:
                if seen.stamp_ns <= until_ns:
                    at_ns = max(from_ns, seen.stamp_ns)
                place = seen.source, seen.channel, seen.kind is ObservationKind.MESSAGE
                at_ns = newest[place] = max(at_ns, newest.get(place, 0))
                call = partial(self._take, replace(seen, received_ns=at_ns))
            elif held.is_old:
                at_ns = from_ns
            found.append((at_ns, call))
        return sorted(found, key=_when)

    def begin_anew(self) -> None:
        """Hand over what came when it came, if something is held: the monitor sees that it stood still."""
        if self._held is None:
            return
        self._shown = self._woke_at
        for one in self._held:
            self._hand_over(one.call, one.monotonic_ns, one.now_ns - one.monotonic_ns)
        now_ns, monotonic_ns = self._read_clocks()
        self._pass_to(monotonic_ns, now_ns - monotonic_ns)
        self._end_backlog()

    def _hand_over(self, call: Callable[[], None], at_ns: int, ahead_ns: int) -> None:
        self._pass_to(at_ns, ahead_ns)
        call()
        self._run_posted()

    def _pass_to(self, at_ns: int, ahead_ns: int) -> None:
        """Time passes to ``at_ns`` of the clock that nobody sets; the time of day is so much ahead of it."""
        while self._timers:
            timer = min(self._timers, key=_due)
            if timer.due_ns > at_ns:
                break
            self._show(timer.due_ns, ahead_ns)
            self._timers.remove(timer)
            timer.handler()
            self._run_posted()
        self._show(at_ns, ahead_ns)

    def _show(self, at_ns: int, ahead_ns: int) -> None:
        at_ns = at_ns if self._shown is None else max(at_ns, self._shown[1])
        self._shown = at_ns + ahead_ns, at_ns

    def _run_posted(self) -> None:
        while self._posted:
            self._posted.popleft()()

    def _end_backlog(self) -> None:
        self._held, self._shown = None, None
        if self._looks is not None:
            self._looks.cancel()
        self._look_at_clocks()
        for timer in self._timers:
            timer.arm(self._home, self._monotonic_ns, self._rings)


def _nothing(_: Observation) -> None:
    pass


def _when(item: tuple[int, Callable[[], None]]) -> int:
    return item[0]


def _due(timer: _Timer) -> int:
    return timer.due_ns
