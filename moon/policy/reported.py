"""Following a policy's calls with one run of its tree, by the ticks that the policy reports.

A tree that remembers more than what is RUNNING (a count, a value on the blackboard) cannot be followed in
all that it may have done unobserved: there is no end of that. But the policy publishes each tick
(``m2c.policy.ticks``), with what no call shows: what its plugins answered and wrote, and whether the time
of a ``Sleep``, ``Delay`` or ``Timeout`` was over. So there is one run. Where it asks something of which no
call says the answer, it waits for the report of its tick; all that the policy calls until then is judged as
soon as that is received.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence

import msgspec

from m2c.policy.program import Leaf, Policy
from m2c.policy.ticking import written_value
from m2c.policy.ticks import HALTED, LeafTick, TreeTick
from moon.policy.follow import (
    MAX_SILENT,
    Fit,
    Run,
    Stop,
    after_a_halt,
    halts_of,
    next_due_ns,
    period_of,
)
from moon.policy.run import BEGIN, ELAPSED, WAITING, Ask, AskKind, TreeRun, Trees, Written
from moon.policy.shape import Shape
from transports.interface import Observation

_ENDED = ("SUCCESS", "FAILURE")


def report_of(observation: Observation) -> TreeTick | None:
    """The tick that the policy published; None if it cannot be read, or lacks what no call shows."""
    data = observation.data
    if not isinstance(data, Mapping):
        return None
    leaves = data.get("leaves")
    if not isinstance(leaves, Sequence) or not all("elapsed" in leaf for leaf in leaves):
        return None  # an earlier m2c's
    try:
        return msgspec.convert(data, TreeTick)
    except msgspec.ValidationError:
        return None


class ReportedFollower:
    """The run of a tree of any shape that explains what was observed.

    Args:
        policy: the tree.
        shape: what it is like.
        rate_hz: at which it is ticked; 0 if that is not known.
        tolerance_ns: a tick may come by this too early.

    Attributes:
        wanted: after a call that is wrong, what would have been right.
        early_ns: after a call that is only too early, how much; else 0.
    """

    def __init__(self, policy: Policy, shape: Shape, rate_hz: float, tolerance_ns: int) -> None:
        self._trees = Trees(policy, shape.hidden, records=True)
        self._period_ns = period_of(rate_hz)
        self._tolerance_ns = tolerance_ns
        self._forgets = shape.forgets
        self._open = {
            leaf.name: leaf
            for leaf in policy.leaves
            if leaf.plugin or leaf.timed or leaf.tick in shape.hidden
        }
        self._run: TreeRun | None = None
        self._stops: list[Stop] = []
        self._instead: list[Ask] = []
        """What the run would have done, where the calls were another's: the policy ends."""
        self._last_ns = 0
        self._is_reported = False
        """Whether the policy is known to report its ticks."""
        self._report: TreeTick | None = None
        """Of the tick that is going on, once it was received."""
        self._ticked: deque[LeafTick] = deque()
        """The ticks of leaves in it that were not asked for yet, of those that no call shows."""
        self._halted: deque[LeafTick] = deque()
        """Likewise the halts of plugins that write to the blackboard."""
        self._is_ticking = False
        """Whether a tick has begun of which no report was received."""
        self._is_first = False
        """Whether the next call is the first one of its tick."""
        self.wanted: list[Ask] = []
        self.early_ns = 0

    @property
    def runs(self) -> Sequence[Run]:
        """Where the policy stands."""
        return () if self._run is None else (self._run,)

    @property
    def certain(self) -> bool:
        """Whether that is known."""
        return self._run is not None or bool(self._stops)

    def start(self) -> None:
        """The policy starts: its tree is fresh."""
        self.forget()
        self._run = TreeRun(self._trees)

    def forget(self) -> None:
        """Nothing is known any more."""
        if self._run is not None:
            self._run.close()
        self._run = self._report = None
        self._stops = []
        self._is_ticking = self._is_first = False

    def close(self) -> None:
        """End the thread of the tree."""
        self.forget()

    # --- what is observed --------------------------------------------------------------------------

    def waits(self) -> bool:
        """Whether it takes the report of a tick to say if a call that comes now is right.

        A tick begins with the call if none is going on.
        """
        run = self._run
        if run is None:
            return False
        if run.ask.kind is AskKind.END:
            if self._is_reported and self._is_ticking:
                return (
                    self._report is None
                )  # that a call is one too many is certain with the report
            self._stops = [stop for stop in (halts_of(run),) if stop]
            self._begin(1 if self._is_reported else MAX_SILENT)
        return run.ask.kind is AskKind.OPEN

    def called(self, channel: str, stamp_ns: int) -> Fit:
        """The policy calls ``channel``, and the run does not wait for a report (:meth:`waits`)."""
        self.wanted, self.early_ns = [], 0
        if not self.certain:
            return Fit.UNKNOWN
        self._stops = after_a_halt(self._stops, channel)
        run = self._run
        if run is not None and not self._calls(run, channel, stamp_ns):
            self.wanted = self._instead = [run.ask] if run.ask.channel else []
            run.close()
            self._run = None
        self._is_first = False
        self._last_ns = stamp_ns
        return Fit.EXPECTED if self.certain else Fit.WRONG

    def answered(self, status: str, stamp_ns: int) -> None:
        """The call was answered with ``status`` (of a halt: any text)."""
        self._last_ns = stamp_ns
        if self._run is not None and self._run.ask.channel:
            self._step(self._run, status)
            self._go_on()

    def owes(self) -> list[Ask]:
        """The call that the policy has to make now, whatever is not observed; [] if none."""
        run = self._run
        return [] if run is None or self._stops or not run.ask.channel else [run.ask]

    def reported(self, report: TreeTick) -> None:
        """The tick that is going on, or one that called nobody, is over as ``report`` says.

        Raises:
            ValueError: a plugin of the policy cannot have written what it says.
        """
        self._is_reported = True
        self._report = report
        unseen = [leaf for leaf in report.leaves if leaf.name in self._open]
        self._ticked = deque(leaf for leaf in unseen if leaf.status != HALTED)
        self._halted = deque(
            leaf for leaf in unseen if leaf.status == HALTED and self._open[leaf.name].outputs
        )
        if self._run is not None and self._run.ask.kind is AskKind.END and not self._is_ticking:
            self._begin(1)
        self._go_on()

    def over(self, stamp_ns: int) -> str:
        """All that was called until the report, at ``stamp_ns``, was judged.

        Returns:
            What the policy did that it should not, in words; ``wanted`` says what is right, if anything is.
        """
        report, run = self._report, self._run
        is_ending, self._stops = bool(self._stops), []
        self._report = None
        self._is_ticking = self._is_first = False
        self._last_ns = stamp_ns
        self.wanted, self.early_ns = [], 0
        if report is None:
            return ""
        if run is None:
            if is_ending:
                self.wanted = self._instead
                return "the end of the tick"
            if self._forgets and report.status in _ENDED:
                self.start()  # the next tick is as the first one
            return ""
        if run.ask.kind is not AskKind.END:
            self.wanted = [run.ask]
            left = self._left(run.ask) if run.ask.kind is AskKind.OPEN else None
            return f"tick {left[0].name}" if left else "the end of the tick"
        if self._ticked or self._halted:
            first = (*self._ticked, *self._halted)[0]
            return f"{'halt' if first.status == HALTED else 'tick'} {first.name}"
        run.due_ns = max(run.due_ns, stamp_ns) if self._period_ns else 0
        if run.ask.status != report.status:
            self.wanted = [run.ask]
            return f"a tick that ends with {report.status}"
        return ""

    # --- following ---------------------------------------------------------------------------------

    def _begin(self, most: int) -> None:
        """A tick begins; while it calls nobody and is over, up to ``most`` do."""
        run = self._run
        assert run is not None
        for _ in range(most):
            self._step(run, BEGIN)
            if run.ask.kind is not AskKind.END:
                break
        self._is_ticking = self._is_first = True

    def _calls(self, run: TreeRun, channel: str, stamp_ns: int) -> bool:
        if run.ask.channel != channel:
            return False
        if self._is_first and run.due_ns > stamp_ns + self._tolerance_ns:
            self.early_ns = run.due_ns - stamp_ns
        return not self.early_ns

    def _step(self, run: TreeRun, answer: str, written: Sequence[Written] = ()) -> None:
        run.step(answer, written)
        if run.ask.kind is AskKind.END:
            run.due_ns = next_due_ns(run.due_ns, self._period_ns, self._last_ns)

    def _go_on(self) -> None:
        """Answer what no call shows, as far as it was reported."""
        run = self._run
        while run is not None and self._report is not None and run.ask.kind is AskKind.OPEN:
            leaf, left = run.ask.leaf, self._left(run.ask)
            if leaf is None or not left or left[0].name != leaf.name:
                return
            said = left.popleft()
            self._step(run, _answer(leaf, said, run.ask), _written(leaf, said))

    def _left(self, ask: Ask) -> deque[LeafTick]:
        """Where the report answers ``ask``."""
        return self._halted if ask.choices == (HALTED,) else self._ticked


def _answer(leaf: Leaf, said: LeafTick, ask: Ask) -> str:
    if leaf.timed:
        return ELAPSED if said.elapsed else WAITING
    return said.status if said.status in ask.choices else "FAILURE"


def _written(leaf: Leaf, said: LeafTick) -> list[Written]:
    ports = {port.key: port for port in leaf.outputs}
    for output in said.outputs:
        if output.key not in ports:
            raise ValueError(f"{leaf.name} has no output port {output.key}")
    return [(ports[o.key], written_value(ports[o.key], o.value)) for o in said.outputs]
