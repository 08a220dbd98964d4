"""Following a policy's calls with all runs of its tree that they may come from.

The tree is a plain one (``moon.policy.shape``): there are few memories, and runs that go on alike are one.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable
from enum import Enum
from typing import Protocol

from m2c.policy.program import Leaf, Policy
from moon.policy.memories import Memories, memories_of
from moon.policy.remembered import RememberedRun, RememberedTree
from moon.policy.run import BEGIN, Ask, AskKind, TreePath, Trees
from moon.policy.shape import Shape

MAX_RUNS = 64
"""Runs followed at once."""

MAX_SILENT = 128
"""Steps looked at between two calls: what plugins and the clock may have answered meanwhile."""

_DRIFT = 0.001
"""Clocks may run apart by this part; no computer's does by as much (NTP slews by 0.05 %)."""


class Run(Protocol):
    """A run of a policy's tree, as far as it is looked at from outside."""

    @property
    def ask(self) -> Ask:
        """What it waits for."""
        ...

    @property
    def running(self) -> dict[TreePath, Leaf]:
        """The leaves that are RUNNING, and how each is called."""
        ...


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
    """The runs of a plain tree that explain what was observed.

    Args:
        policy: the tree.
        shape: what it is like: plain.
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
        self._remembered = RememberedTree(Trees(policy, shape.hidden, records=False))
        self._period_ns = period_of(rate_hz)
        self._tolerance_ns = tolerance_ns
        self._memories: Memories | None = None
        self._explored = False
        self._ticked: Counter[str] = Counter()
        """Ticks of each channel since nothing was known."""
        self._stops: list[Stop] = []
        self._last_ns = 0
        self.runs: list[RememberedRun] = []
        self.certain = False
        self.wanted: list[Ask] = []
        self.early_ns = 0

    def start(self) -> None:
        """The policy starts: its tree is fresh."""
        self.forget()
        self.runs = [self._remembered.start()]
        self.certain = True

    def forget(self) -> None:
        """Nothing is known any more."""
        self.runs = []
        self._stops = []
        self._ticked.clear()
        self.certain = False

    def close(self) -> None:
        """End the threads of all trees."""
        self.forget()
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
        at_end = [halts_of(run) for run in before if run.ask.kind is AskKind.END]
        self._stops = after_a_halt([*self._stops, *at_end], channel)
        self.runs = []
        self.runs = self._doing(before, channel, stamp_ns)
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

    def _doing(self, runs: list[RememberedRun], channel: str, stamp_ns: int) -> list[RememberedRun]:
        """The runs that call ``channel`` at ``stamp_ns``, after what may happen unobserved before it."""
        found: dict[object, RememberedRun] = {}
        seen: dict[object, int] = {}
        waiting = deque((run, 0) for run in runs)  # and how many ticks have begun meanwhile
        silent = 0
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
                    other = found.setdefault(run.key, run)
                    other.due_ns = min(other.due_ns, run.due_ns)
                continue
            silent += 1
            if silent > MAX_SILENT:
                raise TooManyError("too much can have happened between two calls, unobserved")
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
                other = run.fork()
                self._step(other, choice)
                waiting.append((other, begun))
            self._step(run, ask.choices[0])
            waiting.append((run, begun))
        if len(found) > MAX_RUNS:
            raise TooManyError("too many possibilities to follow")
        return list(found.values())

    def _step(self, run: RememberedRun, answer: str) -> None:
        run.step(answer)
        if run.ask.kind is AskKind.END:
            run.due_ns = next_due_ns(run.due_ns, self._period_ns, self._last_ns)

    def _want(self, ask: Ask) -> None:
        if ask not in self.wanted:
            self.wanted.append(ask)

    def _merge(self) -> None:
        if len(self.runs) < 2:
            return
        found: dict[object, RememberedRun] = {}
        for run in self.runs:
            other = found.setdefault(run.key, run)
            other.due_ns = min(other.due_ns, run.due_ns)
        self.runs = list(found.values())

    # --- resynchronisation -------------------------------------------------------------------------

    def _explore(self) -> Memories | None:
        if not self._explored:
            self._explored = True
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
            run = self._remembered.start()
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


def period_of(rate_hz: float) -> int:
    """The time that is certainly between two ticks that are due (ns); 0 if it is not known."""
    return round(1e9 / rate_hz * (1 - _DRIFT)) if rate_hz > 0 else 0


def next_due_ns(due_ns: int, period_ns: int, over_ns: int) -> int:
    """The next tick is due a period after this one was, or when this one was over if that is later."""
    return max(due_ns + period_ns, over_ns) if period_ns else 0


def halts_of(run: Run) -> Stop:
    """What is halted if the policy ends now."""
    return tuple(leaf for leaf in run.running.values() if leaf.halt)


def after_a_halt(stops: Iterable[Stop], channel: str) -> list[Stop]:
    """Those of ``stops`` that halt on ``channel`` next, after they did."""
    return [after for stop in stops if (after := _without(stop, channel)) is not None]


def _without(stop: Stop, channel: str) -> Stop | None:
    """``stop`` after the halt on ``channel``; None if it does not call it."""
    for place, leaf in enumerate(stop):
        if leaf.halt == channel:
            return (*stop[:place], *stop[place + 1 :])
    return None
