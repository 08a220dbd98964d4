"""Following a policy's calls with all runs of its tree that they may come from."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable
from enum import Enum

from m2c.policy.program import Leaf, Policy
from moon.policy.memories import Memories, memories_of
from moon.policy.remembered import RememberedRun, RememberedTree
from moon.policy.run import BEGIN, Ask, AskKind, TreeRun, Trees
from moon.policy.shape import Shape

MAX_RUNS = 64
"""Runs followed at once."""

MAX_SILENT = 128
"""Steps looked at between two calls: what plugins and the clock may have answered meanwhile."""

MAX_TAKEN = 1024
"""Steps that a run can be led along again to fork it."""

_DRIFT = 0.001
"""Clocks may run apart by this part; no computer's does by as much (NTP slews by 0.05 %)."""


Run = TreeRun | RememberedRun


class TooManyError(Exception):
    """More could have happened than is followed; the text says what."""


class Fit(Enum):
    """How a call fits what is known."""

    EXPECTED = 0
    UNKNOWN = 1
    """Nothing is known yet that it could contradict."""
    WRONG = 2


Stop = tuple[Leaf, ...]
"""The tree is being halted, as when the policy ends: these leaves' halts are still to come."""


class Follower:
    """The runs of a policy's tree that explain what was observed.

    Args:
        policy: the tree.
        shape: what it is like.
        rate_hz: at which it is ticked; 0 if that is not known.
        tolerance_ns: a tick may come by this too early.

    Attributes:
        runs: each stands where the policy may stand.
        certain: whether the policy is among ``runs``.
        wanted: after a call that is wrong, what would have been right.
        early_ns: after a call that is only too early, how much; else 0.
    """

    def __init__(self, policy: Policy, shape: Shape, rate_hz: float, tolerance_ns: int) -> None:
        self._shape = shape
        self._trees = Trees(policy, shape.hidden, records=shape.is_open and not shape.plain)
        self._remembered = RememberedTree(self._trees) if shape.plain else None
        self._period_ns = round(1e9 / rate_hz * (1 - _DRIFT)) if rate_hz > 0 else 0
        self._tolerance_ns = tolerance_ns
        self._memories: Memories | None = None
        self._explored = False
        self._ticked: Counter[str] = Counter()
        """Ticks of each channel since nothing was known."""
        self._stops: list[Stop] = []
        self._last_ns = 0
        self.runs: list[Run] = []
        self.certain = False
        self.wanted: list[Ask] = []
        self.early_ns = 0

    def start(self) -> None:
        """The policy starts: its tree is fresh."""
        self.forget()
        self.runs = [self._fresh_run()]
        self.certain = True

    def _fresh_run(self) -> Run:
        return TreeRun(self._trees) if self._remembered is None else self._remembered.start()

    def forget(self) -> None:
        """Nothing is known any more."""
        _close(self.runs)
        self.runs = []
        self._stops = []
        self._ticked.clear()
        self.certain = False

    def close(self) -> None:
        """End the threads of all trees."""
        self.forget()
        if self._remembered is not None:
            self._remembered.close()

    # --- what is observed --------------------------------------------------------------------------

    def called(self, channel: str, stamp_ns: int) -> Fit:
        """The policy calls ``channel``: keep the runs that do so next.

        Raises:
            TooManyError: too much could have happened since the last call.
        """
        self.wanted, self.early_ns = [], 0
        only = self.runs[0] if self.certain and len(self.runs) == 1 and not self._stops else None
        if only is not None and only.ask.channel == channel:  # as nearly always
            self._last_ns = stamp_ns
            return Fit.EXPECTED
        if not self.certain:
            self._assume_a_tick(channel)
        before = self.runs
        stops = [_without(stop, channel) for stop in self._stops]
        stops += [_without(_halts(run), channel) for run in before if run.ask.kind is AskKind.END]
        self.runs = []
        self._stops = [stop for stop in stops if stop is not None]
        try:
            self.runs = self._doing(before, channel, stamp_ns)
        finally:
            kept = {id(run) for run in self.runs}
            _close(run for run in before if id(run) not in kept)
        if self.runs or self._stops:
            self._last_ns = stamp_ns
        if not self.certain:
            return self._note_certainty(channel)
        return Fit.EXPECTED if self.runs or self._stops else Fit.WRONG

    def answered(self, status: str, stamp_ns: int) -> None:
        """The call was answered with ``status`` (of a halt: any text)."""
        self._last_ns = stamp_ns
        for run in self.runs:
            self._step(run, status)
        self._merge()

    def owes(self) -> list[Ask]:
        """The calls one of which the policy has to make now, whatever is not observed; [] if none."""
        asks = [run.ask for run in self.runs]
        if (
            not self.certain
            or self._stops
            or any(ask.kind in (AskKind.END, AskKind.OPEN) for ask in asks)
        ):
            return []
        return asks

    # --- following ---------------------------------------------------------------------------------

    def _doing(self, runs: list[Run], channel: str, stamp_ns: int) -> list[Run]:
        """The runs that call ``channel`` at ``stamp_ns``, after what may happen unobserved before it."""
        found: dict[object, Run] = {}
        seen: dict[object, int] = {}
        made: list[Run] = []
        waiting = deque((run, 0) for run in runs)  # and how many ticks have begun meanwhile
        silent = 0
        try:
            while waiting:
                run, begun = waiting.popleft()
                ask = run.ask
                if ask.channel:
                    if ask.channel != channel:
                        self._want(ask)
                    elif begun and run.due_ns > stamp_ns + self._tolerance_ns:
                        self.early_ns = max(self.early_ns, run.due_ns - stamp_ns)
                        self._want(ask)
                    else:
                        key = run.key if self._shape.plain else id(run)
                        other = found.setdefault(key, run)
                        other.due_ns = min(other.due_ns, run.due_ns)
                    continue
                silent += 1
                if silent > MAX_SILENT:
                    raise TooManyError("too much can have happened between two calls, unobserved")
                if self._shape.plain:
                    key = (run.key, begun > 0)
                    if key in seen and seen[key] <= run.due_ns:
                        continue
                    seen[key] = run.due_ns
                if ask.kind is AskKind.END:
                    if begun and run.due_ns > stamp_ns + self._tolerance_ns:
                        continue  # after a tick that was not observed, there is no time for another
                    self._step(run, BEGIN)
                    waiting.append((run, begun + 1))
                    continue
                for choice in ask.choices[1:]:
                    if len(run.taken) > MAX_TAKEN:
                        raise TooManyError("the tree remembers more than can be followed")
                    other = run.fork()
                    made.append(other)
                    self._step(other, choice)
                    waiting.append((other, begun))
                self._step(run, ask.choices[0])
                waiting.append((run, begun))
            if len(found) > MAX_RUNS:
                raise TooManyError("too many possibilities to follow")
        except TooManyError:
            found = {}
            raise
        finally:
            kept = {id(run) for run in found.values()}
            _close(run for run in made if id(run) not in kept)
        return list(found.values())

    def _step(self, run: Run, answer: str) -> None:
        run.step(answer)
        if run.ask.kind is not AskKind.END:
            return
        # the next tick is due a period after this one was, or now if that is past
        run.due_ns = max(run.due_ns + self._period_ns, self._last_ns) if self._period_ns else 0
        if not self._shape.is_open:
            run.taken.clear()  # it is never forked

    def _want(self, ask: Ask) -> None:
        if ask not in self.wanted:
            self.wanted.append(ask)

    def _merge(self) -> None:
        if not self._shape.plain or len(self.runs) < 2:
            return
        found: dict[object, Run] = {}
        for run in self.runs:
            other = found.setdefault(run.key, run)
            other.due_ns = min(other.due_ns, run.due_ns)
        kept = {id(run) for run in found.values()}
        _close(run for run in self.runs if id(run) not in kept)
        self.runs = list(found.values())

    # --- resynchronisation -------------------------------------------------------------------------

    def _explore(self) -> Memories | None:
        if not self._explored:
            self._explored = True
            if self._remembered is not None:
                self._memories = memories_of(self._remembered)
        return self._memories

    def _assume_a_tick(self, channel: str) -> None:
        """A tick may begin with the call that comes now, whatever the tree remembers."""
        memories = self._explore()
        if memories is None:
            return
        for memory, steps in memories.steps.items():
            first = memories.first.get(memory)
            if first is not None and first.channel != channel:
                continue
            run = self._fresh_run()
            run.follow(steps)
            self.runs.append(run)

    def _note_certainty(self, channel: str) -> Fit:
        """Whether a tick has begun, for certain, with one of the calls since nothing was known.

        In one tick a plain tree ticks each of its leaves at most once. So when a channel is ticked
        more often than the tree has places for it, a tick has begun in between, and for each call
        it was assumed that it does.
        """
        memories = self._explore()
        if memories is None:
            return Fit.UNKNOWN
        self._ticked[channel] += 1
        self.certain = (
            channel in memories.places and self._ticked[channel] > memories.places[channel]
        )
        if not self.certain:
            return Fit.UNKNOWN
        return Fit.EXPECTED if self.runs or self._stops else Fit.WRONG


def _halts(run: Run) -> Stop:
    return tuple(leaf for leaf in run.running.values() if leaf.halt)


def _without(stop: Stop, channel: str) -> Stop | None:
    """``stop`` after the halt on ``channel``; None if it does not call it."""
    for place, leaf in enumerate(stop):
        if leaf.halt == channel:
            return (*stop[:place], *stop[place + 1 :])
    return None


def _close(runs: Iterable[Run]) -> None:
    for run in runs:
        run.close()
