"""One run of the very tree of a policy, answer by answer.

BehaviorTree.CPP calls a leaf and wants its status at once; here the status is what was observed, later.
So the tree is ticked on a thread of its own that stands still in the leaf until the answer is known.
Threads are used for their stacks alone: whoever asks a run to go on waits until it stands still again.
"""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from enum import Enum
from typing import Any

import msgspec

from m2c.policy.controls import Control
from m2c.policy.library import PolicyError, TreeFactory
from m2c.policy.plugins import PortValue
from m2c.policy.program import Leaf, Policy
from m2c.policy.ticking import (
    NODE_STATUSES,
    Children,
    Nesting,
    PortError,
    TreeNode,
    tick_tree,
    write_port,
)
from m2c.policy.ticks import HALTED

TreePath = tuple[int, ...]
"""A node of the tree: its number in its tree, after those of the nodes with trees for their children that it
stands under, each with the number of the child."""

Written = tuple[PortValue, object]
"""A port that a plugin wrote, and the value."""

BEGIN = ""
"""The answer to the end of a tick: the next one begins."""

ELAPSED, WAITING = "elapsed", "waiting"
"""What the clock may have answered a ``Sleep``, ``Delay`` or ``Timeout``."""


class AskKind(Enum):
    """What a run waits for."""

    TICK = "tick"
    """The status that the leaf's tick service answers."""
    HALT = "halt"
    """The answer of the leaf's halt service."""
    OPEN = "open"
    """Something that cannot be observed: what a plugin or the clock answers."""
    END = "end"
    """The tick is over; ``status`` is the tree's."""


class Ask(msgspec.Struct, frozen=True):
    """What a run waits for, and where in the tree.

    Attributes:
        choices: the answers that can be, if it cannot be observed.
        status: the tree's, at the end of a tick.
        channel: the service that is called; "" if none is.
    """

    kind: AskKind
    leaf: Leaf | None = None
    place: TreePath = ()
    choices: tuple[str, ...] = ()
    status: str = ""
    channel: str = ""


_OUTCOMES = ("SUCCESS", "FAILURE", "RUNNING")
_thread = threading.local()


class Trees:
    """Makes trees of one policy; all its runs share it.

    Args:
        policy: the tree and its leaves.
        hidden: channels that plugins of the policy call too: observations there say nothing of a leaf.
        records: whether the policy's records of its ticks answer what no call shows. Then a run asks at each
            tick of a timed node, and what a halted plugin wrote.
    """

    def __init__(self, policy: Policy, hidden: frozenset[str], records: bool) -> None:
        import behaviortreepy

        self.policy = policy
        self.hidden = hidden
        self.records = records
        self.statuses = {name: getattr(behaviortreepy.NodeStatus, name) for name in NODE_STATUSES}
        self.factory = TreeFactory()
        for leaf in policy.leaves:
            halt = _halt_of(leaf) if leaf.action else None
            self.factory.register(leaf.id, _tick_of(leaf, self.statuses), halt)
        self.factory.load(policy.xml)
        self.factory.create_tree(policy.main)


# The callbacks know neither their run nor its trees: they find the run by the thread that they are called on.
# Python cannot see references that go through C++: what a callback knows, and has the tree, is kept for ever.


def _tick_of(leaf: Leaf, statuses: Mapping[str, Any]) -> Callable[[TreeNode], Any]:
    def tick(node: TreeNode) -> Any:
        run: TreeRun | None = getattr(_thread, "run", None)
        return statuses["FAILURE" if run is None else run.tick_leaf(leaf, node)]

    return tick


def _halt_of(leaf: Leaf) -> Callable[[TreeNode], None]:
    def halt(node: TreeNode) -> None:
        run: TreeRun | None = getattr(_thread, "run", None)
        if run is not None:  # a tree that is thrown away halts itself
            run.halt_leaf(leaf, node)

    return halt


class Life:
    """Of something that has runs: when it is thrown away, so is this, and ``end`` is called."""

    def __init__(self, end: Callable[[], None]) -> None:
        weakref.finalize(self, end)


class _AskedClock:
    """The clock of one node that waits: whether its time is over is asked."""

    def __init__(self, run: TreeRun, leaf: Leaf, place: TreePath) -> None:
        self._run = weakref.ref(run)
        self._ask = Ask(AskKind.OPEN, leaf, place, (ELAPSED, WAITING))
        self._is_over = False

    def start(self, delay_s: float) -> None:
        self._is_over = False

    def is_over(self) -> bool:
        run = self._run()
        if run is not None and not (self._is_over and run.knows_the_time):
            self._is_over = run.asks(self._ask) == ELAPSED
        return self._is_over

    def stop(self) -> None:
        self._is_over = False


class TreeRun:
    """One tree being ticked. It stands still at ``ask`` until :meth:`step`.

    Attributes:
        ask: what it waits for.
        memory: the leaves that were RUNNING when the tick began.
        running: those that are now, and how each is called.
        due_ns: the tree is not ticked again before.
    """

    def __init__(self, trees: Trees) -> None:
        self._trees = trees
        self._controls: dict[TreePath, Control] = {}
        self._nesting = Nesting(trees.factory)
        self.knows_the_time = not trees.records
        """Whether a node that waits asks no more once its time was over."""
        self._tree: Any = trees.factory.create_tree(trees.policy.main)
        self._answer = BEGIN
        self._written: Sequence[Written] = ()
        self._abandoned = False
        self._error: BaseException | None = None
        # locks as semaphores of one: the two sides take turns, thirty times a second of a tour
        self._go = threading.Lock()
        self._go.acquire()
        self._back = threading.Lock()
        self._back.acquire()
        self._thread: threading.Thread | None = None
        self.ask = Ask(AskKind.END)
        self.memory: frozenset[TreePath] = frozenset()
        self.running: dict[TreePath, Leaf] = {}
        self.due_ns = 0

    # --- the watcher's side ------------------------------------------------------------------------

    def step(self, answer: str, written: Sequence[Written] = ()) -> Ask:
        """Answer ``ask`` and go on to the next one.

        Args:
            answer: the status that was asked for, or what the clock said.
            written: what the plugin that is asked wrote to the blackboard, in order.
        """
        if self.ask.kind is AskKind.END:
            self.memory = frozenset(self.running)
        self._answer, self._written = answer, written
        if self._thread is None:
            self._thread = threading.Thread(target=self._work, name="policy run", daemon=True)
            self._thread.start()
        self._go.release()
        self._back.acquire()
        if self._error is not None:
            error, self._error = self._error, None
            raise error
        return self.ask

    def follow(self, steps: Sequence[str]) -> None:
        """Take ``steps``, from a fresh tree."""
        for step in steps:
            self.step(step)

    @property
    def key(self) -> object:
        """Two runs of a tree that remembers only its RUNNING leaves go on alike if this is equal."""
        return (self.memory, self.ask.kind, self.ask.place, frozenset(self.running))

    def close(self) -> None:
        """Throw the run away; its thread ends."""
        if self._thread is not None and not self._abandoned:
            self._abandoned = True
            self._go.release()
            self._thread.join()

    def __del__(self) -> None:
        """The tree goes, and halts what is RUNNING in it: that is nothing to the run on whose thread it does.

        Garbage is collected on whatever thread it is noticed, for instance another run's.
        """
        other, _thread.run = getattr(_thread, "run", None), None
        try:
            self._controls = {}
            self._tree = None
        finally:
            _thread.run = other

    # --- the tree's side ---------------------------------------------------------------------------

    def _work(self) -> None:
        _thread.run = self
        self._go.acquire()
        try:
            while not self._abandoned:
                self._nesting.retries = 0
                try:
                    status = tick_tree(self._tree)
                except PolicyError:
                    status = "ERROR"  # the policy halts its tree then, and ends
                self.asks(Ask(AskKind.END, status=status))
        except BaseException as error:  # raised again by ``step``
            self._error = error
            self._back.release()
        finally:
            _thread.run = None

    def asks(self, ask: Ask) -> str:
        """Stand still at ``ask``; its answer."""
        if not self._abandoned:
            self.ask = ask
            self._back.release()
            self._go.acquire()
        return "FAILURE" if self._abandoned else self._answer

    def tick_leaf(self, leaf: Leaf, node: TreeNode) -> str:
        """The status of ``leaf``, which the tree ticks at ``node``."""
        place = self._place(node)
        if leaf.built_in:
            status = self._tick_control(leaf, node, place)
        elif leaf.plugin or leaf.tick in self._trees.hidden:
            choices = _OUTCOMES if leaf.action else _OUTCOMES[:2]
            status = self.asks(Ask(AskKind.OPEN, leaf, place, choices))
            self._write(node)
        else:
            status = self.asks(Ask(AskKind.TICK, leaf, place, channel=leaf.tick))
        allowed = NODE_STATUSES if leaf.built_in else _OUTCOMES
        if status not in allowed or (status == "RUNNING" and not leaf.action):
            status = "FAILURE"  # as the policy takes it
        if status == "RUNNING":
            self.running[place] = leaf
        else:
            self.running.pop(place, None)
        return status

    def halt_leaf(self, leaf: Leaf, node: TreeNode) -> None:
        """The tree halts ``leaf`` at ``node``."""
        place = self._place(node)
        if leaf.built_in:
            with suppress(PolicyError, PortError):  # must not unwind through C++
                if place in self._controls:
                    self._controls[place].halt()
        elif leaf.outputs and self._trees.records:
            self.asks(Ask(AskKind.OPEN, leaf, place, (HALTED,)))
            self._write(node)
        elif leaf.halt and not leaf.plugin and leaf.halt not in self._trees.hidden:
            self.asks(Ask(AskKind.HALT, leaf, place, channel=leaf.halt))
        self.running.pop(place, None)

    def _write(self, node: TreeNode) -> None:
        """Write to the blackboard what the plugin that was asked wrote."""
        written, self._written = self._written, ()
        try:
            for port, value in written:
                write_port(port, value, node)
        except PortError:
            return  # the policy could not either, and says FAILURE

    def _place(self, node: TreeNode) -> TreePath:
        above = (
            part for around, child in self._nesting.above for part in (around.node.uid(), child)
        )
        return (*above, node.uid())

    def _tick_control(self, leaf: Leaf, node: TreeNode, place: TreePath) -> str:
        """As the policy does it, with the clock's word for an answer."""
        try:
            if place not in self._controls:
                children = Children(self._nesting, leaf.id, leaf.children, node)
                clock = _AskedClock(self, leaf, place)
                self._controls[place] = Control(leaf, node, children, clock)
            return self._controls[place].tick()
        except (PolicyError, PortError):
            return "FAILURE"  # as the policy takes it; must not unwind through C++
